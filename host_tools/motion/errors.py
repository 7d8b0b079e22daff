"""The exception for motions that cannot be used."""

from __future__ import annotations

from rrins.host_tools.errors import RehearsalError


class MotionError(RehearsalError):
    """A recording is missing, unreadable or refused, or a motion is impossible."""

    exit_status = 9
