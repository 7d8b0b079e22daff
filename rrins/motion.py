"""Motion of a vehicle, recorded or synthetic, as the hardware moves by it."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import ValidationError

from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.motion.build import build
from rrins.host_tools.motion.trajectory import Trajectory
from rrins.host_tools.scenario.motion import Motion
from rrins.host_tools.scenario.scenario import first_line
from rrins.host_tools.scenario.tables import Body, Site

if TYPE_CHECKING:
    import xarray as xr

_PERIOD_NS = 5_000_000
_RATE_HZ = 10


class VehicleMotion:
    """The motion of a vehicle.

    Attributes
    ----------
    trajectory : Trajectory
        Polynomials in time, as the hardware reads them.
    notes : tuple of str
        What it is, and what a recording had to be mended for.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        self.trajectory = trajectory
        self.notes = trajectory.notes

    @property
    def duration_s(self) -> float:
        """How long it lasts."""
        return len(self.trajectory.pieces) * self.trajectory.knot_ns / 1e9

    @cached_property
    def states(self) -> xr.Dataset:
        """Ten times a second `latitude`, `longitude`, `height`, `velocity_n`, `attitude`."""
        from rrins.datasets import states_of

        time_s = np.arange(0.0, self.duration_s, 1 / _RATE_HZ)
        return states_of(self.trajectory, time_s)

    def __repr__(self) -> str:
        return f"<rrins.VehicleMotion {self.duration_s:g} s: {'; '.join(self.notes)}>"


def load_motion(source: str | Path, **keys: object) -> VehicleMotion:
    """Return the motion of a vehicle.

    Parameters
    ----------
    source : str or Path
        ``"drive"``, ``"sway"``, or a recorded file (.csv or .pos).
    **keys
        Keys of a scenario's `[motion]`, such as ``duration_s=300`` or ``seed=3``.

    Raises
    ------
    ScenarioError
        When a key is wrong.
    MotionError
        When a recorded motion is missing, unreadable or refused.
    """
    kind = str(source) if source in ("drive", "sway") else "file"
    table = {"kind": kind, **keys} | ({"path": str(source)} if kind == "file" else {})
    try:
        motion = Motion.model_validate(table)
    except ValidationError as error:
        raise ScenarioError(f"motion {source}: {first_line(error, Motion)}") from error
    trajectory = build(motion, Site(), Body(), _PERIOD_NS, Path())
    assert trajectory is not None
    return VehicleMotion(trajectory)
