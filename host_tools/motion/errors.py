"""What cannot be made a motion of, as an exception of its own."""

from __future__ import annotations

from host_tools.errors import RehearsalError


class MotionError(RehearsalError):
    """A recording that is missing, unreadable or refused, or a motion that cannot be."""

    exit_status = 9
