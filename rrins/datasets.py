"""Results of a run as `xarray.Dataset`: coordinates, units and long names as attributes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rrins.compiled.record import Floats, Integers, Records
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.records.memory import NavigationOutput
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.motion.trajectory import ATTITUDE, PLACE, VELOCITY_N, Trajectory

if TYPE_CHECKING:
    import xarray as xr

    from rrins.host_tools.runs.run import RunResult

_AXES = ["east", "north", "up"]
_ANGLES = ["roll", "pitch", "heading"]


def _xarray() -> type[xr.Dataset]:
    try:
        from xarray import Dataset
    except ImportError as error:
        raise RehearsalError(
            "results as datasets need xarray and pandas: pip install xarray pandas"
        ) from error
    return Dataset


def _dataset(
    result: RunResult, title: str, variables: dict[str, tuple[list[str], Floats, str, str]]
) -> xr.Dataset:
    """Return a dataset over the time of a run; a variable is dimensions, values, unit, name."""
    dimensions = {name for dims, *_ in variables.values() for name in dims}
    coordinates = {
        "time": (
            "time",
            result.errors.time_s,
            {"units": "s", "long_name": "time since navigation began"},
        ),
        "epoch": ("time", result.errors.epoch, {"long_name": "epoch"}),
        "axis": ("axis", _AXES),
        "angle": ("angle", _ANGLES),
        "table_axis": ("table_axis", ["inner", "outer"]),
    }
    kept = {n: c for n, c in coordinates.items() if n == "epoch" or n in dimensions}
    data = {
        name: (dims, values, {"units": unit, "long_name": long})
        for name, (dims, values, unit, long) in variables.items()
    }
    return _xarray()(data, kept, {"title": f"{result.title}: {title}"})


def _attitude_deg(records: Records[NavigationOutput] | Records[Truth]) -> Floats:
    return np.degrees(np.stack([records[name] for name in _ANGLES], axis=1))


def data_array(name: str, time_s: Floats, values: Floats | Integers, unit: str) -> xr.DataArray:
    """Return a signal over the time of a log."""
    time = ("time", time_s, {"units": "s", "long_name": "time"})
    dataset = _xarray()({name: (["time"], values, {"units": unit})}, {"time": time})
    return dataset[name]


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
) -> dict[str, tuple[list[str], Floats, str, str]]:
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
