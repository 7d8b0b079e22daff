"""Cost of the estimator: the firmware's step with and without it, and pyins' filter beside it.

All navigate the same drive, aided by GNSS. pyins (PyPI: python-ins) is a package of its own; where
it is not installed, its figure is null and a reason says so.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from rrins.compiled.record import Integers
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.benchmarks.timed_epochs import timed_epochs, timer_overhead_ns
from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario, load
from rrins.host_tools.vehicle.fused import FusedTrack, fused_of_scenario

SCENARIO = "drive_aided"
RATE_HZ = 400

_FAULT_AT_S = 8.0
"""Since power-on: when a gyro of the case with faults begins to fail."""

_NED = [1, 0, 2]
_POSITION_SIGMA_M, _VELOCITY_SIGMA_MPS = 1.5, 0.05
_GYRO_BIAS_SD = math.radians(0.1) / 3600
_ACCELEROMETER_BIAS_SD = 1e-3


@dataclass(frozen=True)
class Case:
    """A set-up of the firmware whose step is measured."""

    name: str
    label: str
    estimates: bool = True
    compares: bool = False
    fails: bool = False
    bounds: bool = False


CASES = (
    Case("plain", "step at 400 Hz, no filter", estimates=False),
    Case("filter", "with the filter"),
    Case("filter_bank_faults", "with filter, bank and a fault", compares=True, fails=True),
    Case("integrity", "the same, with bounds", compares=True, fails=True, bounds=True),
)


def scenario_of(case: Case, duration_s: float) -> Scenario:
    """Return the scenario of a case: a drive with GNSS and an odometer, the table turning."""
    fault = {"kind": "gyro_bias", "sensor": 2, "at_s": _FAULT_AT_S, "bias_dph": 200.0}
    return load(
        SCENARIO,
        duration_s=duration_s,
        rate_hz=RATE_HZ,
        faults=[fault] if case.fails else [],
        integrity={"enabled": case.bounds},
    ).varied(estimator__enabled=case.estimates, redundancy__enabled=case.compares)


def steps_us(samples: int) -> JsonObject:
    """Return median, p99 and largest µs of the firmware's step for each case, and its epochs.

    Each step is called from Python, as the shells do. Times are the thread's own: what else the
    machine does is not in them. `overruns` counts those beyond a period.
    """
    found: JsonObject = {}
    overhead_ns = timer_overhead_ns(time.thread_time_ns)
    for case in CASES:
        took_ns = _took_ns(scenario_of(case, 30 + samples / RATE_HZ), samples) - overhead_ns
        median, p99 = np.percentile(took_ns, (50, 99)) / 1000
        found[case.name] = {
            "median": float(median),
            "p99": float(p99),
            "max": float(took_ns.max() / 1000),
            "mean": float(took_ns.mean() / 1000),
            "overruns": int(np.count_nonzero(took_ns > 1e9 / RATE_HZ)),
            "epochs": samples,
        }
    return found | {"half_period_us": 0.5e6 / RATE_HZ}


def _took_ns(scenario: Scenario, samples: int) -> Integers:
    """Return how long each call of the firmware's step took, in navigation."""
    firmware = Firmware(firmware_settings(scenario))
    hardware = Hardware(hardware_settings(scenario))
    timed = timed_epochs(firmware, hardware, scenario.epochs, time.thread_time_ns)
    navigating = (one.firmware_ns for one in timed if one.epoch > scenario.navigation_epoch)
    return np.fromiter(itertools.islice(navigating, samples), np.int64)


def pyins_us(duration_s: float) -> tuple[float | None, str | None]:
    """Return the µs per epoch of pyins' feedback filter on the fused increments of such a drive.

    Fixes come once a second, as the firmware's; only the filter is timed, by its own time. The
    table is locked: pyins knows none. The second value says why there is none.
    """
    try:
        import pandas as pd
        from pyins import filters, inertial_sensor, measurements, strapdown
    except ImportError as error:
        return None, f"needs `pip install python-ins`: {error}"
    scenario = scenario_of(CASES[0], duration_s).varied(mode="strapdown")
    imu, trajectory = _frames(pd, fused_of_scenario(scenario), RATE_HZ)
    increments = strapdown.compute_increments_from_imu(imu, "increment")
    fixes = trajectory.iloc[RATE_HZ::RATE_HZ]
    models = (
        inertial_sensor.EstimationModel(bias_sd=_GYRO_BIAS_SD, noise=1.5e-6),
        inertial_sensor.EstimationModel(bias_sd=_ACCELEROMETER_BIAS_SD, noise=1e-4),
    )
    aids = [
        measurements.Position(fixes, _POSITION_SIGMA_M),
        measurements.NedVelocity(fixes, _VELOCITY_SIGMA_MPS),
    ]
    begin_s = time.process_time()
    filters.run_feedback_filter(
        trajectory.iloc[0],
        _POSITION_SIGMA_M,
        _VELOCITY_SIGMA_MPS,
        0.01,
        0.1,
        increments,
        *models,
        measurements=aids,
        time_step=1.0,
    )
    return (time.process_time() - begin_s) * 1e6 / len(increments), None


def _frames(pd: Any, tracks: Iterator[FusedTrack], rate_hz: int) -> tuple[Any, Any]:
    """Return increments and truth as pyins has them: forward, right, down; north, east, down."""
    found = list(tracks)
    increments = np.concatenate([track.increments for track in found])
    truth = np.concatenate([track.truth for track in found if track.truth is not None])
    time_s = pd.Index(increments["epoch"] / rate_hz, name="time")
    down = np.array([1.0, 1.0, -1.0])
    imu = np.hstack([increments["dtheta_s"][:, _NED] * down, increments["dv_s"][:, _NED] * down])
    names = [f"{kind}_{axis}" for kind in ("gyro", "accel") for axis in "xyz"]
    velocity = truth["velocity_n"][:, _NED] * down
    columns = {
        "lat": np.degrees(truth["latitude"]),
        "lon": np.degrees(truth["longitude"]),
        "alt": truth["height"],
        "VN": velocity[:, 0],
        "VE": velocity[:, 1],
        "VD": velocity[:, 2],
        **{name: np.degrees(truth[name]) for name in ("roll", "pitch", "heading")},
    }
    return pd.DataFrame(imu, index=time_s, columns=names), pd.DataFrame(columns, index=time_s)


def measure(samples: int, pyins_s: float) -> JsonObject:
    """Return the entries of `rrins bench` on the estimator."""
    ours = steps_us(samples)
    theirs, reason = pyins_us(pyins_s)
    ratio = None if theirs is None else theirs / ours["filter"]["mean"]
    return {
        "estimator_step_us": ours,
        "pyins_filter_us": theirs,
        "pyins_filter_reason": reason,
        "pyins_over_step": ratio,
    }
