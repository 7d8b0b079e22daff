"""Plots of the page: columns of numbers over bus time, from the bus and from the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from rrins.compiled.record import Floats, Integers
from rrins.dbc.codec import load
from rrins.host_tools.dashboard.truth import Truth
from rrins.host_tools.files import JsonObject
from rrins.host_tools.runs.results.results import east_north_m

_SIGNALS: Final = {
    "inner_deg": ("AXIS_INNER_STATUS", "encoder_angle_deg"),
    "outer_deg": ("AXIS_OUTER_STATUS", "encoder_angle_deg"),
    "inner_dps": ("AXIS_INNER_STATUS", "encoder_rate_dps"),
    "outer_dps": ("AXIS_OUTER_STATUS", "encoder_rate_dps"),
    "sigma_east_m": ("ESTIMATOR_POSITION", "east_sigma"),
    "sigma_north_m": ("ESTIMATOR_POSITION", "north_sigma"),
    "sigma_up_m": ("ESTIMATOR_POSITION", "up_sigma"),
    "sigma_east_mps": ("ESTIMATOR_VELOCITY", "east_sigma"),
    "sigma_north_mps": ("ESTIMATOR_VELOCITY", "north_sigma"),
    "sigma_up_mps": ("ESTIMATOR_VELOCITY", "up_sigma"),
    "horizontal_protection_m": ("INTEGRITY", "horizontal_protection"),
    "gyro_parity": ("GYRO_REDUNDANCY", "parity_ratio"),
    "accelerometer_parity": ("ACCELEROMETER_REDUNDANCY", "parity_ratio"),
    "gyro_suspect": ("GYRO_REDUNDANCY", "suspect"),
    "accelerometer_suspect": ("ACCELEROMETER_REDUNDANCY", "suspect"),
    "gyro_redundant": ("GYRO_REDUNDANCY", "redundant"),
    "accelerometer_redundant": ("ACCELEROMETER_REDUNDANCY", "redundant"),
    "gyro_window_log2": ("GYRO_REDUNDANCY", "window_log2"),
    "accelerometer_window_log2": ("ACCELEROMETER_REDUNDANCY", "window_log2"),
    "firmware_load_percent": ("FIRMWARE_STATUS", "load_percent"),
    "roll_deg": ("NAV_ATTITUDE", "roll_deg"),
    "pitch_deg": ("NAV_ATTITUDE", "pitch_deg"),
    "heading_deg": ("NAV_ATTITUDE", "heading_deg"),
    "height_m": ("NAV_HEIGHT", "height"),
}
"""Quantities that are signals."""

_NEEDED: Final = {
    "estimated_gyro": ("ESTIMATOR_GYRO", "sensor"),
    "estimated_bias_dph": ("ESTIMATOR_GYRO", "bias"),
    "estimated_sigma_dph": ("ESTIMATOR_GYRO", "bias_sigma"),
    "sync_epoch": ("SYNC", "epoch"),
    "latitude_epoch": ("NAV_LATITUDE", "epoch"),
    "longitude_epoch": ("NAV_LONGITUDE", "epoch"),
    "latitude_deg": ("NAV_LATITUDE", "latitude_deg"),
    "longitude_deg": ("NAV_LONGITUDE", "longitude_deg"),
    "velocity_east": ("NAV_VELOCITY", "velocity_east"),
    "velocity_north": ("NAV_VELOCITY", "velocity_north"),
    "velocity_up": ("NAV_HEIGHT", "velocity_up"),
    "position": ("FIRMWARE_STATUS", "scheme_position"),
    "cycle": ("FIRMWARE_STATUS", "scheme_cycle"),
}
"""Signals from which others are computed."""

ERRORS: Final = (
    "error_east_m",
    "error_north_m",
    "error_up_m",
    "error_east_mps",
    "error_north_mps",
    "error_up_mps",
)
"""Navigation minus truth."""

_PLACES: Final = ("east_m", "north_m", "true_east_m", "true_north_m")
_GOALS: Final = ("inner_goal_deg", "outer_goal_deg")
_OF_BUS: Final = ("bus_load_percent", "lateness_ms")
_GYROS: Final = 6
_BIASES: Final = tuple(
    f"{what}_{k}_dph" for k in range(1, _GYROS + 1) for what in ("gyro_bias", "sigma_gyro_bias")
)

NAMES: Final = (*_SIGNALS, *ERRORS, *_PLACES, *_GOALS, *_BIASES, *_OF_BUS)
"""The columns, in the order in which they are sent; each name ends with its unit, if it has one."""

_PLACE_OF: Final = {name: place for place, name in enumerate(NAMES)}
_FIRST_BIAS: Final = _PLACE_OF[_BIASES[0]]
_PARITIES: Final = tuple(
    (_PLACE_OF[f"{kind}_parity"], _PLACE_OF[f"{kind}_redundant"])
    for kind in ("gyro", "accelerometer")
)
_FIRMWARE_LOAD, _HEIGHT = _PLACE_OF["firmware_load_percent"], _PLACE_OF["height_m"]
_EPOCHS: Final = 1 << 24  # of SYNC
_NAV_EPOCHS: Final = 4096  # of the navigation output


def rows_of(signals: dict[str, tuple[str, str]]) -> Integers:
    """Return the rows of signals in the codec's table."""
    codec = load()
    return np.array([codec.signal_index(*signal) for signal in signals.values()], dtype=np.int64)


SAMPLED: Final = _SIGNALS | _NEEDED
"""All signals that a row is computed from, in order."""


def facts() -> JsonObject:
    """Return what a page needs to compute rows itself."""
    return {
        "signals": rows_of(_SIGNALS).tolist(),
        "needed": dict(zip(_NEEDED, rows_of(_NEEDED).tolist(), strict=True)),
        "errors": len(ERRORS) + len(_PLACES),
        "gyros": _GYROS,
        "epochs": _EPOCHS,
        "nav_epochs": _NAV_EPOCHS,
    }


@dataclass(frozen=True)
class SchemeAngles:
    """Where the scheme wants the axes."""

    #: shape (positions, 2); angles of the inner and the outer axis in each position, in the first
    #: cycle
    held_deg: Floats
    cycle_deg: Floats  #: shape (2,); by how much a whole cycle turns them

    def at(self, position: float, cycle: float) -> Floats:
        """Return the angles to which the turn of a position, from 1, leads; NaN for none."""
        place = 0 if math.isnan(position) else int(position)
        if not 1 <= place <= len(self.held_deg):
            return np.full(2, np.nan)
        return np.asarray(self.held_deg[place - 1] + cycle * self.cycle_deg)


class Quantities:
    """Computes rows of quantities.

    Parameters
    ----------
    truth : Truth or None
        What is known beside the bus; None for nothing.
    scheme : SchemeAngles or None
    """

    def __init__(self, truth: Truth | None, scheme: SchemeAngles | None) -> None:
        self._truth = truth
        self._scheme = scheme
        self._origin: tuple[float, float] | None = None
        self._errors = np.full(len(ERRORS) + len(_PLACES), np.nan)
        self._biases = np.full(len(_BIASES), np.nan)
        self._nav_epoch = -1

    def forget(self) -> None:
        """Forget the latest output; the first place stays."""
        self._errors[:] = np.nan
        self._biases[:] = np.nan
        self._nav_epoch = -1

    def row(self, sampled: Floats, bus_load_percent: float, lateness_ms: float) -> Floats:
        """Return a row, in the order of `NAMES`; NaN for what is not known.

        Parameters
        ----------
        sampled : array
            Values of `SAMPLED`.
        bus_load_percent, lateness_ms : float
        """
        first = len(_SIGNALS)
        found = dict(zip(_NEEDED, sampled[first:].tolist(), strict=True))
        row = np.full(len(NAMES), np.nan)
        row[:first] = sampled[:first]
        if not row[_FIRMWARE_LOAD]:  # a loop without a clock
            row[_FIRMWARE_LOAD] = math.nan
        for parity, redundant in _PARITIES:
            if not row[redundant]:  # nothing is compared, which is not agreement
                row[parity] = math.nan
        self._follow_biases(found)
        row[_FIRST_BIAS : _FIRST_BIAS + len(_BIASES)] = self._biases
        self._follow(found, float(row[_HEIGHT]))
        row[first : first + len(self._errors)] = self._errors
        if self._scheme is not None:
            goal = _PLACE_OF[_GOALS[0]]
            row[goal : goal + 2] = self._scheme.at(found["position"], found["cycle"])
        row[_PLACE_OF["bus_load_percent"]] = bus_load_percent
        row[_PLACE_OF["lateness_ms"]] = lateness_ms
        return row

    def _follow_biases(self, found: dict[str, float]) -> None:
        """Keep the estimate of each gyro: every message reports another one."""
        sensor = found["estimated_gyro"]
        if 1 <= sensor <= _GYROS:
            place = 2 * (int(sensor) - 1)
            self._biases[place] = found["estimated_bias_dph"]
            self._biases[place + 1] = found["estimated_sigma_dph"]

    def _follow(self, found: dict[str, float], height_m: float) -> None:
        """Compute errors and places of a new output; both halves must be of the same epoch."""
        at = found["latitude_epoch"]
        if math.isnan(at) or at != found["longitude_epoch"] or math.isnan(found["sync_epoch"]):
            return
        sync = int(found["sync_epoch"])
        epoch = (sync - (sync - int(at)) % _NAV_EPOCHS) % _EPOCHS
        if epoch == self._nav_epoch:
            return
        self._nav_epoch = epoch
        latitude, longitude = (math.radians(found[f"{n}_deg"]) for n in ("latitude", "longitude"))
        if self._truth is None:
            self._origin = self._origin or (latitude, longitude)
            east, north = east_north_m(latitude, longitude, *self._origin, height_m)
            self._errors[len(ERRORS) : len(ERRORS) + 2] = east, north
            return
        truth = self._truth.at(epoch)
        height = truth.height
        error = east_north_m(latitude, longitude, truth.latitude, truth.longitude, height)
        velocity = np.array([found[f"velocity_{way}"] for way in ("east", "north", "up")])
        moved = self._truth.moved(truth)
        self._errors[:] = (
            *error,
            height_m - height,
            *(velocity - truth.velocity_n),
            *(moved[0] + error[0], moved[1] + error[1]),
            *moved,
        )
