"""Reads a recording as CSV: `increments.csv`, `gnss.csv` and `truth.csv` of a folder.

The columns are those that `rrins increments` and `rrins motion export` write, so what the project
writes can be read back. More than three sensors have a column each.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.motion.table import (
    ATTITUDE,
    PLACE,
    PLACE_SD,
    TIME,
    VELOCITY,
    VELOCITY_SD,
)
from rrins.host_tools.vehicle.checks import finite, increasing, located, on_earth
from rrins.host_tools.vehicle.recording import (
    Beginning,
    Fixes,
    Increments,
    Reference,
    VehicleRecording,
)

INCREMENTS, GNSS, TRUTH = "increments.csv", "gnss.csv", "truth.csv"
"""Names of the files in a folder."""

_BODY = {
    "dtheta": tuple(f"dtheta_b_{axis}_rad" for axis in "xyz"),
    "dv": tuple(f"dv_b_{axis}_mps" for axis in "xyz"),
}
_SENSOR = {
    "dtheta": re.compile(r"gyro_(\d+)_dtheta_rad"),
    "dv": re.compile(r"accelerometer_(\d+)_dv_mps"),
}
_POSITION_SIGMA_M, _VELOCITY_SIGMA_MPS = 1.5, 0.05


class _Table:
    """A CSV file with one header row."""

    def __init__(self, path: Path) -> None:
        from pyarrow import ArrowException, csv

        self.path = path
        if not path.is_file():
            raise located(path, "no such file")
        try:
            table = csv.read_csv(path)
            names = [name.strip().lower() for name in table.column_names]
        except UnicodeDecodeError as error:
            raise located(path, "is not UTF-8 text") from error
        except (ArrowException, OSError) as error:
            why = str(error).partition("\n")[0]
            shown = "".join(letter if letter.isprintable() else "?" for letter in why[:80])
            raise located(path, f"not CSV: {shown}") from error
        if len(set(names)) < len(names):
            raise located(path, f"two columns {max(names, key=names.count)}")
        self._columns = dict(zip(names, table.columns, strict=True))
        self.rows = table.num_rows
        if self.rows < 2:
            raise located(path, f"{self.rows} rows")
        if TIME not in self._columns:
            raise located(path, f"no column {TIME}")
        self.time_s = self.column(TIME)
        increasing(path, self.time_s)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._columns)

    def column(self, name: str) -> Floats:
        try:
            return self._columns[name].to_numpy().astype(np.float64)
        except (TypeError, ValueError) as error:
            raise located(self.path, f"{name}: not all cells are numbers") from error

    def group(self, names: tuple[str, ...]) -> Floats | None:
        """Return some columns, shape (rows, columns); None where all are missing."""
        missing = [name for name in names if name not in self._columns]
        if len(missing) == len(names):
            return None
        if missing:
            raise located(self.path, f"no column {missing[0]} (group: {', '.join(names)})")
        found = np.column_stack([self.column(name) for name in names])
        finite(self.path, names[0], found)
        return found

    def place(self) -> Floats:
        found = self.group(PLACE)
        if found is None:
            raise located(self.path, f"no column {PLACE[0]}")
        place = np.column_stack([np.radians(found[:, :2]), found[:, 2]])
        on_earth(self.path, place)
        return place


def _sensors(table: _Table, kind: str) -> tuple[Floats, bool]:
    """Return the increments of a kind, and whether they are along the axes of the body."""
    body = table.group(_BODY[kind])
    if body is not None:
        return body, True
    numbered = sorted(
        (int(match[1]), name) for name in table.names if (match := _SENSOR[kind].fullmatch(name))
    )
    if [number for number, _ in numbered] != list(range(1, len(numbered) + 1)) or not numbered:
        example = {"dtheta": "gyro_1_dtheta_rad", "dv": "accelerometer_1_dv_mps"}[kind]
        raise located(
            table.path, f"neither {', '.join(_BODY[kind])} nor {example} and so on, without a gap"
        )
    found = table.group(tuple(name for _, name in numbered))
    assert found is not None
    return found, False


def read_increments(path: Path) -> tuple[Increments, bool]:
    """Return the increments of a file, and whether they are along the axes of the body."""
    table = _Table(path)
    dtheta, along_body = _sensors(table, "dtheta")
    dv, too = _sensors(table, "dv")
    if along_body != too:
        raise located(
            path, "gyros and accelerometers must both be along the body's axes, or neither"
        )
    if min(dtheta.shape[1], dv.shape[1]) < 3:
        raise located(path, "three sensors of each kind at least")
    return Increments(table.time_s, dtheta, dv), along_body


def read_gnss(path: Path) -> Fixes:
    """Return the fixes of a file; without σ, 1.5 m and 0.05 m/s are taken."""
    table = _Table(path)
    place, velocity = table.place(), table.group(VELOCITY)
    sigma, velocity_sigma = table.group(PLACE_SD), table.group(VELOCITY_SD)
    if sigma is None:
        sigma = np.full_like(place, _POSITION_SIGMA_M)
    if velocity is not None and velocity_sigma is None:
        velocity_sigma = np.full_like(velocity, _VELOCITY_SIGMA_MPS)
    return Fixes(table.time_s, place, sigma, velocity, velocity_sigma)


def read_truth(path: Path) -> Reference:
    """Return the states of a file."""
    table = _Table(path)
    attitude = table.group(ATTITUDE)
    return Reference(
        table.time_s,
        table.place(),
        table.group(VELOCITY),
        None if attitude is None else np.radians(attitude),
    )


def read(imu: Path, gnss: Path | None, truth: Path | None) -> VehicleRecording:
    """Return the recording in CSV files; see `reading.read`."""
    increments, along_body = read_increments(imu)
    return VehicleRecording(
        name=imu.parent.name or imu.stem,
        kind="csv",
        files=tuple(path for path in (imu, gnss, truth) if path is not None),
        increments=increments,
        fixes=None if gnss is None else read_gnss(gnss),
        reference=None if truth is None else read_truth(truth),
        beginning=Beginning(),
        axes_are_body=along_body,
    )
