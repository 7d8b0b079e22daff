"""Where a bus is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Side = Literal["firmware", "hardware"]

EMBEDDED = "rrins"
"""The python-can interface name of the embedded bus."""


@dataclass(frozen=True)
class Address:
    """Address of a bus: a python-can interface, its channel and, if needed, its bit rate."""

    interface: str
    channel: str
    bitrate: int | None = None

    def __str__(self) -> str:
        return f"{self.interface}:{self.channel}"

    @property
    def is_embedded(self) -> bool:
        """Whether this is the embedded bus."""
        return self.interface == EMBEDDED
