"""What a run came to: errors against the truth, as numbers, a table of rows and a summary."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from firmware_py.earth import radii
from firmware_py.memory import NAVIGATION
from host_tools.errors import RehearsalError
from host_tools.hardware.memory import INNER, OUTER, TRUTH
from host_tools.rows import read_rows
from host_tools.sides import NAVIGATION_ROWS, TRUTH_ROWS

Vector = NDArray[np.float64]

_radii = getattr(radii, "py_func", radii)  # one call is not worth the compiler's start


@dataclass(frozen=True)
class Errors:
    """Navigation minus truth, sampled over a run; each array of shape (n,).

    Times count from the beginning of navigation.
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

    def __len__(self) -> int:
        return len(self.epoch)

    @property
    def sample_interval_s(self) -> float:
        """Time between two samples."""
        return float(self.time_s[1] - self.time_s[0]) if len(self) > 1 else 0.0

    def largest(self) -> dict[str, Any]:
        """Return the figures that people ask for first, by their names in the summary."""
        if not len(self):
            return {
                "max_abs_velocity_error_mps": None,
                "max_abs_position_error_m": None,
                "end_position_error_m": None,
            }
        end = np.hypot(self.position_east_m[-1], self.position_north_m[-1])
        return {
            "max_abs_velocity_error_mps": {
                "east": float(np.max(np.abs(self.velocity_east_mps))),
                "north": float(np.max(np.abs(self.velocity_north_mps))),
            },
            "max_abs_position_error_m": {
                "east": float(np.max(np.abs(self.position_east_m))),
                "north": float(np.max(np.abs(self.position_north_m))),
            },
            "end_position_error_m": float(end),
        }


def _angle_deg(difference: Vector) -> Vector:
    """Return angles in degrees, from radians, in (-180, 180]."""
    return np.degrees((difference + np.pi) % (2 * np.pi) - np.pi)


def east_north_m(
    latitude: Any, longitude: Any, true_latitude: Any, true_longitude: Any, height: Any
) -> tuple[Any, Any]:
    """Return the distance east and north (m) of a place from the true one; angles in rad."""
    meridian, prime_vertical = _radii(float(np.mean(true_latitude)))
    difference = (longitude - true_longitude + np.pi) % (2 * np.pi) - np.pi
    east = difference * (prime_vertical + height) * np.cos(true_latitude)
    return east, (latitude - true_latitude) * (meridian + height)


def compare(navigation: NDArray[Any], truth: NDArray[Any], rate_hz: int) -> Errors:
    """Return the errors in the epochs that both logs have.

    Parameters
    ----------
    navigation : array of dtype `firmware_py.memory.NAVIGATION`
    truth : array of dtype `host_tools.hardware.memory.TRUTH`
    """
    epochs, ours, theirs = np.intersect1d(
        navigation["epoch"], truth["epoch"], assume_unique=True, return_indices=True
    )
    nav, true = navigation[ours], truth[theirs]
    if len(epochs):
        east, north = east_north_m(
            nav["latitude"],
            nav["longitude"],
            true["latitude"],
            true["longitude"],
            true["height"],
        )
    else:
        east = north = np.zeros(0)
    first = epochs[0] if len(epochs) else 0
    velocity = nav["velocity_n"] - true["velocity_n"]
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
    )


def read_errors(folder: Path, rate_hz: int) -> Errors:
    """Return the errors from the logs that the two sides left in a folder."""
    navigation = read_rows(folder / NAVIGATION_ROWS, NAVIGATION)
    truth = read_rows(folder / TRUTH_ROWS, TRUTH)
    return compare(navigation, truth, rate_hz)


@contextmanager
def taking_place(path: Path) -> Iterator[Path]:
    """Give the path of a file that takes the place of `path` when it has been written.

    Raises
    ------
    RehearsalError
        When it cannot be written; what was at `path` before is there still.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        yield part
        part.replace(path)
    except OSError as error:
        raise RehearsalError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)


def write_whole(path: Path, write: Callable[[IO[str]], None]) -> None:
    """Write a text file so that it is there whole or not at all.

    Raises
    ------
    RehearsalError
        When it cannot be written.
    """
    with taking_place(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        write(file)


_COLUMNS = (
    ("time_s", "%.3f"),
    ("position_east_m", "%.6g"),
    ("position_north_m", "%.6g"),
    ("height_m", "%.6g"),
    ("velocity_east_mps", "%.6g"),
    ("velocity_north_mps", "%.6g"),
    ("roll_deg", "%.6g"),
    ("pitch_deg", "%.6g"),
    ("heading_deg", "%.6g"),
    ("inner_deg", "%.6f"),
    ("outer_deg", "%.6f"),
)


def write_errors(path: Path, errors: Errors) -> None:
    """Write the errors as a CSV file with a column for each, units in the names."""
    names = ["epoch", *(name for name, _ in _COLUMNS)]
    columns = [errors.epoch.tolist()]
    for name, spec in _COLUMNS:
        columns.append([spec % value for value in getattr(errors, name).tolist()])

    def write(file: IO[str]) -> None:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(zip(*columns, strict=True))

    write_whole(path, write)


def write_summary(path: Path, summary: dict[str, Any]) -> None:
    """Write a summary as JSON."""

    def write(file: IO[str]) -> None:
        file.write(json.dumps(summary, indent=2) + "\n")

    write_whole(path, write)
