"""Reads what KF-GINS reads: its configuration, and the text files of IMU, GNSS and truth.

Formats: README of https://github.com/i2Nav-WHU/KF-GINS, section 2.2, and, for fixes with velocity,
of https://github.com/i2Nav-WHU/KF-GINS-Matlab, section 3.2. Its body axes are forward, right, down,
its navigation frame north, east, down; angles are roll, pitch, yaw as ours.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools import files
from rrins.host_tools.vehicle.checks import finite, increasing, located, numbers, on_earth
from rrins.host_tools.vehicle.recording import (
    FRD_TO_RFU,
    Beginning,
    Fixes,
    Increments,
    Noise,
    Reference,
    VehicleRecording,
)

_MGAL = 1e-5  # m/s²
_HOUR_S = 3600.0
_LINE = re.compile(r"^(\s*)([A-Za-z]\w*)\s*:\s*(.*?)\s*$")


@dataclass
class _Configuration:
    """The keys of a configuration, `imunoise`'s among them by their own names."""

    path: Path
    texts: dict[str, str] = field(default_factory=dict)

    def numbers(self, key: str, count: int) -> tuple[float, ...] | None:
        """Return the numbers of a key, or None where it is missing."""
        text = self.texts.get(key)
        if text is None:
            return None
        try:
            values = tuple(float(part) for part in text.strip("[] ").split(","))
        except ValueError:
            values = ()
        if len(values) != count or not all(map(math.isfinite, values)):
            raise located(self.path, f"{key}: {count} numbers expected, found {text[:40]!r}")
        return values

    def number(self, key: str) -> float | None:
        """Return the number of a key, or None where it is missing."""
        found = self.numbers(key, 1)
        return None if found is None else found[0]

    def file(self, key: str) -> Path:
        """Return a file that a key names: as given, or beside the configuration."""
        text = self.texts.get(key, "").strip("\"' ")
        if not text:
            raise located(self.path, f"no {key}")
        named = Path(text)
        folder = self.path.parent
        for candidate in (folder / named, folder.parent / named, folder / named.name):
            if candidate.is_file():
                return candidate
        raise located(self.path, f"{key}: {named} is neither there nor beside the configuration")


def _configuration(path: Path) -> _Configuration:
    """Read the part of YAML that KF-GINS' configurations use: a key and its value in a line."""
    try:
        text = files.text_of(path)
    except (OSError, UnicodeDecodeError) as error:
        raise located(path, f"cannot be read: {error}") from error
    found = _Configuration(path)
    for line in text.splitlines():
        match = _LINE.match(line.split("#", 1)[0])
        if match is not None and match[3]:
            found.texts[match[2].lower()] = match[3]
    if "imupath" not in found.texts:
        raise located(path, "no imupath: it is not a configuration of KF-GINS")
    return found


def _table(path: Path, names: str, count: int, time: int, what: str) -> Floats:
    """Return a file's numbers: at least `count` columns, of which number `time` is the time."""
    table = numbers(path)
    if table.shape[1] < count:
        raise located(path, f"{table.shape[1]} columns, {count} expected: {names}")
    increasing(path, table[:, time])
    finite(path, what, table[:, time + 1 : count])
    return table


def _place(path: Path, columns: Floats) -> Floats:
    """Return latitude, longitude (rad), height of columns in ° and m."""
    place = np.column_stack([np.radians(columns[:, :2]), columns[:, 2]])
    on_earth(path, place)
    return place


def read_imu(path: Path) -> Increments:
    """Return the increments of an IMU file: seconds, Δθ (3), Δv (3), further columns unused."""
    table = _table(path, "seconds, Δθ (3), Δv (3)", 7, 0, "an increment")
    return Increments(table[:, 0], table[:, 1:4] @ FRD_TO_RFU.T, table[:, 4:7] @ FRD_TO_RFU.T)


def read_gnss(path: Path) -> Fixes:
    """Return the fixes of a GNSS file of 7 columns, or of 13 with velocities."""
    table = _table(path, "seconds, latitude, longitude, height, σ (3)", 7, 0, "a position")
    place = _place(path, table[:, 1:4])
    velocity = velocity_sigma = None
    if table.shape[1] >= 13:
        finite(path, "a velocity", table[:, 7:13])
        velocity = table[:, 7:10] @ FRD_TO_RFU.T
        velocity_sigma = np.abs(table[:, 10:13] @ FRD_TO_RFU.T)
    sigma = np.abs(table[:, 4:7] @ FRD_TO_RFU.T)
    return Fixes(table[:, 0], place, sigma, velocity, velocity_sigma)


def read_nav(path: Path) -> Reference:
    """Return the states of a navigation file of 11 columns: week, seconds, and so on."""
    table = _table(path, "week, seconds, state (9)", 11, 1, "a state")
    return Reference(
        table[:, 1],
        _place(path, table[:, 2:5]),
        table[:, 5:8] @ FRD_TO_RFU.T,
        np.radians(table[:, 8:11]),
    )


def _mean(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _noises(found: _Configuration) -> tuple[Noise | None, Noise | None]:
    """Return the data sheets; KF-GINS takes biases and scale factors as Gauss-Markov processes."""
    texts = ("arw", "vrw", "gbstd", "abstd")
    arw, vrw, gyro, accelerometer = (found.numbers(key, 3) for key in texts)
    if arw is None or vrw is None or gyro is None or accelerometer is None:
        return None, None
    per_root_s = math.sqrt(2.0 / ((found.number("corrtime") or 1.0) * _HOUR_S))
    sheets = []
    for white, bias, scale, initial in (
        (
            math.radians(_mean(arw)) / 60.0,
            math.radians(_mean(gyro)) / _HOUR_S,
            _mean(found.numbers("gsstd", 3) or (0.0,)),
            _mean(found.numbers("initbgstd", 3) or (0.0,)) * math.radians(1.0) / _HOUR_S,
        ),
        (
            _mean(vrw) / 60.0,
            _mean(accelerometer) * _MGAL,
            _mean(found.numbers("asstd", 3) or (0.0,)),
            _mean(found.numbers("initbastd", 3) or (0.0,)) * _MGAL,
        ),
    ):
        sheets.append(Noise(white, initial or bias, bias * per_root_s, scale * 1e-6))
    return sheets[0], sheets[1]


def _beginning(found: _Configuration) -> Beginning:
    place, velocity = found.numbers("initpos", 3), found.numbers("initvel", 3)
    attitude, sigma = found.numbers("initatt", 3), found.numbers("initattstd", 3)
    place_sigma, velocity_sigma = found.numbers("initposstd", 3), found.numbers("initvelstd", 3)
    return Beginning(
        time_s=found.number("starttime"),
        place=None if place is None else np.array([*np.radians(place[:2]), place[2]]),
        place_sigma=None if place_sigma is None else max(place_sigma),
        velocity_n=None if velocity is None else FRD_TO_RFU @ np.array(velocity),
        velocity_sigma=None if velocity_sigma is None else max(velocity_sigma),
        attitude=None if attitude is None else np.radians(attitude),
        level_sigma=None if sigma is None else math.radians(max(sigma[:2])),
        heading_sigma=None if sigma is None else math.radians(sigma[2]),
    )


def read_configuration(path: Path, truth: Path | None = None) -> VehicleRecording:
    """Return the recording that a configuration of KF-GINS names.

    Parameters
    ----------
    path : Path
        Such as ``dataset/kf-gins.yaml``. Files that it names are looked for as it names them, from
        its folder and the one above, and beside it.
    truth : Path, optional
        By default ``truth.nav`` beside the IMU file, if it is there.
    """
    found = _configuration(path)
    imu, gnss = found.file("imupath"), found.file("gnsspath")
    if truth is None and (imu.parent / "truth.nav").is_file():
        truth = imu.parent / "truth.nav"
    fixes = read_gnss(gnss)
    lever = found.numbers("antlever", 3)
    if lever is not None:
        fixes = replace(fixes, lever_arm_b=FRD_TO_RFU @ np.array(lever))
    gyros, accelerometers = _noises(found)
    end = found.number("endtime")
    return VehicleRecording(
        name=path.stem,
        kind="kf-gins",
        files=(imu, gnss, *(() if truth is None else (truth,))),
        increments=read_imu(imu),
        fixes=fixes,
        reference=None if truth is None else read_nav(truth),
        beginning=_beginning(found),
        gyros=gyros,
        accelerometers=accelerometers,
        ends_s=None if end is None or end < 0 else end,
    )


def read_files(imu: Path, gnss: Path | None, truth: Path | None) -> VehicleRecording:
    """Return a recording from files of these formats, without a configuration."""
    return VehicleRecording(
        name=imu.stem,
        kind="kf-gins",
        files=tuple(path for path in (imu, gnss, truth) if path is not None),
        increments=read_imu(imu),
        fixes=None if gnss is None else read_gnss(gnss),
        reference=None if truth is None else read_nav(truth),
        beginning=Beginning(),
    )
