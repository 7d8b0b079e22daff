"""Exceptions for recordings and logs; each message is one line (see `rrins.host_tools.errors`)."""

from __future__ import annotations

from rrins.host_tools.errors import RehearsalError


class RecordError(RehearsalError):
    """A recording cannot be started or read, or has failed."""

    exit_status = 6


class DifferenceError(RehearsalError):
    """Two recordings, or a recording and its replay, differ."""

    exit_status = 10
