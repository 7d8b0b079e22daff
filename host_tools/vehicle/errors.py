"""Error in a recording of a real vehicle."""

from __future__ import annotations

from rrins.host_tools.recording.errors import RecordError


class VehicleError(RecordError):
    """A recording of a vehicle that is missing, unreadable or cannot be navigated."""
