"""What can go wrong with live faults."""

from __future__ import annotations

from host_tools.errors import RehearsalError


class InjectionError(RehearsalError):
    """A fault that cannot be commanded live, or nobody who obeys."""

    exit_status = 7
