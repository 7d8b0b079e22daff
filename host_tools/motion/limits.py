"""Limits of a smoothed recording, beyond which it is refused: no vehicle moves like that."""

from __future__ import annotations

import numpy as np

from rrins.compiled.record import Floats, Integers
from rrins.host_tools.motion.errors import MotionError
from rrins.host_tools.motion.recording import Recording
from rrins.host_tools.motion.trajectory import (
    ATTITUDE,
    OMEGA_IB_B,
    PLACE,
    SPECIFIC_FORCE_B,
    Trajectory,
)
from rrins.host_tools.rounding import rounded

TURN_LIMIT_DPS = 400.0
FORCE_LIMIT_MPS2 = 200.0
PITCH_LIMIT_DEG = 85.0
HEIGHT_LIMITS_M = (-1000.0, 100_000.0)

_PER_PIECE = 4  # instants looked at


def refuse_impossible(recording: Recording, trajectory: Trajectory, times: Floats) -> None:
    """Raise `MotionError` if the vehicle turns, accelerates, pitches or sinks as none does.

    `times` are those of the recording in the trajectory, s.
    """
    at = np.arange(len(trajectory.pieces) * _PER_PIECE) / _PER_PIECE
    at *= trajectory.knot_ns * 1e-9
    turn = np.degrees(np.linalg.norm(trajectory.sampled(OMEGA_IB_B, _PER_PIECE), axis=1))
    force = np.linalg.norm(trajectory.sampled(SPECIFIC_FORCE_B, _PER_PIECE), axis=1)
    pitch = np.degrees(trajectory.sampled(ATTITUDE, _PER_PIECE)[:, 1])
    height = trajectory.sampled(PLACE, _PER_PIECE)[:, 2]
    low, high = HEIGHT_LIMITS_M
    outside = np.maximum(height - high, low - height)
    for size, limit, value, text in (
        (turn, TURN_LIMIT_DPS, turn, "turns at {}°/s, at most {:g}"),
        (force, FORCE_LIMIT_MPS2, force, "feels {} m/s², at most {:g}"),
        (np.abs(pitch), PITCH_LIMIT_DEG, pitch, "pitches to {}°, at most {:g}"),
        (outside, 0.0, height, f"is {{}} m high, must be {low:,g} to {high:,g}"),
    ):
        worst = int(np.argmax(size))
        if not size[worst] <= limit:
            where = _where(recording.line, times, float(at[worst]))
            what = text.format(rounded(value[worst], 4), limit)
            raise MotionError(f"motion {recording.path}: {where}: the smoothed vehicle {what}")


def _where(lines: Integers, times: Floats, at_s: float) -> str:
    """Return where in the file an instant of the trajectory is."""
    if at_s < times[0]:
        return f"run-up before line {lines[0]}"
    if at_s > times[-1]:
        return f"run-down after line {lines[-1]}"
    nearest = int(np.argmin(np.abs(times - at_s)))
    return f"near line {lines[nearest]}"
