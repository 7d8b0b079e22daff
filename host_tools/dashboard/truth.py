"""The truth beside the bus: where a scenario's vehicle is at an epoch."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.motion.trajectory import PLACE, VELOCITY_N
from rrins.host_tools.runs.results.results import east_north_m
from rrins.host_tools.runs.set_up.settings import first_pose, trajectory_of
from rrins.host_tools.scenario.scenario import Scenario


@dataclass(frozen=True)
class TruePlace:
    """Where the vehicle is.

    Attributes
    ----------
    latitude, longitude : float
        rad
    """

    latitude: float
    longitude: float
    height: float  #: m
    velocity_n: Floats  #: shape (3,); east, north, up, m/s


class Truth:
    """The motion of a scenario, epoch by epoch.

    Parameters
    ----------
    scenario : Scenario

    Raises
    ------
    MotionError
        When a recorded motion cannot be used.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._rate_hz = scenario.rate_hz
        self._first_epoch = scenario.navigation_epoch
        self._trajectory = trajectory_of(scenario)
        pose = first_pose(scenario)
        self._first = TruePlace(
            math.radians(pose.latitude_deg),
            math.radians(pose.longitude_deg),
            pose.height_m,
            np.zeros(3),
        )

    def at(self, epoch: int) -> TruePlace:
        """Return where the vehicle is at the end of an epoch."""
        if self._trajectory is None:
            return self._first
        seconds = (epoch - self._first_epoch) / self._rate_hz
        state = self._trajectory.at(np.array([seconds]))[0]
        latitude, longitude, height = state[PLACE].tolist()
        still = seconds < 0 or (
            self._trajectory.loop_from is None and seconds > self._trajectory.duration_s
        )
        velocity = np.zeros(3) if still else state[VELOCITY_N]
        return TruePlace(latitude, longitude, height, velocity)

    def moved(self, place: TruePlace) -> tuple[float, float]:
        """Return how far east and north of its first place the vehicle is, m."""
        first = self._first
        return east_north_m(
            place.latitude, place.longitude, first.latitude, first.longitude, first.height
        )
