"""Smooths a recorded path: fits splines to its positions and velocities.

Each of east, north, up is a quintic spline x that minimises, with the deviations σ of the file and
the density q of the jerk::

    Σ ((x(t_i) - p_i) / σ_p,i)² + Σ ((x'(t_i) - v_i) / σ_v,i)² + (1/q²) ∫ x'''² dt

Samples more than 3 σ off are down-weighted in two more rounds (Huber, *Robust Statistics* (1981),
section 7.8). At both ends the spline is constant: it begins and ends at rest even if the file does
not; `bridges` says how it gets there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rrins.compiled.record import Floats, Integers
from rrins.host_tools.motion.attitude import fit_angles, track_attitude
from rrins.host_tools.motion.bridges import edge_velocities, long_gaps, run_s, runs
from rrins.host_tools.motion.kinematics import Path, trajectory_of
from rrins.host_tools.motion.local import Local
from rrins.host_tools.motion.recording import Recording
from rrins.host_tools.motion.spline import Fit, Grid, Observations, evaluate
from rrins.host_tools.motion.trajectory import Trajectory, knot_ns
from rrins.host_tools.rounding import rounded, with_unit
from rrins.host_tools.scenario.motion import Motion

STILL_PIECES = 4
"""Pieces at either end that are exactly at rest."""

_HUBER = 3.0
_ROUNDS = 3
_LIVELY = 8.0  # m/s²
_LEAST_LAG_S, _LARGEST_LAG_S = 0.02, 2.0
_LAG_SHARE = 0.3  # share of the sum of squares that a lag must explain


@dataclass(frozen=True)
class Residuals:
    """Smoothed path minus file: east, north, up; NaN where the file has no value.

    Attributes
    ----------
    position, velocity : array, shape (m, 3)
        In m and m/s.
    """

    time_s: Floats  #: shape (m,); since the beginning of the trajectory
    line: Integers  #: shape (m,)
    position: Floats
    velocity: Floats
    attitude: Floats  #: shape (m, 3); roll, pitch, heading in rad


@dataclass(frozen=True)
class Smoothed:
    """A smoothed recorded path and its residuals."""

    trajectory: Trajectory
    residuals: Residuals


def edge_speeds(recording: Recording) -> tuple[float, float]:
    """Return the speeds at the start and end of the file, m/s."""
    first, last = (float(np.linalg.norm(v)) for v in edge_velocities(recording))
    return first, last


def _robust_fit(
    grid: Grid, density: float, observed: list[Observations], guides: list[Observations]
) -> Floats:
    """Return the coefficients of one channel; outliers lose weight in each round."""
    weighted = observed
    for _ in range(_ROUNDS):
        fit = Fit(grid, density)
        for one in (*weighted, *guides):
            fit.add(one)
        coefficients = fit.solve()
        weighted = []
        for one in observed:
            off = np.abs(evaluate(coefficients, one.times, grid.step_s, one.order) - one.values)
            wider = np.sqrt(np.maximum(1.0, off / (_HUBER * one.deviations)))
            weighted.append(Observations(one.times, one.values, one.deviations * wider, one.order))
    return coefficients


def smooth(recording: Recording, motion: Motion, period_ns: int) -> Smoothed:
    """Return the trajectory along a mended recording, with its residuals.

    Parameters
    ----------
    recording : Recording
        Mended (`rrins.host_tools.motion.mending.mend`).
    motion : Motion
    period_ns : int
        Sampling period.
    """
    step_ns = knot_ns(period_ns)
    step_s = step_ns * 1e-9
    lengths = [math.ceil(run_s(speed) / step_s) for speed in edge_speeds(recording)]
    lead = STILL_PIECES + lengths[0]
    span = recording.time_s[-1] - recording.time_s[0]
    pieces = lead + math.ceil(span / step_s) + lengths[1] + STILL_PIECES
    grid = Grid(pieces, step_s, ((0, STILL_PIECES), (pieces - STILL_PIECES, pieces)))
    times = lead * step_s + recording.time_s - recording.time_s[0]

    local = Local(*recording.place[0])
    coefficients = np.zeros((pieces + 5, 6))
    density, lag = motion.jerk_density_mps3_per_sqrt_hz, 0.0
    coefficients[:, :3] = _fit_place(recording, local, grid, times, density, lag)
    if recording.has_velocity:
        lag = _velocity_lag(recording, local, grid, times, coefficients[:, :3])
        if lag:
            coefficients[:, :3] = _fit_place(recording, local, grid, times, density, lag)
    residuals = _residuals(recording, local, grid, times, coefficients[:, :3], lag)
    notes = [
        _residual_note(residuals),
        *_lively_note(recording, local, grid, times, coefficients[:, :3]),
    ]
    if lag:
        word = "late" if lag > 0 else "early"
        notes.append(f"the file's velocities are {abs(lag):.2f} s {word}; shifted to match")
    if recording.has_attitude:
        coefficients[:, 3:] = fit_angles(grid, times, recording)
    else:
        coefficients[:, 3:], more = track_attitude(grid, local, coefficients[:, :3], times)
        notes += more
    residuals = replace(
        residuals, attitude=_sampled(coefficients[:, 3:], grid, times) - recording.attitude
    )
    coefficients[:, :3] = local.places(coefficients[:, :3])
    base = np.array([local.latitude, local.longitude, local.height, 0.0, 0.0, 0.0])
    base += coefficients[0]
    base[1] = (base[1] + math.pi) % (2 * math.pi) - math.pi
    base[5] %= 2 * math.pi
    trajectory = trajectory_of(
        Path(step_ns, base, coefficients - coefficients[0]), notes=tuple(notes)
    )
    return Smoothed(trajectory, residuals)


def _fit_place(
    recording: Recording, local: Local, grid: Grid, times: Floats, density: float, lag: float
) -> Floats:
    """Return the coefficients of east, north, up in m, for velocities that are `lag` s late."""
    offsets = local.offsets(recording.place)
    velocity = recording.velocity_n / local.stretch(offsets)
    given = np.isfinite(velocity).all(axis=1)
    columns = []
    for axis in range(3):
        slopes = np.where(given, velocity[:, axis], np.gradient(offsets[:, axis], times))
        observed = [
            Observations(times / grid.step_s, offsets[:, axis], recording.place_deviation[:, axis]),
            Observations(
                (times[given] - lag) / grid.step_s,
                velocity[given, axis],
                recording.velocity_deviation[given, axis],
                order=1,
            ),
        ]
        guides = [
            *long_gaps(times, offsets[:, axis], slopes, grid.step_s),
            *runs(recording, local, times, axis, grid.step_s),
        ]
        columns.append(_robust_fit(grid, density, observed, guides))
    return np.stack(columns, axis=1)


def _over_ground(
    local: Local, grid: Grid, times: Floats, coefficients: Floats, order: int
) -> Floats:
    """Return a derivative of the position over ground, shape (m, 3)."""
    at = times / grid.step_s
    slopes = evaluate(coefficients, at, grid.step_s, order)
    return np.asarray(slopes * local.stretch(evaluate(coefficients, at)))


def _velocity_lag(
    recording: Recording, local: Local, grid: Grid, times: Floats, coefficients: Floats
) -> float:
    """Return the delay in s of the file's velocities against its positions; 0 if insignificant.

    The discrepancy is the lag times the acceleration: least squares over all samples.
    """
    given = np.isfinite(recording.velocity_n).all(axis=1)
    speeding = _over_ground(local, grid, times[given], coefficients, 2)
    missing = _over_ground(local, grid, times[given], coefficients, 1) - recording.velocity_n[given]
    power = float((speeding**2).sum())
    lag = float((missing * speeding).sum()) / power if power > 0 else 0.0
    explained = lag * lag * power > _LAG_SHARE * float((missing**2).sum())
    return lag if explained and _LEAST_LAG_S < abs(lag) < _LARGEST_LAG_S else 0.0


def _residuals(
    recording: Recording,
    local: Local,
    grid: Grid,
    times: Floats,
    coefficients: Floats,
    lag: float,
) -> Residuals:
    offsets = local.offsets(recording.place)
    path = _sampled(coefficients, grid, times)
    velocity = _over_ground(local, grid, times - lag, coefficients, 1)
    return Residuals(
        times,
        recording.line,
        (path - offsets) * local.stretch(offsets),
        velocity - recording.velocity_n,
        np.full_like(recording.attitude, np.nan),
    )


def _sampled(coefficients: Floats, grid: Grid, times: Floats) -> Floats:
    """Return the values of splines at times in s, shape (m, channels)."""
    return evaluate(coefficients, times / grid.step_s)


def _lively_note(
    recording: Recording, local: Local, grid: Grid, times: Floats, coefficients: Floats
) -> list[str]:
    """Return a warning if the path accelerates implausibly for a vehicle."""
    size = np.linalg.norm(_over_ground(local, grid, times, coefficients, 2), axis=1)
    worst = int(np.argmax(size))
    if size[worst] < _LIVELY:
        return []
    return [
        f"accelerates at {rounded(size[worst])} m/s² near line {recording.line[worst]}: "
        "possibly a jump too small to detect"
    ]


def _residual_note(residuals: Residuals) -> str:
    off = np.linalg.norm(residuals.position, axis=1)
    worst = int(np.argmax(off))
    text = (
        f"smoothed path minus file: position rms {with_unit(np.sqrt(np.mean(off**2)), 'm')}, "
        f"largest {with_unit(off[worst], 'm')} (line {residuals.line[worst]})"
    )
    speed_off = np.linalg.norm(residuals.velocity, axis=1)
    speed_off = speed_off[np.isfinite(speed_off)]
    if len(speed_off):
        text += f"; velocity rms {with_unit(np.sqrt(np.mean(speed_off**2)), 'm/s')}"
    return text
