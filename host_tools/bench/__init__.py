"""What the rehearsal costs on this machine: `rrins bench`. See docs/bench.md.

``suite`` runs everything and shows it; ``floor``, ``messages``, ``rehearsals`` and ``compute`` each
measure one kind of thing. `floor` and `messages` are programs as well: the processes they measure.
"""
