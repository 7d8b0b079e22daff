"""Results of a run: errors against the truth, as numbers, a table of rows and a summary."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import IO, TypeVar

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Records
from rrins.firmware_py.core.maths.earth import radii
from rrins.firmware_py.core.records.memory import NavigationOutput
from rrins.host_tools.files import JsonObject, write_whole
from rrins.host_tools.hardware.memory import INNER, OUTER, Truth
from rrins.host_tools.runs.results.samples import NAVIGATION_SAMPLES, TRUTH_SAMPLES, read_samples
from rrins.host_tools.runs.results.summary_types import AnySummary

Vector = NDArray[np.float64]
_T = TypeVar("_T", float, Vector)

_radii = getattr(radii, "py_func", radii)  # one call is not worth the compiler's start


@dataclass(frozen=True)
class Errors:
    """Navigation minus truth, sampled over a run; each array of shape (n,).

    Times count since navigation began.
    """

    epoch: NDArray[np.int64]
    time_s: Vector
    position_east_m: Vector
    position_north_m: Vector
    height_m: Vector
    velocity_east_mps: Vector
    velocity_north_mps: Vector
    roll_deg: Vector
    pitch_deg: Vector
    heading_deg: Vector
    inner_deg: Vector
    """True angle of the inner axis."""
    outer_deg: Vector
    turn_east_arcsec: Vector
    """About east, from the true to the navigated attitude, to first order."""
    turn_north_arcsec: Vector
    turn_up_arcsec: Vector

    def __len__(self) -> int:
        return len(self.epoch)

    @property
    def sample_interval_s(self) -> float:
        """Time between two samples."""
        return float(self.time_s[1] - self.time_s[0]) if len(self) > 1 else 0.0

    def largest(self) -> JsonObject:
        """Return the figures that people ask for first, by their names in the summary."""
        names = ("velocity_error_mps", "position_error_m")
        if not len(self):
            return {f"max_abs_{name}": None for name in names} | {"end_position_error_m": None}
        found: JsonObject = {}
        for name in names:
            what, unit = name.split("_error_")
            sides = {side: getattr(self, f"{what}_{side}_{unit}") for side in ("east", "north")}
            found[f"max_abs_{name}"] = {
                side: float(np.max(np.abs(values))) for side, values in sides.items()
            }
        end = np.hypot(self.position_east_m[-1], self.position_north_m[-1])
        return found | {"end_position_error_m": float(end)}


def _angle_deg(difference: Vector) -> Vector:
    """Return angles in degrees, from radians, in (-180, 180]."""
    return np.degrees((difference + np.pi) % (2 * np.pi) - np.pi)


def _turn_arcsec(
    nav: Records[NavigationOutput], true: Records[Truth]
) -> tuple[Vector, Vector, Vector]:
    """Return the turn about east, north and up by which the navigated attitude is off.

    To first order, of ``C_b_n = Rz(-heading) Rx(pitch) Ry(roll)``.
    """
    roll, pitch, heading = (
        3600.0 * _angle_deg(nav[name] - true[name]) for name in ("roll", "pitch", "heading")
    )
    along = roll * np.cos(true["pitch"])
    cosine, sine = np.cos(true["heading"]), np.sin(true["heading"])
    east, north = pitch * cosine + along * sine, along * cosine - pitch * sine
    return east, north, roll * np.sin(true["pitch"]) - heading


def east_north_m(
    latitude: _T, longitude: _T, true_latitude: _T, true_longitude: _T, height: _T
) -> tuple[_T, _T]:
    """Return the distance east and north (m) of a place from the true one; angles in rad."""
    meridian, prime_vertical = _radii(float(np.mean(true_latitude)))
    difference = (longitude - true_longitude + np.pi) % (2 * np.pi) - np.pi
    east = difference * (prime_vertical + height) * np.cos(true_latitude)
    return east, (latitude - true_latitude) * (meridian + height)


def compare(navigation: Records[NavigationOutput], truth: Records[Truth], rate_hz: int) -> Errors:
    """Return the errors in the epochs that both logs have.

    Parameters
    ----------
    navigation : array of dtype `rrins.firmware_py.core.records.memory.NavigationOutput`
    truth : array of dtype `rrins.host_tools.hardware.memory.Truth`
    """
    nav, true = in_common(navigation, truth)
    epochs = nav["epoch"]
    if len(epochs):
        here, there = ((log["latitude"], log["longitude"]) for log in (nav, true))
        east, north = east_north_m(*here, *there, true["height"])
    else:
        east = north = np.zeros(0)
    first = epochs[0] if len(epochs) else 0
    velocity = nav["velocity_n"] - true["velocity_n"]
    turn = _turn_arcsec(nav, true)
    return Errors(
        epoch=epochs,
        time_s=(epochs - first) / rate_hz,
        position_east_m=east,
        position_north_m=north,
        height_m=nav["height"] - true["height"],
        velocity_east_mps=velocity[:, 0],
        velocity_north_mps=velocity[:, 1],
        roll_deg=_angle_deg(nav["roll"] - true["roll"]),
        pitch_deg=_angle_deg(nav["pitch"] - true["pitch"]),
        heading_deg=_angle_deg(nav["heading"] - true["heading"]),
        inner_deg=np.degrees(true["axis_angle"][:, INNER]),
        outer_deg=np.degrees(true["axis_angle"][:, OUTER]),
        turn_east_arcsec=turn[0],
        turn_north_arcsec=turn[1],
        turn_up_arcsec=turn[2],
    )


def read_errors(folder: Path, rate_hz: int) -> Errors:
    """Return the errors from the samples that the two sides left in a folder."""
    navigation = read_samples(folder / NAVIGATION_SAMPLES, NavigationOutput)
    return compare(navigation, read_samples(folder / TRUTH_SAMPLES, Truth), rate_hz)


def read_samples_of(folder: Path) -> tuple[Records[NavigationOutput], Records[Truth]]:
    """Return navigation and truth in the epochs that both have, and remove their files."""
    navigation = read_samples(folder / NAVIGATION_SAMPLES, NavigationOutput)
    truth = read_samples(folder / TRUTH_SAMPLES, Truth)
    for name in (NAVIGATION_SAMPLES, TRUTH_SAMPLES):
        (folder / name).unlink(missing_ok=True)
    return in_common(navigation, truth)


def in_common(
    navigation: Records[NavigationOutput], truth: Records[Truth]
) -> tuple[Records[NavigationOutput], Records[Truth]]:
    """Return the records of the epochs that both have."""
    _, ours, theirs = np.intersect1d(
        navigation["epoch"], truth["epoch"], assume_unique=True, return_indices=True
    )
    return navigation[ours], truth[theirs]


_FORMATS = {"time_s": "%.3f", "inner_deg": "%.6f", "outer_deg": "%.6f"}
_COLUMNS = {
    field.name: _FORMATS.get(field.name, "%.6g")
    for field in fields(Errors)
    if field.name != "epoch" and not field.name.startswith("turn_")
}


def columns_of(errors: Errors) -> dict[str, NDArray[np.float64] | NDArray[np.int64]]:
    """Return the errors as columns, units in their names."""
    return {"epoch": errors.epoch} | {name: getattr(errors, name) for name in _COLUMNS}


def write_errors(path: Path, errors: Errors) -> None:
    """Write the errors as a CSV file with a column for each, units in the names."""
    columns = [
        [_COLUMNS.get(name, "%d") % value for value in values.tolist()]
        for name, values in columns_of(errors).items()
    ]

    def write(file: IO[str]) -> None:
        writer = csv.writer(file)
        writer.writerow(columns_of(errors))
        writer.writerows(zip(*columns, strict=True))

    write_whole(path, write)


def write_summary(path: Path, summary: AnySummary) -> None:
    """Write a summary as JSON."""

    def write(file: IO[str]) -> None:
        file.write(json.dumps(summary, indent=2) + "\n")

    write_whole(path, write)
