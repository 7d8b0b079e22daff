"""Builds the trajectory from a scenario's `[motion]` table."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.motion.bridges import begins_or_ends_in_motion
from rrins.host_tools.motion.drive import synthetic_drive
from rrins.host_tools.motion.limits import refuse_impossible
from rrins.host_tools.motion.mending import mend, refusal
from rrins.host_tools.motion.reading import read
from rrins.host_tools.motion.recording import Recording
from rrins.host_tools.motion.smoothing import Smoothed, smooth
from rrins.host_tools.motion.sway import synthetic_sway
from rrins.host_tools.motion.trajectory import Trajectory
from rrins.host_tools.scenario.motion import DRIVE_S, SWAY_S, Motion

if TYPE_CHECKING:
    from rrins.host_tools.scenario.tables import Body, Site


def base_of(site: Site, body: Body) -> Floats:
    """Return the initial position and attitude of a synthetic motion, rad and m, shape (6,)."""
    return np.array(
        [
            math.radians(site.latitude_deg),
            math.radians(site.longitude_deg),
            site.height_m,
            math.radians(body.roll_deg),
            math.radians(body.pitch_deg),
            math.radians(body.heading_deg),
        ]
    )


def load_recording(motion: Motion, base_folder: Path) -> Recording:
    """Return a recording mended for use, with all its irregularities.

    Raises
    ------
    MotionError
        If the file cannot be read, is not a motion, or is refused.
    """
    assert motion.path is not None
    path = base_folder / motion.path
    recording = read(path, motion)
    refused = motion.irregularities == "refuse"
    if refused and recording.irregularities:
        _refuse(recording)
    mend(recording, motion)
    recording.irregularities += begins_or_ends_in_motion(recording)
    recording.irregularities.sort(key=lambda irregular: irregular.line)
    if refused:
        _refuse(recording)
    return recording


def _refuse(recording: Recording) -> None:
    error = refusal(recording.irregularities, recording.path)
    if error is not None:
        raise error


def follow(recording: Recording, motion: Motion, period_ns: int) -> Smoothed:
    """Return the smooth path along a recording; its notes say what was mended.

    Raises
    ------
    MotionError
        If it cannot be smoothed, or moves as no vehicle does.
    """
    try:
        smoothed = smooth(recording, motion, period_ns)
    except np.linalg.LinAlgError as error:
        raise recording.fail(f"cannot be smoothed: {error}") from error
    counts = Counter(irregular.kind for irregular in recording.irregularities)
    notes = []
    if counts:
        counted = ", ".join(f"{kind} {count}" for kind, count in sorted(counts.items()))
        first = recording.irregularities[0]
        more = f" (and {sum(counts.values()) - 1} more)" if sum(counts.values()) > 1 else ""
        notes.append(f"mended in {recording.path.name}: {counted}; {first}{more}")
    trajectory = smoothed.trajectory
    refuse_impossible(recording, trajectory, smoothed.residuals.time_s)
    return replace(smoothed, trajectory=replace(trajectory, notes=(*notes, *trajectory.notes)))


def build(
    motion: Motion, site: Site, body: Body, period_ns: int, base_folder: Path
) -> Trajectory | None:
    """Return the trajectory of a motion, or None for a stationary vehicle.

    Parameters
    ----------
    motion : Motion
    site, body
        Start of a synthetic motion; a file has its own position and attitude.
    period_ns : int
        Sampling period.
    base_folder : Path
        Base of a relative file path.

    Raises
    ------
    MotionError
        If a file cannot be read, is not a motion, or is refused.
    """
    if motion.kind == "drive":
        return synthetic_drive(
            motion.duration_s or DRIVE_S, motion.seed, base_of(site, body), period_ns
        )
    if motion.kind == "sway":
        return synthetic_sway(motion, motion.duration_s or SWAY_S, base_of(site, body), period_ns)
    if motion.kind == "file":
        return follow(load_recording(motion, base_folder), motion, period_ns).trajectory
    return None
