"""Checks of the navigation: against our own firmware on the same scenario and seed."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rrins.host_tools.conformance.check import Check, Subject
from rrins.host_tools.runs.results.results import east_north_m
from rrins.host_tools.testing.bench import Bench

SCENARIOS: Final = (
    "ideal",
    "rimu_rotating",
    "rimu_strapdown",
    "imu_rotating",
    "imu_strapdown",
    "imu_strapdown_self_aligned",
    "drive_strapdown",
    "drive_rotating",
)
"""Rest and motion, four sensors and three, with and without rotation, given and found attitude."""

DURATION_S: Final = 20.0
LIMIT_M: Final = 0.05
LIMIT_MPS: Final = 0.005
_AS_IT_IS: Final[dict[str, Any]] = {"firmware": {}, "duration_s": 3600.0}


def check_of(scenario: str) -> Check:
    """Return the check of a short run of a scenario."""
    rule = (
        f"Over {DURATION_S:g} s of `{scenario}` the position is within {LIMIT_M:g} m of the "
        "reference."
    )
    name = f"navigation-{scenario.replace('_', '-')}"
    return Check(name, rule, "firmware.md#strapdown", partial(_navigation, name=scenario))


def _navigation(subject: Subject, name: str) -> None:
    """Compare position and velocity, frame by frame."""
    ours = _navigated(subject.reference(name, **_AS_IT_IS))
    theirs = _navigated(subject.bench(name, **_AS_IT_IS))
    assert len(theirs) == len(ours), (
        f"{len(theirs)} NAV_ frames of each kind in {DURATION_S:g} s, not {len(ours)}"
    )
    places = np.radians(np.column_stack([theirs[:, :2], ours[:, :2]])).T
    east, north = east_north_m(places[0], places[1], places[2], places[3], np.zeros(len(ours)))
    distance = np.hypot(east, north)
    worst = int(np.argmax(distance))
    assert distance[worst] <= LIMIT_M, (
        f"position {distance[worst]:.3g} m from the reference at {ours[worst, 4]:.1f} s, "
        f"at most {LIMIT_M:g} m"
    )
    speed = float(np.abs(theirs[:, 2:4] - ours[:, 2:4]).max())
    assert speed <= LIMIT_MPS, f"velocity {speed:.3g} m/s off, at most {LIMIT_MPS:g} m/s"


def _navigated(bench: Bench) -> NDArray[np.float64]:
    """Return latitude, longitude (deg), velocity east, north (m/s) and time (s) of each output."""
    bench.advance(bench.scenario.navigation_epoch * bench.scenario.period_ns / 1e9 + DURATION_S)
    parts = (
        ("NAV_LATITUDE", "latitude_deg"),
        ("NAV_LONGITUDE", "longitude_deg"),
        ("NAV_VELOCITY", "velocity_east"),
        ("NAV_VELOCITY", "velocity_north"),
        ("NAV_LATITUDE", "time_s"),
    )
    columns = [[float(one[signal]) for one in bench.messages(name)] for name, signal in parts]
    count = min(map(len, columns))
    assert count > 0, "it does not navigate"
    return np.array([column[-count:] for column in columns]).T
