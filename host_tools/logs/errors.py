"""The exceptions of the logs; each is one clear line (see `host_tools.errors`)."""

from __future__ import annotations

from host_tools.errors import RehearsalError


class RecordError(RehearsalError):
    """A recording that cannot be begun or read, or went wrong."""

    exit_status = 6


class DifferenceError(RehearsalError):
    """Two recordings, or a recording and its replay, are not the same."""

    exit_status = 10
