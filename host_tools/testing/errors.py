"""The exception of a bench."""

from __future__ import annotations

from rrins.host_tools.errors import RehearsalError


class BenchError(RehearsalError):
    """A bench cannot continue, or cannot do what was requested.

    It says nothing about the firmware's behaviour: a process died, the scenario is over, or a name
    is wrong. An unmet expectation raises `AssertionError` instead.
    """
