"""Benchmarks of rehearsals on this machine, from Python."""

from __future__ import annotations

from rrins.host_tools.benchmarks.suite import Result, measured


def benchmark(quick: bool = False) -> Result:
    """Measure what a rehearsal costs on this machine: speed, steps, codec, lateness, start-up.

    Progress goes to standard error.

    Parameters
    ----------
    quick : bool
        Fewer samples, no cold start: about 20 s.

    Returns
    -------
    dict
        What `rrins bench --json` prints.
    """
    return measured(quick)
