"""Reads the MATLAB structures of NaveGo (https://github.com/rodralez/NaveGo): `.mat` files.

A structure is known by its fields, whatever its name: `fb` and `wb` make an IMU; `lat`, `vel` and
`stdm` or `std` a GNSS receiver; `lat` and `roll` a reference. Body axes are forward, right, down;
the navigation frame is north, east, down; units are SI and rad.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.vehicle.checks import finite, increasing, located, on_earth
from rrins.host_tools.vehicle.recording import (
    FRD_TO_RFU,
    Beginning,
    Fixes,
    Increments,
    Noise,
    Reference,
    VehicleRecording,
)

_EARTH_M = 6_371_000.0


class _Structure:
    """A structure of a file, its fields as arrays."""

    def __init__(self, path: Path, name: str, value: Any) -> None:
        self.path, self.name = path, name
        self.fields = set(value._fieldnames)
        self._value = value

    def _array(self, name: str) -> Floats:
        try:
            return np.asarray(getattr(self._value, name), dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise located(self.path, f"{self.name}.{name}: not numbers") from error

    def vector(self, name: str) -> Floats:
        """Return a field as a vector."""
        return self._array(name).reshape(-1)

    def columns(self, name: str, rows: int) -> Floats:
        """Return a field of three columns, shape (rows, 3)."""
        found = self._array(name)
        if found.shape != (rows, 3):
            shape = " × ".join(map(str, found.shape))
            raise located(self.path, f"{self.name}.{name}: {shape}, {rows} × 3 expected")
        return found

    def three(self, name: str) -> Floats | None:
        """Return a field of three numbers; None where it is missing."""
        if name not in self.fields:
            return None
        found = self.vector(name)
        if len(found) != 3 or not np.isfinite(found).all():
            raise located(self.path, f"{self.name}.{name}: three numbers expected")
        return found

    def place(self) -> Floats:
        """Return latitude, longitude and height, shape (n, 3)."""
        found = [self.vector(name) for name in ("lat", "lon", "h")]
        if len({len(column) for column in found} | {len(self.vector("t"))}) > 1:
            raise located(self.path, f"{self.name}: t, lat, lon and h differ in length")
        place = np.column_stack(found)
        finite(self.path, "a position", place)
        on_earth(self.path, place)
        return place


def _kind_of(structure: _Structure) -> str | None:
    fields = structure.fields
    if {"t", "fb", "wb"} <= fields:
        return "imu"
    if {"t", "lat", "lon", "h"} <= fields:
        return "truth" if "roll" in fields else "gnss"
    return None


def structures(path: Path) -> dict[str, list[_Structure]]:
    """Return the structures of a file by what they are: ``imu``, ``gnss``, ``truth``.

    Raises
    ------
    VehicleError
        If it cannot be read.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        variables = loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError as error:  # HDF5
        raise located(path, "is of MATLAB 7.3; save it with -v7") from error
    except (OSError, ValueError, TypeError, MatReadError) as error:
        raise located(path, f"cannot be read as a .mat file: {error}") from error
    found: dict[str, list[_Structure]] = {"imu": [], "gnss": [], "truth": []}
    for name, value in variables.items():
        if hasattr(value, "_fieldnames"):
            structure = _Structure(path, name, value)
            kind = _kind_of(structure)
            if kind is not None:
                found[kind].append(structure)
    return found


def _increments(imu: _Structure) -> Increments:
    """Return increments from rates, each taken as the mean of the interval that ends there."""
    time_s = imu.vector("t")
    increasing(imu.path, time_s)
    rate, force = imu.columns("wb", len(time_s)), imu.columns("fb", len(time_s))
    finite(imu.path, "a rate or force", np.hstack([rate, force]))
    lengths = np.diff(time_s, prepend=time_s[0] - np.median(np.diff(time_s)))[:, np.newaxis]
    turn = FRD_TO_RFU.T
    return Increments(time_s, rate * lengths @ turn, force * lengths @ turn)


def _fixes(gnss: _Structure) -> Fixes:
    time_s, place = gnss.vector("t"), gnss.place()
    increasing(gnss.path, time_s)
    sigma = gnss.three("stdm")
    if sigma is None:
        sigma = gnss.three("std")
        if sigma is None:
            raise located(gnss.path, f"{gnss.name}: neither stdm nor std")
        sigma = sigma * [_EARTH_M, _EARTH_M * math.cos(place[0, 0]), 1.0]
    velocity = velocity_sigma = None
    speeds = gnss.three("stdv")
    if "vel" in gnss.fields and speeds is not None:
        velocity = gnss.columns("vel", len(time_s)) @ FRD_TO_RFU.T
        finite(gnss.path, "a velocity", velocity)
        velocity_sigma = np.tile(np.abs(FRD_TO_RFU @ speeds), (len(time_s), 1))
    arm = gnss.three("larm")
    return Fixes(
        time_s,
        place,
        np.tile(np.abs(FRD_TO_RFU @ sigma), (len(time_s), 1)),
        velocity,
        velocity_sigma,
        np.zeros(3) if arm is None else FRD_TO_RFU @ arm,
    )


def _reference(truth: _Structure) -> Reference:
    time_s, place = truth.vector("t"), truth.place()
    increasing(truth.path, time_s)
    velocity = attitude = None
    if "vel" in truth.fields:
        velocity = truth.columns("vel", len(time_s)) @ FRD_TO_RFU.T
    if {"roll", "pitch", "yaw"} <= truth.fields:
        attitude = np.column_stack([truth.vector(name) for name in ("roll", "pitch", "yaw")])
    return Reference(time_s, place, velocity, attitude)


def _noise(imu: _Structure, white: str, constant: str, drift: str, corr: str) -> Noise | None:
    """Return the data sheet of a kind: white noise, constant bias, Gauss-Markov drift."""
    noise, static = imu.three(white), imu.three(constant)
    if noise is None or static is None:
        return None
    dynamic, time_s = imu.three(drift), imu.three(corr)
    walk = 0.0
    if dynamic is not None and time_s is not None and (time_s > 0).all():
        walk = float(np.max(dynamic * np.sqrt(2.0 / time_s)))
    return Noise(float(np.max(noise)), float(np.max(np.abs(static))), walk)


def _beginning(imu: _Structure) -> Beginning:
    attitude, sigma = imu.three("ini_align"), imu.three("ini_align_err")
    return Beginning(
        attitude=attitude,
        level_sigma=None if sigma is None else float(np.max(np.abs(sigma[:2]))),
        heading_sigma=None if sigma is None else float(abs(sigma[2])),
    )


def _one(kind: str, where: Path, found: list[_Structure]) -> _Structure | None:
    if len(found) > 1:
        names = ", ".join(f"{structure.path.name} ({structure.name})" for structure in found)
        raise located(where, f"several could be the {kind}: {names}; choose with --{kind} FILE")
    return found[0] if found else None


def read(
    where: Path, imu: Path | None = None, gnss: Path | None = None, truth: Path | None = None
) -> VehicleRecording:
    """Return the recording in a folder of `.mat` files, or in one file; see `reading.read`."""
    paths = sorted(where.glob("*.mat")) if where.is_dir() else [where]
    given = {"imu": imu, "gnss": gnss, "truth": truth}
    found: dict[str, list[_Structure]] = {kind: [] for kind in given}
    for path in dict.fromkeys([*paths, *(path for path in given.values() if path is not None)]):
        for kind, listed in structures(path).items():
            chosen = given[kind]
            if chosen is None or path.resolve() == chosen.resolve():
                found[kind] += listed
    if truth is not None and not found["truth"]:  # a better receiver's fixes
        found["truth"] = structures(truth)["gnss"]
        found["gnss"] = [one for one in found["gnss"] if one.path.resolve() != truth.resolve()]
    device = _one("imu", where, found["imu"])
    if device is None:
        raise located(where, "no structure with the fields t, fb, wb: no IMU of NaveGo")
    receiver, reference = _one("gnss", where, found["gnss"]), _one("truth", where, found["truth"])
    used = [one.path for one in (device, receiver, reference) if one is not None]
    return VehicleRecording(
        name=device.name,
        kind="navego",
        files=tuple(dict.fromkeys(used)),
        increments=_increments(device),
        fixes=None if receiver is None else _fixes(receiver),
        reference=None if reference is None else _reference(reference),
        beginning=_beginning(device),
        gyros=_noise(device, "arw", "gb_sta", "gb_dyn", "gb_corr"),
        accelerometers=_noise(device, "vrw", "ab_sta", "ab_dyn", "ab_corr"),
    )
