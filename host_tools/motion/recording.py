"""A recorded motion as read from a file, line by line, with its irregularities."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats, Integers
from rrins.host_tools.motion.errors import MotionError


@dataclass(frozen=True)
class Irregularity:
    """An irregularity in a file."""

    line: int  #: line of the file, from 1
    #: `columns`, `not_a_number`, `out_of_range`, `no_solution`, `repeated_time`, `gap`, `jump` or
    #: `motion` (begins or ends in motion)
    kind: str
    text: str  #: description
    mended: str = "left out"  #: remedy

    def __str__(self) -> str:
        return f"line {self.line}: {self.text}: {self.mended}"


@dataclass
class Recording:
    """The lines of a file that have a time; missing values are NaN.

    Attributes
    ----------
    place_deviation, velocity_deviation, attitude_deviation : array, shape (m, 3)
        Standard deviations in m, m/s (east, north, up) and rad.
    """

    path: Path
    kind: str  #: `csv` or `pos`
    line: Integers  #: shape (m,); line of the file, from 1
    time_s: Floats  #: shape (m,); since the first line
    place: Floats  #: shape (m, 3); latitude, longitude (rad, continuous), height (m)
    velocity_n: Floats  #: shape (m, 3); east, north, up, m/s
    attitude: Floats  #: shape (m, 3); roll, pitch, heading (rad, continuous)
    place_deviation: Floats
    velocity_deviation: Floats
    attitude_deviation: Floats
    irregularities: list[Irregularity] = field(default_factory=list)  #: irregularities found so far
    lines: int = 0  #: lines with data in the file
    unused: tuple[str, ...] = ()  #: columns that are not used

    def __len__(self) -> int:
        return len(self.line)

    @property
    def has_velocity(self) -> bool:
        """Whether any line has a velocity."""
        return bool(np.isfinite(self.velocity_n).any())

    @property
    def has_attitude(self) -> bool:
        """Whether any line has an attitude."""
        return bool(np.isfinite(self.attitude).any())

    def keep(self, kept: NDArray[np.bool_]) -> None:
        """Keep only the selected lines."""
        for name in (
            "line",
            "time_s",
            "place",
            "velocity_n",
            "attitude",
            "place_deviation",
            "velocity_deviation",
            "attitude_deviation",
        ):
            setattr(self, name, getattr(self, name)[kept])

    def report(self, at: int, kind: str, text: str, mended: str = "left out") -> None:
        """Add an irregularity for the line with the given index."""
        self.irregularities.append(Irregularity(int(self.line[at]), kind, text, mended))

    def fail(self, text: str, line: int | None = None) -> MotionError:
        """Return an error that names the file and line."""
        return MotionError(located(self.path, text, line))


def shown(cell: str) -> str:
    """Return the beginning of a file's text for a message: no control characters."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in cell[:20])


def located(path: Path, text: str, line: int | None = None) -> str:
    """Return a message with file and line."""
    where = "" if line is None else f" line {line}:"
    return f"motion {path}:{where} {text}"
