"""Reads a recorded motion: CSV with a header of names and units, or RTKLIB's `.pos`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.motion.csv_text import read_csv
from rrins.host_tools.motion.errors import MotionError
from rrins.host_tools.motion.pos_text import read_pos
from rrins.host_tools.motion.recording import Irregularity, Recording, located
from rrins.host_tools.motion.table import (
    ATTITUDE,
    ATTITUDE_SD,
    PLACE,
    PLACE_SD,
    QUALITY,
    TIME,
    VELOCITY,
    VELOCITY_SD,
    RecordedTable,
)
from rrins.host_tools.scenario.motion import Motion

_READERS = {".csv": read_csv, ".pos": read_pos}

_LIMITS = {
    TIME: (-1e12, 1e12),
    "latitude_deg": (-89.9, 89.9),
    "longitude_deg": (-180.0, 360.0),
    "height_m": (-1000.0, 100_000.0),
    "roll_deg": (-180.0, 180.0),
    "pitch_deg": (-80.0, 80.0),
    "heading_deg": (-36_000.0, 36_000.0),
}
_REQUIRED = (TIME, *PLACE)
_OPTIONAL = (("velocity", VELOCITY), ("attitude", ATTITUDE))
_DEVIATIONS = (PLACE_SD, VELOCITY_SD, ATTITUDE_SD)
_LEAST_DEVIATION = 0.002  # m, m/s: smaller stated deviations are not credible
_LARGEST_DEVIATION = 100.0


class _Columns:
    """The table's cells as numbers, checked line by line."""

    def __init__(self, table: RecordedTable, speed_limit: float) -> None:
        names = [name for group in (_REQUIRED, *(g for _, g in _OPTIONAL)) for name in group]
        names += [name for group in _DEVIATIONS for name in group]
        self._places = {name: k for k, name in enumerate(table.columns)}
        self.names = [name for name in names if name in self._places]
        self._limits = _LIMITS | dict.fromkeys(VELOCITY, (-speed_limit, speed_limit))
        self._table = table

    def has(self, group: tuple[str, ...]) -> bool:
        return group[0] in self._places

    def number(self, cells: list[str], name: str) -> float:
        """Return a cell's number; raise ValueError(kind, text)."""
        cell = cells[self._places[name]].strip()
        try:
            value = float(cell)
        except ValueError:
            raise ValueError("not_a_number", f"{name} is {cell[:20]!r}") from None
        if not np.isfinite(value):
            raise ValueError("not_a_number", f"{name} is {cell[:20]}")
        low, high = self._limits.get(name, (-np.inf, np.inf))
        if not low <= value <= high:
            raise ValueError(
                "out_of_range", f"{name} is {cell[:20]}, not within {low:g} to {high:g}"
            )
        return value

    def row(self, line: int, cells: list[str]) -> list[float] | None:
        """Return the numbers of a line in the order of `names`, or None if the line is unusable."""
        report = self._table.irregularities.append
        numbers = dict.fromkeys(self.names, np.nan)
        try:
            if QUALITY in self._places and self.number(cells, QUALITY) == 0:
                raise ValueError("no_solution", "quality 0, no solution")
            for name in _REQUIRED:
                numbers[name] = self.number(cells, name)
        except ValueError as error:
            report(self._irregular(line, error))
            return None
        for what, group in _OPTIONAL:
            if not self.has(group) or not any(cells[self._places[n]].strip() for n in group):
                continue
            try:
                found = {name: self.number(cells, name) for name in group}
            except ValueError as error:
                report(self._irregular(line, error, f"the line's {what} left out"))
                continue
            numbers |= found
        for group in _DEVIATIONS:
            if self.has(group):
                numbers |= {name: self._deviation(cells, name) for name in group}
        return list(numbers.values())

    @staticmethod
    def _irregular(line: int, error: ValueError, mended: str = "left out") -> Irregularity:
        kind, text = error.args
        return Irregularity(line, kind, text, mended)

    def _deviation(self, cells: list[str], name: str) -> float:
        """Return a standard deviation, NaN if the file has no plausible one."""
        try:
            value = self.number(cells, name)
        except ValueError:
            return np.nan
        return value if value > 0 else np.nan


def read(path: Path, motion: Motion) -> Recording:
    """Return the contents of a file: all lines with a time and a position.

    Parameters
    ----------
    path : Path
        Ends in .csv or .pos.
    motion : Motion
        Sets the default standard deviations and the speed limit.

    Raises
    ------
    MotionError
        If the file as a whole cannot be read; single unreadable lines are reported in
        `Recording.irregularities`.
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise MotionError(located(path, "must end in .csv or .pos"))
    table = reader(path)
    columns = _Columns(table, motion.speed_limit_mps)
    lines, rows = [], []
    for line, cells in zip(table.lines, table.rows, strict=True):
        row = columns.row(line, cells)
        if row is not None:
            lines.append(line)
            rows.append(row)
    numbers = np.array(rows, dtype=np.float64).reshape(len(rows), len(columns.names))
    by_name = dict(zip(columns.names, numbers.T, strict=True))

    def group(names: tuple[str, ...]) -> Floats:
        blank = np.full(len(rows), np.nan)
        return np.stack([by_name.get(name, blank) for name in names], axis=1)

    def deviations(names: tuple[str, ...], instead: float, least: float) -> Floats:
        column = group(names)
        return np.clip(np.where(np.isnan(column), instead, column), least, _LARGEST_DEVIATION)

    place, attitude = group(PLACE), group(ATTITUDE)
    if len(rows):
        place[:, 1] = np.unwrap(place[:, 1], period=360)
        attitude[:, [0, 2]] = _unwrapped(attitude[:, [0, 2]])
    place[:, :2] = np.radians(place[:, :2])
    return Recording(
        path=path,
        kind=table.kind,
        line=np.array(lines, dtype=np.int64),
        time_s=by_name[TIME],
        place=place,
        velocity_n=group(VELOCITY),
        attitude=np.radians(attitude),
        place_deviation=deviations(PLACE_SD, motion.position_deviation_m, _LEAST_DEVIATION),
        velocity_deviation=deviations(VELOCITY_SD, motion.velocity_deviation_mps, _LEAST_DEVIATION),
        attitude_deviation=np.radians(deviations(ATTITUDE_SD, motion.attitude_deviation_deg, 1e-4)),
        irregularities=table.irregularities,
        lines=table.count,
        unused=table.unused,
    )


def _unwrapped(angles_deg: Floats) -> Floats:
    """Return angles in ° without full-turn jumps; NaN is kept."""
    angles_deg = angles_deg.copy()
    for column in angles_deg.T:
        given = np.isfinite(column)
        column[given] = np.unwrap(column[given], period=360)
    return angles_deg
