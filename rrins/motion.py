"""Motion of a vehicle, recorded or synthetic, as the hardware moves by it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import ValidationError

from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.motion.build import build, follow, load_recording
from rrins.host_tools.motion.export import check_ending, write_motion
from rrins.host_tools.motion.findings import findings
from rrins.host_tools.motion.trajectory import Trajectory
from rrins.host_tools.scenario.motion import Motion
from rrins.host_tools.scenario.tables import Body, Site
from rrins.host_tools.scenario.wrong_keys import first_line
from rrins.notebook import let_figures_show

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

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

    def plot(self) -> Figure:
        """Draw track, speed, height and attitude."""
        from rrins.host_tools.motion.plots import draw_motion

        let_figures_show()
        return draw_motion(self.trajectory, "\n".join(self.notes))

    def save(self, path: str | Path, *, rate_hz: float = 10.0) -> None:
        """Write it as a file that `load_motion` and scenarios read: .csv or .pos.

        Raises
        ------
        MotionError
            When the ending is another, or the file cannot be written.
        """
        check_ending(Path(path))
        write_motion(self.trajectory, Path(path), rate_hz, None)

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
    trajectory = build(_setting(source, keys), Site(), Body(), _PERIOD_NS, Path())
    assert trajectory is not None
    return VehicleMotion(trajectory)


def check_motion(path: str | Path, **keys: object) -> JsonObject:
    """Check a recorded motion; return what `rrins motion check --json` prints.

    Duration, rate and speeds, irregular lines and how they are handled, and how far the smoothed
    path deviates from the file.

    Parameters
    ----------
    path : str or Path
        .csv or .pos.
    **keys
        As in `load_motion`.

    Raises
    ------
    ScenarioError
        When a key is wrong.
    MotionError
        When the file is missing, unreadable or refused.
    """
    setting = _setting(path, keys)
    recording = load_recording(setting, Path())
    return findings(recording, follow(recording, setting, _PERIOD_NS))


def _setting(source: str | Path, keys: Mapping[str, object]) -> Motion:
    kind = str(source) if source in ("drive", "sway") else "file"
    table = {"kind": kind, **keys} | ({"path": str(source)} if kind == "file" else {})
    try:
        return Motion.model_validate(table)
    except ValidationError as error:
        raise ScenarioError(f"motion {source}: {first_line(error, Motion)}") from None
