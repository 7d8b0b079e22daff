"""A recording's file as columns of text, whatever its format."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from rrins.host_tools import files
from rrins.host_tools.motion.errors import MotionError
from rrins.host_tools.motion.recording import Irregularity, located

TIME = "time_s"
PLACE = ("latitude_deg", "longitude_deg", "height_m")
VELOCITY = ("velocity_east_mps", "velocity_north_mps", "velocity_up_mps")
ATTITUDE = ("roll_deg", "pitch_deg", "heading_deg")
PLACE_SD = ("sd_east_m", "sd_north_m", "sd_up_m")
VELOCITY_SD = ("sd_velocity_east_mps", "sd_velocity_north_mps", "sd_velocity_up_mps")
ATTITUDE_SD = ("sd_roll_deg", "sd_pitch_deg", "sd_heading_deg")
QUALITY = "quality"
GROUPS = (PLACE, VELOCITY, ATTITUDE, PLACE_SD, VELOCITY_SD, ATTITUDE_SD)

_LARGEST_FILE = 1 << 30  # bytes
_MOST_COLUMNS = 1000


@dataclass
class RecordedTable:
    """Lines of text with the same columns."""

    kind: str  #: `csv` or `pos`
    columns: tuple[str, ...]  #: names, `time_s` among them
    lines: list[int] = field(default_factory=list)  #: line of the file for each row, from 1
    rows: list[list[str]] = field(default_factory=list)  #: each has the length of `columns`
    #: irregularities of lines that are not rows
    irregularities: list[Irregularity] = field(default_factory=list)
    unused: tuple[str, ...] = ()  #: columns of the file that are not used
    count: int = 0
    """Number of data lines, valid or not."""

    def add(self, line: int, cells: list[str]) -> None:
        """Add a row, or report that it has the wrong number of columns."""
        self.count += 1
        if len(cells) == len(self.columns):
            self.lines.append(line)
            self.rows.append(cells)
        else:
            text = f"{len(cells)} columns instead of {len(self.columns)}"
            self.irregularities.append(Irregularity(line, "columns", text))

    def skip(self, line: int, text: str) -> None:
        """Report a line whose time cannot be read."""
        self.count += 1
        self.irregularities.append(Irregularity(line, "not_a_number", text))


def check_count(path: Path, columns: int, line: int | None) -> None:
    """Raise `MotionError` if no recording has so many columns."""
    if columns > _MOST_COLUMNS:
        raise MotionError(located(path, f"{columns} columns, {_MOST_COLUMNS} at most", line))


def check_groups(path: Path, columns: tuple[str, ...], line: int | None) -> None:
    """Raise `MotionError` if a column of a group is missing or duplicated."""
    for group in GROUPS:
        counts = [columns.count(name) for name in group]
        if any(counts) and counts != [1, 1, 1]:
            name = next(n for n, count in zip(group, counts, strict=True) if count != 1)
            text = f"duplicate column {name}" if name in columns else f"no column {name}"
            raise MotionError(located(path, f"{text} (group: {', '.join(group)})", line))


def text_of(path: Path) -> str:
    """Return a file's text.

    Raises
    ------
    MotionError
        If it is missing, too large, or not text.
    """
    try:
        if path.is_dir():
            raise MotionError(located(path, "is a folder"))
        return files.text_of(path, _LARGEST_FILE)
    except OSError as error:
        raise MotionError(located(path, f"cannot be read: {error.strerror or error}")) from error
