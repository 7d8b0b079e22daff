"""Smooths a recorded path: fits splines to its positions and velocities.

Each of east, north, up is a quintic spline x that minimises, with the deviations σ of the file and
the density q of the jerk::

    Σ ((x(t_i) - p_i) / σ_p,i)² + Σ ((x'(t_i) - v_i) / σ_v,i)² + (1/q²) ∫ x'''² dt

Samples more than 3 σ off are down-weighted in two more rounds (Huber, *Robust Statistics* (1981),
section 7.8). At both ends the spline is constant: it begins and ends at rest even if the file does
not; the path from rest to the first sample minimises jerk.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rrins.dbc.record import Floats, Integers
from rrins.host_tools.motion.attitude import fit_angles, track_attitude
from rrins.host_tools.motion.kinematics import Path, trajectory_of
from rrins.host_tools.motion.local import Local
from rrins.host_tools.motion.recording import Irregularity, Recording
from rrins.host_tools.motion.spline import Fit, Grid, Observations, evaluate
from rrins.host_tools.motion.trajectory import Trajectory, knot_ns
from rrins.host_tools.scenario.motion import Motion

STILL_PIECES = 4
"""Pieces at either end that are exactly at rest."""

MOVING_MPS = 0.5
"""A file with a higher speed at either end begins or ends in motion."""

_RUN_UP = 1.0  # m/s², mean
_LEAST_RUN_UP_S = 2.0
_EDGE_S = 1.0  # span over which the speed at an end is measured
_HUBER = 3.0
_ROUNDS = 3
_GUIDED_S = 60.0  # longer gaps get guide points
_GUIDE_DEVIATION = 1.0  # m
_LIVELY = 8.0  # m/s²
_LEAST_LAG_S, _LARGEST_LAG_S = 0.02, 2.0
_LAG_SHARE = 0.3  # share of the sum of squares that a lag must explain


@dataclass(frozen=True)
class Residuals:
    """Smoothed path minus file: east, north, up; NaN where the file has no value.

    Attributes
    ----------
    time_s : array, shape (m,)
        Since the beginning of the trajectory.
    line : array, shape (m,)
    position, velocity : array, shape (m, 3)
        In m and m/s.
    """

    time_s: Floats
    line: Integers
    position: Floats
    velocity: Floats


@dataclass(frozen=True)
class Smoothed:
    """A smoothed recorded path and its residuals."""

    trajectory: Trajectory
    residuals: Residuals


def edge_speeds(recording: Recording) -> tuple[float, float]:
    """Return the speeds at the start and end of the file, m/s."""
    return _edge_speed(recording, first=True), _edge_speed(recording, first=False)


def _edge_speed(recording: Recording, first: bool) -> float:
    times = recording.time_s
    edge = times <= times[0] + _EDGE_S if first else times >= times[-1] - _EDGE_S
    if edge.sum() < 3:
        edge = np.zeros(len(times), dtype=bool)
        edge[slice(0, 3) if first else slice(-3, None)] = True
    given = recording.velocity_n[edge]
    given = given[np.isfinite(given).all(axis=1)]
    if len(given):
        return float(np.linalg.norm(given.mean(axis=0)))
    local = Local(*recording.place[0])
    offsets = local.offsets(recording.place[edge])
    slopes = np.polyfit(times[edge] - times[edge][0], offsets, 1)[0]
    return float(np.linalg.norm(slopes))


def begins_or_ends_in_motion(recording: Recording) -> list[Irregularity]:
    """Return the irregularities of a file that is not at rest at its ends."""
    found = []
    for at, word, added, speed in zip(
        (0, -1), ("begins", "ends"), ("run-up", "run-down"), edge_speeds(recording), strict=True
    ):
        if speed > MOVING_MPS:
            length = _run_s(speed)
            text = f"{word} in motion, at {speed:.3g} m/s"
            mended = f"{added} of {length:.3g} s added"
            found.append(Irregularity(int(recording.line[at]), "motion", text, mended))
    return found


def _run_s(speed: float) -> float:
    return max(_LEAST_RUN_UP_S, speed / _RUN_UP)


def _guides(times: Floats, values: Floats, slopes: Floats, step_s: float) -> Observations | None:
    """Return points on cubics across long gaps; without them the fit is ill-conditioned."""
    found = []
    for k in np.flatnonzero(np.diff(times) > _GUIDED_S):
        length = times[k + 1] - times[k]
        u = np.linspace(0, 1, math.ceil(2 * length / _GUIDED_S) + 1)[1:-1]
        cubic = (
            values[k] * (1 + 2 * u) * (1 - u) ** 2
            + values[k + 1] * u**2 * (3 - 2 * u)
            + length * (slopes[k] * u * (1 - u) ** 2 + slopes[k + 1] * u**2 * (u - 1))
        )
        found.append(np.stack([times[k] + u * length, cubic]))
    if not found:
        return None
    at, value = np.concatenate(found, axis=1)
    return Observations(at / step_s, value, np.full_like(at, _GUIDE_DEVIATION))


def _robust_fit(
    grid: Grid, density: float, observed: list[Observations], guides: Observations | None
) -> Floats:
    """Return the coefficients of one channel; outliers lose weight in each round."""
    weighted = observed
    for _ in range(_ROUNDS):
        fit = Fit(grid, density)
        for one in weighted:
            fit.add(one)
        if guides is not None:
            fit.add(guides)
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
    runs = [math.ceil(_run_s(speed) / step_s) for speed in edge_speeds(recording)]
    lead = STILL_PIECES + runs[0]
    span = recording.time_s[-1] - recording.time_s[0]
    pieces = lead + math.ceil(span / step_s) + runs[1] + STILL_PIECES
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
        coefficients[:, 3:], more = track_attitude(grid, local, coefficients[:, :3])
        notes += more
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
        guides = _guides(times, offsets[:, axis], slopes, grid.step_s)
        columns.append(_robust_fit(grid, density, observed, guides))
    return np.stack(columns, axis=1)


def _over_ground(
    local: Local, grid: Grid, times: Floats, coefficients: Floats, order: int
) -> Floats:
    """Return a derivative of the position over ground, shape (m, 3)."""
    at = [
        np.stack([evaluate(c, times / grid.step_s, grid.step_s, k) for c in coefficients.T], axis=1)
        for k in (0, order)
    ]
    return np.asarray(at[1] * local.stretch(at[0]))


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
    path = np.stack([evaluate(c, times / grid.step_s) for c in coefficients.T], axis=1)
    velocity = _over_ground(local, grid, times - lag, coefficients, 1)
    return Residuals(
        times,
        recording.line,
        (path - offsets) * local.stretch(offsets),
        velocity - recording.velocity_n,
    )


def _lively_note(
    recording: Recording, local: Local, grid: Grid, times: Floats, coefficients: Floats
) -> list[str]:
    """Return a warning if the path accelerates implausibly for a vehicle."""
    size = np.linalg.norm(_over_ground(local, grid, times, coefficients, 2), axis=1)
    worst = int(np.argmax(size))
    if size[worst] < _LIVELY:
        return []
    return [
        f"accelerates at {size[worst]:.3g} m/s² near line {recording.line[worst]}: "
        "possibly a jump too small to detect"
    ]


def _residual_note(residuals: Residuals) -> str:
    off = np.linalg.norm(residuals.position, axis=1)
    worst = int(np.argmax(off))
    text = (
        f"smoothed path minus file: position rms {np.sqrt(np.mean(off**2)):.3g} m, "
        f"largest {off[worst]:.3g} m (line {residuals.line[worst]})"
    )
    speed_off = np.linalg.norm(residuals.velocity, axis=1)
    speed_off = speed_off[np.isfinite(speed_off)]
    if len(speed_off):
        text += f"; velocity rms {np.sqrt(np.mean(speed_off**2)):.3g} m/s"
    return text
