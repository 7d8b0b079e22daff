"""Errors of live fault injection."""

from __future__ import annotations

from rrins.host_tools.errors import RehearsalError


class InjectionError(RehearsalError):
    """A fault cannot be injected live, or no hardware answers."""

    exit_status = 7
