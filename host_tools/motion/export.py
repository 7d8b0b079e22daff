"""Writes a trajectory as CSV with all channels, or as RTKLIB `.pos`."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator
from datetime import datetime, timedelta
from pathlib import Path
from typing import TextIO

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.motion.csv_text import EXPORTED_ONLY
from rrins.host_tools.motion.errors import MotionError
from rrins.host_tools.motion.table import ATTITUDE, PLACE, TIME, VELOCITY
from rrins.host_tools.motion.trajectory import ATTITUDE as ANGLES
from rrins.host_tools.motion.trajectory import OMEGA_IB_B, Trajectory
from rrins.host_tools.motion.trajectory import PLACE as WHERE

MOST_ROWS = 20_000_000
_BLOCK = 50_000  # rows at a time

_CSV_FORMATS = {
    TIME: ".6f",
    **dict.fromkeys(PLACE[:2], ".12f"),  # 0.1 µm
    PLACE[2]: ".6f",
    **dict.fromkeys(VELOCITY, ".7f"),
    **dict.fromkeys(ATTITUDE, ".8f"),
    **dict.fromkeys(EXPORTED_ONLY, ".9f"),
}

_POS_BEGIN = datetime(2000, 1, 1)  # GPS time, which has no time zone
_POS_HEADER = (
    "%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   "
    "sdu(m)  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio    vn(m/s)    ve(m/s)    vu(m/s)      sdvn "
    "    sdve     sdvu    sdvne    sdveu    sdvun\n"
)


def _blocks(trajectory: Trajectory, rate_hz: float, duration_s: float) -> Iterator[Floats]:
    """Yield rows of time and channels, angles in °, with heading and longitude wrapped."""
    count = math.floor(duration_s * rate_hz + 1e-6) + 1
    if count > MOST_ROWS:
        raise MotionError(f"motion: {count} rows to export, at most {MOST_ROWS} are allowed")
    for first in range(0, count, _BLOCK):
        times = np.arange(first, min(first + _BLOCK, count)) / rate_hz
        state = trajectory.at(times)
        state[:, OMEGA_IB_B] = np.degrees(state[:, OMEGA_IB_B])
        place, angles = state[:, WHERE], state[:, ANGLES]
        place[:, :2] = np.degrees(place[:, :2])
        place[:, 1] = (place[:, 1] + 180) % 360 - 180
        angles[:] = np.degrees(angles)
        angles[:, 2] %= 360
        yield np.column_stack([times, state])


def _write_csv(file: TextIO, blocks: Iterator[Floats], rate_hz: float) -> None:
    # The channels start with rates and forces; in the file these come last.
    order = [0, *range(7, 16), *range(1, 7)]
    rows = csv.writer(file, lineterminator="\n")
    rows.writerow(_CSV_FORMATS)
    formats = list(_CSV_FORMATS.values())
    for block in blocks:
        for values in block[:, order].tolist():
            rows.writerow([format(v, f) for v, f in zip(values, formats, strict=True)])


def _write_pos(file: TextIO, blocks: Iterator[Floats], rate_hz: float) -> None:
    places = 3 if (1000 / rate_hz).is_integer() else 6
    file.write("% program   : rrins, true motion\n")
    file.write(_POS_HEADER)
    exact = " ".join(["%8.4f"] * 6) % (0.001, 0.001, 0.001, 0, 0, 0)
    exact_velocity = " ".join(["%8.5f"] * 6) % (0.001, 0.001, 0.001, 0, 0, 0)
    for block in blocks:
        for values in block.tolist():
            time = _POS_BEGIN + timedelta(seconds=values[0])
            clock = f"{time:%Y/%m/%d %H:%M:%S}.{time.microsecond:06d}"[: 20 + places]
            latitude, longitude, height, east, north, up = values[7:13]
            file.write(
                f"{clock} {latitude:14.9f} {longitude:14.9f} {height:10.4f} {1:3d} {20:3d} {exact} "
                f"{0:6.2f} {999.9:6.1f} {north:10.5f} {east:10.5f} {up:10.5f} {exact_velocity}\n"
            )


_WRITERS: dict[str, Callable[[TextIO, Iterator[Floats], float], None]] = {
    ".csv": _write_csv,
    ".pos": _write_pos,
}


def check_ending(path: Path) -> None:
    """Raise `MotionError` unless a motion can be written to a file of that name."""
    if path.suffix.lower() not in _WRITERS:
        raise MotionError(f"motion {path}: must end in .csv or .pos")
    if not path.parent.is_dir():
        raise MotionError(f"motion {path}: no such folder: {path.parent}")


def write_motion(
    trajectory: Trajectory, path: Path, rate_hz: float, duration_s: float | None = None
) -> None:
    """Write a trajectory to a file atomically.

    Parameters
    ----------
    trajectory : Trajectory
    path : Path
        .csv for everything, with angular rate and specific force; .pos for place and velocity.
    rate_hz : float
        Rows per second.
    duration_s : float, optional
        Duration; by default all pieces, one pass for a looping motion.

    Raises
    ------
    MotionError
        If the file cannot be written.
    """
    check_ending(path)
    blocks = _blocks(trajectory, rate_hz, duration_s or trajectory.duration_s)
    part = path.with_name(f".{path.name}.part")
    try:
        with part.open("w", encoding="utf-8", newline="") as file:
            _WRITERS[path.suffix.lower()](file, blocks, rate_hz)
        part.replace(path)
    except OSError as error:
        raise MotionError(f"motion {path}: cannot be written: {error.strerror}") from error
    finally:
        part.unlink(missing_ok=True)
