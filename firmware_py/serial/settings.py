"""Which serial lines are opened, and what they carry: what a command line may know without more."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

from rrins.firmware_py.serial.port import PortName

DEFAULT_UTC: Final = datetime(2026, 1, 1, tzinfo=UTC)
"""Default UTC of epoch 0."""

SENTENCE_NAMES: Final = ("PASHR", "TNTHTM", "HDT", "GGA", "RMC")
"""Of NMEA sentences, in the order in which they are sent.

gpsd treats the sentences with one time of day as a cycle, and reports a position when the last
sentence of a cycle arrives; so GGA and RMC come together at the end.
"""


@dataclass(frozen=True)
class SerialSettings:
    """The serial lines to open.

    Attributes
    ----------
    nmea, console : PortName or None
    """

    nmea: PortName | None = None
    nmea_rate_hz: int = 1  #: sets of sentences a second; the firmware's rate is a multiple of it
    nmea_sentences: tuple[str, ...] = SENTENCE_NAMES  #: of `SENTENCE_NAMES`
    utc: datetime = DEFAULT_UTC  #: UTC of epoch 0
    console: PortName | None = None


NO_LINES = SerialSettings()
"""No serial lines."""
