"""Results of both sides at the end of a run."""

from __future__ import annotations

from dataclasses import dataclass, field

from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.files import JsonObject


@dataclass(frozen=True)
class Outcome:
    """Last words of both sides, and why the run ended.

    Attributes
    ----------
    firmware, hardware : dict
        Summary of each side; empty for one that could not give any.
    """

    firmware: JsonObject = field(default_factory=dict)
    hardware: JsonObject = field(default_factory=dict)
    wall_s: float = 0.0  #: seconds that the run took
    failure: RehearsalError | None = None
