"""Checks that all readers of vehicle recordings share."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.vehicle.errors import VehicleError


def located(path: Path, text: str) -> VehicleError:
    """Return an error that names the file."""
    return VehicleError(f"import {path}: {text}")


def numbers(path: Path) -> Floats:
    """Return the table of a text file of numbers, shape (rows, columns).

    Columns are separated by spaces, tabs or commas; lines that begin with # or % are comments.

    Raises
    ------
    VehicleError
        If it cannot be read, or is not a table of numbers.
    """
    if not path.is_file():
        raise located(path, "no such file")
    try:
        with path.open(encoding="utf-8") as file:
            lines = (line.replace(",", " ") for line in file)
            table = np.loadtxt(lines, dtype=np.float64, comments=("#", "%"), ndmin=2)
    except UnicodeDecodeError as error:
        raise located(path, "is not text") from error
    except (OSError, ValueError) as error:
        raise located(path, f"is not a table of numbers: {error}") from error
    if not len(table):
        raise located(path, "has no rows")
    return table


def increasing(path: Path, time_s: Floats) -> None:
    """Raise VehicleError unless times are finite and increase."""
    wrong = np.flatnonzero(~np.isfinite(time_s[1:]) | (np.diff(time_s) <= 0))
    if not np.isfinite(time_s[0]) or len(wrong):
        row = int(wrong[0]) + 2 if len(wrong) else 1
        raise located(path, f"row {row}: its time does not follow that of the row before")


def finite(path: Path, what: str, values: Floats) -> None:
    """Raise VehicleError unless all values are finite; shape (rows, columns)."""
    wrong = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(wrong):
        raise located(path, f"row {int(wrong[0]) + 1}: {what} is not a number")


def on_earth(path: Path, place: Floats) -> None:
    """Raise VehicleError unless latitudes and longitudes (rad) are possible."""
    wrong = (np.abs(place[:, 0]) >= np.pi / 2) | (np.abs(place[:, 1]) > 2 * np.pi)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0]) + 1
        raise located(path, f"row {row}: no place on Earth; is it in other units or columns?")
