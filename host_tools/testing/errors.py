"""What a bench cannot do, as an exception of its own."""

from __future__ import annotations

from host_tools.errors import RehearsalError


class BenchError(RehearsalError):
    """A bench that cannot go on, or was asked for what it cannot do.

    A test that fails by this has found nothing out about the firmware's behaviour: a process died,
    the scenario is over, or a name is wrong. What a test expects in vain is an `AssertionError`.
    """
