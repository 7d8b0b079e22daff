"""The state in which navigation begins: as the recording says it, or found from its data.

Level is found from the mean specific force at standstill; the heading from the course over ground
of the first fixes in motion, carried back by the gyros. Groves (2nd ed., 2013), sections 5.6.2 and
5.6.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.vehicle.errors import VehicleError
from rrins.host_tools.vehicle.recording import Fixes, VehicleRecording

_LEVELLING_S = 1.0
_COURSE_MPS = 2.0
"""Speed from which the course over ground is taken for the heading."""

_COURSE_S = 300.0
"""How long after the beginning a course may be found, s: then the gyros have drifted away."""

_LEVEL_SIGMA, _COURSE_SIGMA = math.radians(0.5), math.radians(3.0)
_STANDING_MPS = 0.5
_SLOPE_S = 4.0
"""Over which the slope of positions is taken for a velocity."""

_EARTH_M = 6_371_000.0


@dataclass(frozen=True)
class State:
    """The state in which navigation begins; lengths in m, angles in rad.

    Attributes
    ----------
    level_sigma, heading_sigma : float
    """

    time_s: float  #: by the clock of the recording
    place: Floats  #: shape (3,); latitude, longitude, height
    place_sigma: float
    velocity_sigma: float  #: m/s, of a velocity of zero
    attitude: Floats  #: shape (3,); roll, pitch, heading
    level_sigma: float
    heading_sigma: float
    notes: tuple[str, ...]  #: how it was found, for a person


def find(
    recording: VehicleRecording,
    axes: tuple[Floats, Floats] | None = None,
    start_s: float | None = None,
    attitude: Floats | None = None,
) -> State:
    """Return the state in which navigation begins.

    Parameters
    ----------
    recording : VehicleRecording
    axes : pair of arrays, shape (n, 3)
        Input axes of gyros and accelerometers in b, where they are not those of the body.
    start_s : float, optional
        When to begin, by the recording's clock.
    attitude : array, shape (3,), optional
        Roll, pitch, heading then, rad; else the recording's, else found.

    Raises
    ------
    VehicleError
        If something is missing, or the vehicle moves then.
    """
    said, increments, fixes = recording.beginning, recording.increments, recording.fixes
    notes: list[str] = []
    time_s = start_s if start_s is not None else said.time_s
    if time_s is None:
        earliest = float(increments.time_s[0])
        time_s = earliest if fixes is None else max(earliest, float(fixes.time_s[0]))
    first, last = float(increments.time_s[0]), float(increments.time_s[-1])
    if not first - increments.interval_s <= time_s < last:
        raise VehicleError(
            f"import: navigation is to begin at {time_s:.3f} s, but the increments are of "
            f"{first:.3f} to {last:.3f} s"
        )
    is_as_said = start_s is None or start_s == said.time_s
    place, place_sigma = _place(recording, time_s, is_as_said)
    speed_sigma = _check_standing(recording, time_s, is_as_said)
    if attitude is None and is_as_said and said.attitude is not None:
        attitude = said.attitude
    level_sigma = said.level_sigma if said.level_sigma is not None else _LEVEL_SIGMA
    heading_sigma = said.heading_sigma if said.heading_sigma is not None else _COURSE_SIGMA
    if attitude is None:
        attitude, course_s = _found_attitude(recording, axes, time_s)
        level_sigma, heading_sigma = _LEVEL_SIGMA, _COURSE_SIGMA
        notes.append(
            "attitude: level by the accelerometers, heading by the course over ground "
            f"{course_s - time_s:.1f} s later: roll {math.degrees(attitude[0]):.2f}°, pitch "
            f"{math.degrees(attitude[1]):.2f}°, heading {math.degrees(attitude[2]) % 360:.2f}°"
        )
    return State(
        time_s,
        place,
        place_sigma,
        speed_sigma,
        attitude,
        level_sigma,
        heading_sigma,
        tuple(notes),
    )


def _place(recording: VehicleRecording, time_s: float, is_as_said: bool) -> tuple[Floats, float]:
    said, fixes = recording.beginning, recording.fixes
    if is_as_said and said.place is not None:
        return said.place, said.place_sigma or 1.0
    if fixes is None:
        raise VehicleError("import: no position to begin with: give GNSS fixes")
    k = int(np.argmin(np.abs(fixes.time_s - time_s)))
    return fixes.place[k], float(np.max(fixes.place_sigma[k]))


def _check_standing(recording: VehicleRecording, time_s: float, is_as_said: bool) -> float:
    """Return the standard deviation of a velocity of zero.

    Raises
    ------
    VehicleError
        If the vehicle moves.
    """
    said, fixes = recording.beginning, recording.fixes
    velocity, doubt = said.velocity_n if is_as_said else None, 0.0
    least = max(0.05, said.velocity_sigma or 0.0)
    if velocity is None and fixes is not None:
        k = int(np.argmin(np.abs(fixes.time_s - time_s)))
        velocity = fixes.velocity_n[k] if fixes.velocity_n is not None else None
        if velocity is None:
            slopes, sigmas = slopes_of(fixes)
            velocity, doubt = slopes[k], 4 * float(sigmas[k])
            least = _STANDING_MPS
    if velocity is None:
        return 0.05
    speed = float(np.linalg.norm(velocity))
    if speed > _STANDING_MPS + doubt:
        raise VehicleError(
            f"import: the vehicle moves at {speed:.2f} m/s when navigation is to begin, at "
            f"{time_s:.3f} s; give a time at which it stands with --start"
        )
    return max(least, 0.0 if doubt else 2 * speed)


def velocities_of(fixes: Fixes) -> Floats:
    """Return the velocities of fixes, shape (n, 3), m/s; from their positions if need be."""
    return slopes_of(fixes)[0] if fixes.velocity_n is None else fixes.velocity_n


def slopes_of(fixes: Fixes) -> tuple[Floats, Floats]:
    """Return slopes of positions over some seconds, shape (n, 3), m/s, and the σ of each."""
    scale = np.array([_EARTH_M, _EARTH_M * math.cos(fixes.place[0, 0]), 1.0])
    metres = ((fixes.place - fixes.place[0]) * scale)[:, [1, 0, 2]]
    found, sigma = np.zeros_like(metres), np.zeros(len(metres))
    begins_s = np.clip(
        fixes.time_s - _SLOPE_S / 2,
        fixes.time_s[0],
        max(fixes.time_s[0], fixes.time_s[-1] - _SLOPE_S),
    )
    first = np.searchsorted(fixes.time_s, begins_s - 1e-6)
    last = np.searchsorted(fixes.time_s, begins_s + _SLOPE_S + 1e-6)
    for k, (begin, end) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        time_s = fixes.time_s[begin:end] - np.mean(fixes.time_s[begin:end])
        if len(time_s) > 1:
            squares = float(time_s @ time_s)
            found[k] = time_s @ metres[begin:end] / squares
            sigma[k] = float(np.max(fixes.place_sigma[k])) / math.sqrt(squares)
    return found, sigma


def in_body(increments: Floats, axes: Floats | None) -> Floats:
    """Return increments along the axes of the body, by least squares; shape (n, 3)."""
    return increments if axes is None else increments @ np.linalg.pinv(axes).T


def _found_attitude(
    recording: VehicleRecording, axes: tuple[Floats, Floats] | None, time_s: float
) -> tuple[Floats, float]:
    """Return roll, pitch, heading at a time of standstill, and when the course was found."""
    increments, fixes = recording.increments, recording.fixes
    if fixes is None:
        raise VehicleError("import: no attitude: give it with --attitude")
    rows = (increments.time_s > time_s) & (increments.time_s <= time_s + _LEVELLING_S)
    force = in_body(increments.dv, None if axes is None else axes[1])[rows].sum(axis=0)
    pitch = math.atan2(force[1], math.hypot(force[0], force[2]))
    roll = math.atan2(-force[0], force[2])
    velocities = velocities_of(fixes)
    speed = np.hypot(velocities[:, 0], velocities[:, 1])
    later = (fixes.time_s >= time_s) & (fixes.time_s <= time_s + _COURSE_S)
    fast = np.flatnonzero(later & (speed > _COURSE_MPS))
    if not len(fast):
        raise VehicleError(
            f"import: no attitude is given, and no fix within {_COURSE_S:.0f} s is faster than "
            f"{_COURSE_MPS:g} m/s to find the heading by; give it with --attitude"
        )
    k = int(fast[0])
    course = math.atan2(velocities[k, 0], velocities[k, 1])
    between = (increments.time_s > time_s) & (increments.time_s <= fixes.time_s[k])
    turned = _heading_change(
        in_body(increments.dtheta, None if axes is None else axes[0])[between], roll, pitch
    )
    return np.array([roll, pitch, course - turned]), float(fixes.time_s[k])


def _heading_change(dtheta_b: Floats, roll: float, pitch: float) -> float:
    """Return by how much the heading changes over increments; the Earth's turn is neglected."""
    from scipy.spatial.transform import Rotation

    # C_b_n = Rz(-heading) Rx(pitch) Ry(roll); heading 0 at the beginning
    attitude = Rotation.from_euler("XY", [pitch, roll])
    for step in Rotation.from_rotvec(dtheta_b):
        attitude = attitude * step
    forward = attitude.apply([0.0, 1.0, 0.0])
    return math.atan2(forward[0], forward[1])
