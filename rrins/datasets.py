"""Results of a run as `xarray.Dataset`: coordinates, units and long names as attributes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rrins.compiled.record import Floats, Integers, Records, Words
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.records.estimator_records import EstimatorSecond
from rrins.firmware_py.core.records.memory import NavigationOutput
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.hardware.units import DPH, UG
from rrins.host_tools.logs.signals import SignalOfMessage
from rrins.host_tools.motion.trajectory import ATTITUDE, PLACE, VELOCITY_N, Trajectory
from rrins.host_tools.vehicle.sensor_increments import sensors_of_scenario

if TYPE_CHECKING:
    import xarray as xr

    from rrins.host_tools.runs.run import RunResult

_AXES = ["east", "north", "up"]
_ANGLES = ["roll", "pitch", "heading"]
_SENSOR_UNITS = (("gyro", "deg/h", DPH), ("accelerometer", "ug", UG))
_INCREMENTS = (
    ("gyro", "rad", "angle increment along the gyro's input axis"),
    ("accelerometer", "m/s", "velocity increment along the accelerometer's input axis"),
)

_Variables = dict[str, tuple[list[str], Floats, str, str]]
"""Dimensions, values, unit and long name of each variable."""


def _xarray() -> type[xr.Dataset]:
    try:
        from xarray import Dataset
    except ImportError as error:
        raise RehearsalError(
            "results as datasets need xarray and pandas: pip install xarray pandas"
        ) from error
    return Dataset


def _dataset(result: RunResult, title: str, variables: _Variables) -> xr.Dataset:
    """Return a dataset over the time of a run."""
    coordinates = _coordinates(result.errors.time_s, result.errors.epoch)
    return _labelled(f"{result.title}: {title}", variables, coordinates)


def _coordinates(time_s: Floats, epoch: Integers) -> dict[str, Any]:
    since = {"units": "s", "long_name": "time since navigation began"}
    return {
        "time": ("time", time_s, since),
        "epoch": ("time", epoch, {"long_name": "epoch"}),
        "axis": ("axis", _AXES),
        "angle": ("angle", _ANGLES),
        "table_axis": ("table_axis", ["inner", "outer"]),
    }


def _labelled(title: str, variables: _Variables, coordinates: dict[str, Any]) -> xr.Dataset:
    dimensions = {name for dims, *_ in variables.values() for name in dims}
    kept = {n: c for n, c in coordinates.items() if n == "epoch" or n in dimensions}
    data = {
        name: (dims, values, {"units": unit, "long_name": long})
        for name, (dims, values, unit, long) in variables.items()
    }
    return _xarray()(data, kept, {"title": title})


def _attitude_deg(records: Records[NavigationOutput] | Records[Truth]) -> Floats:
    return np.degrees(np.stack([records[name] for name in _ANGLES], axis=1))


def signals_over_time(
    title: str, time_s: Floats, words: Words, signals: Sequence[SignalOfMessage]
) -> xr.Dataset:
    """Return signals of a message over the time of a log, each with its unit and its choices."""
    data = {}
    for one in signals:
        flags: dict[str, Any] = {"units": one.unit, "long_name": one.comment or one.name}
        if one.choices:
            flags["flag_values"] = list(one.choices)
            flags["flag_meanings"] = " ".join(one.choices.values())
        data[one.column] = (["time"], one.values(words), flags)
    time = ("time", time_s, {"units": "s", "long_name": "time"})
    return _xarray()(data, {"time": time}, {"title": title})


def errors_of(result: RunResult) -> xr.Dataset:
    """Return navigation minus truth: `position_n`, `velocity_n`, `attitude`."""
    errors = result.errors
    position = np.stack([errors.position_east_m, errors.position_north_m, errors.height_m], axis=1)
    velocity = result.navigation["velocity_n"] - result.truth["velocity_n"]
    attitude = np.stack([errors.roll_deg, errors.pitch_deg, errors.heading_deg], axis=1)
    return _dataset(
        result,
        "navigation minus truth",
        {
            "position_n": (["time", "axis"], position, "m", "position error"),
            "velocity_n": (["time", "axis"], velocity, "m/s", "velocity error"),
            "attitude": (["time", "angle"], attitude, "deg", "attitude error"),
        },
    )


def _motion(
    records: Records[NavigationOutput] | Records[Truth],
) -> _Variables:
    return {
        "latitude": (["time"], np.degrees(records["latitude"]), "deg", "latitude"),
        "longitude": (["time"], np.degrees(records["longitude"]), "deg", "longitude"),
        "height": (["time"], records["height"], "m", "height above the ellipsoid"),
        "velocity_n": (["time", "axis"], records["velocity_n"], "m/s", "velocity"),
        "attitude": (["time", "angle"], _attitude_deg(records), "deg", "attitude of the body"),
    }


def navigation_of(result: RunResult) -> xr.Dataset:
    """Return what the firmware navigated, and the mode that it was in."""
    dataset = _dataset(result, "navigation", _motion(result.navigation))
    flags = {
        "long_name": "mode of the firmware",
        "flag_values": [int(mode) for mode in Mode],
        "flag_meanings": " ".join(mode.name for mode in Mode),
    }
    return dataset.assign(mode=("time", result.navigation["mode"], flags))


def truth_of(result: RunResult) -> xr.Dataset:
    """Return where the vehicle really was."""
    return _dataset(result, "truth", _motion(result.truth))


def turntable_of(result: RunResult) -> xr.Dataset:
    """Return the true angles of the turntable's axes."""
    angle = np.degrees(result.truth["axis_angle"])
    return _dataset(
        result,
        "turntable",
        {"angle": (["time", "table_axis"], angle, "deg", "angle of the axis")},
    )


def _since_beginning(result: RunResult, epoch: Integers) -> Floats:
    """Return epochs in seconds since navigation began."""
    first = int(result.errors.epoch[0]) if len(result.errors) else result.scenario.navigation_epoch
    return (epoch - first) / result.scenario.rate_hz


def _of_seconds(
    result: RunResult, title: str, epoch: Integers, variables: _Variables, sensors: int = 0
) -> xr.Dataset:
    """Return a dataset over epochs of its own; `sensors` count from 1."""
    time_s = _since_beginning(result, epoch)
    coordinates = _coordinates(time_s, epoch)
    coordinates["sensor"] = ("sensor", np.arange(1, sensors + 1), {"long_name": "sensor"})
    return _labelled(f"{result.title}: {title}", variables, coordinates)


def _seconds_of(result: RunResult, kept: Records[EstimatorSecond]) -> Records[EstimatorSecond]:
    if not len(kept):
        raise RehearsalError(
            f"{result.title}: the firmware estimated nothing; estimator__enabled=True lets it"
        )
    return kept


def sigma_of(result: RunResult) -> xr.Dataset:
    """Return the standard deviations of the estimator's errors, second by second."""
    kept = _seconds_of(result, result.seconds.estimates)
    dimensions = ["time", "axis"]
    turn = np.degrees(kept["attitude_sigma"])
    return _of_seconds(
        result,
        "σ of the navigation",
        kept["epoch"],
        {
            "position_n": (dimensions, kept["position_sigma"], "m", "σ of the position"),
            "velocity_n": (dimensions, kept["velocity_sigma"], "m/s", "σ of the velocity"),
            "attitude_n": (dimensions, turn, "deg", "σ of the attitude, about each axis"),
        },
    )


def estimates_of(result: RunResult) -> xr.Dataset:
    """Return what the estimator knew of the sensors, and the bounds of the errors."""
    kept = _seconds_of(result, result.seconds.estimates)
    counts = (len(result.scenario.rimu.gyros), len(result.scenario.rimu.accelerometers))
    most = max(counts)
    found: _Variables = {}
    for row, (kind, unit, si) in enumerate(_SENSOR_UNITS):
        for name, key, words in (
            ("bias", "bias", "estimated bias"),
            ("bias_sigma", "bias_sigma", "σ of the estimated bias"),
        ):
            values = kept[key][:, row, :most] / si
            values[:, counts[row] :] = np.nan
            found[f"{kind}_{name}"] = (["time", "sensor"], values, unit, f"{kind}: {words}")
    if result.scenario.integrity.enabled:
        for k, (name, unit) in enumerate((("horizontal", "m"), ("vertical", "m"))):
            words = f"{name} protection level"
            found[f"{name}_protection"] = (["time"], kept["protection"][:, k], unit, words)
        heading = np.degrees(kept["protection"][:, 2])
        found["heading_protection"] = (["time"], heading, "deg", "heading protection level")
    return _of_seconds(result, "estimates", kept["epoch"], found, most)


def parity_of(result: RunResult) -> xr.Dataset:
    """Return how the redundant sensors compare, second by second; NaN where none is compared."""
    if not result.seconds.parities:
        raise RehearsalError(
            f"{result.title}: no sensors are compared; more than three of a kind with "
            "redundancy__enabled=True are"
        )
    sets = []
    for kind, unit, si in _SENSOR_UNITS:
        kept = result.seconds.parities.get(f"{kind}s")
        if kept is None:
            continue
        count = len(getattr(result.scenario.rimu, f"{kind}s"))
        is_used = (kept["sensors"][:, None] >> np.arange(count) & 1).astype(bool)
        is_compared = np.atleast_1d(kept["threshold"].any(axis=1))
        threshold = np.where(is_compared[:, None] & is_used, kept["threshold"][:, :count], np.nan)
        residual = np.where(np.isnan(threshold), np.nan, kept["residual"][:, :count])
        ratio = np.where(is_compared, kept["ratio"], np.nan)
        each = ["time", "sensor"]
        words = f"largest parity of the {kind}s over its threshold"
        found: _Variables = {
            f"{kind}_ratio": (["time"], ratio, "1", words),
            f"{kind}_residual": (each, residual / si, unit, f"residual of the {kind}"),
            f"{kind}_threshold": (each, threshold / si, unit, f"threshold of the {kind}"),
        }
        sets.append(_of_seconds(result, "parity", kept["epoch"], found, count))
    if len(sets) == 1:
        return sets[0]
    return sets[0].merge(sets[1], compat="no_conflicts", join="outer")


def increments_of(result: RunResult) -> xr.Dataset:
    """Return the increments of each sensor in each epoch, from power-on; the run is repeated."""
    rows = sensors_of_scenario(result.scenario)
    counts = (len(result.scenario.rimu.gyros), len(result.scenario.rimu.accelerometers))
    found: _Variables = {}
    for (kind, unit, words), count in zip(_INCREMENTS, counts, strict=True):
        is_usable = rows[f"{kind}_usable"][:, None] >> np.arange(max(counts)) & 1
        values = np.where(is_usable, rows[kind][:, : max(counts)], np.nan)
        values[:, count:] = np.nan
        found[kind] = (["time", "sensor"], values, unit, words)
    return _of_seconds(result, "increments", rows["epoch"], found, max(counts))


def states_of(trajectory: Trajectory, time_s: Floats) -> xr.Dataset:
    """Return where a vehicle is, how fast and at what attitude, at some times."""
    states = trajectory.at(time_s)
    latitude, longitude, height = states[:, PLACE].T
    time = ("time", time_s, {"units": "s", "long_name": "time"})
    data = {
        "latitude": (["time"], np.degrees(latitude), {"units": "deg"}),
        "longitude": (["time"], np.degrees(longitude), {"units": "deg"}),
        "height": (["time"], height, {"units": "m"}),
        "velocity_n": (["time", "axis"], states[:, VELOCITY_N], {"units": "m/s"}),
        "attitude": (["time", "angle"], np.degrees(states[:, ATTITUDE]), {"units": "deg"}),
    }
    return _xarray()(data, {"time": time, "axis": _AXES, "angle": _ANGLES})
