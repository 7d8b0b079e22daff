"""Reads RTKLIB `.pos` files with latitude, longitude, height and optional velocity.

Reference: *RTKLIB ver. 2.4.2 Manual* (2013), appendix B.1, for columns and their order.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

from rrins.host_tools.motion.errors import MotionError
from rrins.host_tools.motion.recording import located, shown
from rrins.host_tools.motion.table import (
    QUALITY,
    TIME,
    RecordedTable,
    check_count,
    check_groups,
    text_of,
)

NAMES = {
    "latitude": "latitude_deg",
    "longitude": "longitude_deg",
    "height": "height_m",
    "Q": QUALITY,
    "sdn": "sd_north_m",
    "sde": "sd_east_m",
    "sdu": "sd_up_m",
    "vn": "velocity_north_mps",
    "ve": "velocity_east_mps",
    "vu": "velocity_up_mps",
    "sdvn": "sd_velocity_north_mps",
    "sdve": "sd_velocity_east_mps",
    "sdvu": "sd_velocity_up_mps",
}
"""RTKLIB's column names, without unit, mapped to ours."""

_POSITION_NAMES = "latitude longitude height Q ns sdn sde sdu sdne sdeu sdun age ratio"
_VELOCITY_NAMES = "vn ve vu sdvn sdve sdvu sdvne sdveu sdvun"
_SEPARATOR = re.compile(r"[,;\s]+")
_WEEK_S = 604_800
_LAST_WEEK = 9999  # in the year 2171
_DAY_S = 86_400


def _columns(path: Path, names: list[str], line: int | None) -> tuple[str, ...]:
    """Return our names of RTKLIB's columns, the time first."""
    check_count(path, len(names), line)
    bare = [name.split("(")[0] for name in names]
    if any("ecef" in name or "baseline" in name for name in bare):
        raise MotionError(
            located(path, "positions are x, y, z; latitude, longitude, height needed", line)
        )
    if any("'" in name for name in names):
        raise MotionError(
            located(path, "angles are in degrees, minutes, seconds; decimal degrees needed", line)
        )
    columns = (TIME, *(NAMES.get(name, name) for name in bare))
    for name in ("latitude_deg", "longitude_deg", "height_m"):
        if columns.count(name) != 1:
            raise MotionError(located(path, f"the header has no column {name}", line))
    check_groups(path, columns, line)
    return columns


def _time(day: str, clock: str) -> tuple[int, float] | None:
    """Return a time from `2025/07/08 19:34:18.499`, or from GPS week and time of week.

    Split into whole seconds and a remainder: a single float could not resolve microseconds.
    """
    try:
        if "/" not in day:
            week = int(day)
            return (week * _WEEK_S, float(clock)) if 0 <= week <= _LAST_WEEK else None
        year, month, date = day.split("/")
        hours, minutes, seconds = clock.split(":")
        since = datetime(int(year), int(month), int(date), tzinfo=UTC).toordinal()
        h, m, s = int(hours), int(minutes), float(seconds)
    except (ValueError, OverflowError):
        return None
    if not (0 <= h < 24 and 0 <= m < 60 and 0 <= s < 61):
        return None
    return since * _DAY_S + h * 3600 + m * 60, s


def _is_header(line: str) -> bool:
    words = line[1:].split()
    return len(words) > 3 and any(
        word.startswith(("latitude", "x-ecef", "e-baseline")) for word in words
    )


def read_pos(path: Path) -> RecordedTable:
    """Return the rows of a file.

    Lines starting with % are comments; the one that names the columns is the header. Without a
    header, RTKLIB's default columns are assumed.

    Raises
    ------
    MotionError
        If it cannot be read, or its columns are unknown.
    """
    table: RecordedTable | None = None
    origin: tuple[int, float] | None = None
    for number, line in enumerate(text_of(path).splitlines(), start=1):
        stripped = line.strip()
        if stripped.startswith("%"):
            if _is_header(stripped):
                columns = _columns(path, stripped[1:].split()[1:], number)
                if table is not None and columns != table.columns:
                    raise MotionError(
                        located(path, "a second header with different columns", number)
                    )
                table = table or RecordedTable("pos", columns)
            continue
        if not stripped:
            continue
        cells = _SEPARATOR.split(stripped)
        if table is None:
            names = _POSITION_NAMES.split()
            if len(cells) > 2 + len(names):
                names += _VELOCITY_NAMES.split()
            table = RecordedTable("pos", _columns(path, names, None))
        if len(cells) < 2:
            table.add(number, cells)
            continue
        time = _time(*cells[:2])
        if time is None:
            table.skip(number, f"not a time: {shown(cells[0])} {shown(cells[1])}")
            continue
        origin = origin or time
        since = round(time[0] - origin[0] + (time[1] - origin[1]), 9)
        table.add(number, [repr(since), *cells[2:]])
    if table is None:
        raise MotionError(located(path, "the file has no data lines"))
    return table
