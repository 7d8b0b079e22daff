"""Benchmarks of rehearsals on this machine: `rrins bench`. See docs/bench.md.

`suite` runs everything and shows the results; `floor`, `messages`, `rehearsals`, `compute` and
`fast_path` each measure one aspect, `limit` is what the fast path could cost at least, `reading` is
the diagnostic tool that reads meanwhile. `floor` and `messages` also run as programs: the processes
that they measure.
"""
