"""Sway of a ship in waves: a sea spectrum passed through simple hull responses.

The sea at the ship is a sum of harmonics of its repetition period, each with its amplitude from the
spectrum and its phase drawn from the seed. Each of the six motions is the sea filtered by a
second-order low-pass with the motion's natural period and damping::

    H(ω) = ω_n² / (ω_n² - ω² + 2 i ζ ω_n ω)

Heave follows the surface, surge and sway the water's circular motion, pitch, roll and a little yaw
the slope of the wave, with wave number k = ω²/g (deep water).

References
----------
Hasselmann et al., *Measurements of wind-wave growth and swell decay during the Joint North Sea Wave
Project* (1973), and Pierson and Moskowitz, *J. Geophys. Res.* 69 (1964), for the spectra; DNV-RP-
C205 (2010), section 3.5.5, for their form in wave height and peak period; Lewis (ed.), *Principles
of Naval Architecture*, vol. III (1989), section 3, for the responses.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats
from rrins.host_tools.hardware.units import STANDARD_GRAVITY
from rrins.host_tools.motion.errors import MotionError
from rrins.host_tools.motion.kinematics import Path, trajectory_of
from rrins.host_tools.motion.local import Local
from rrins.host_tools.motion.spline import AT_KNOTS, DEGREE, monomials_of
from rrins.host_tools.motion.trajectory import Trajectory, knot_ns
from rrins.host_tools.rounding import rounded
from rrins.host_tools.scenario.motion import Motion

RAMP_S = 120.0
"""Time for the sea to build up."""

_STILL_PIECES = 4
_PEAK_FACTOR = {"jonswap": 3.3, "pierson-moskowitz": 1.0}
_BAND = (0.4, 4.0)  # relative to the peak frequency: negligible outside
_HIGHEST = 3.0  # rad/s: shorter waves average out along the hull
_ROLL_DAMPING = 0.1
_PITCH_PERIOD_S, _HEAVE_PERIOD_S, _DAMPING = 6.5, 6.5, 0.6
_YAW_SHARE = 0.15
_LARGEST_ANGLE = math.radians(60)


def wave_spectrum(omega: Floats, height: float, period: float, peak_factor: float) -> Floats:
    """Return the one-sided spectral density of the sea's surface, m² s, at ω in rad/s.

    JONSWAP in the form of DNV-RP-C205, (3.5.5.2); with a peak factor of 1 it is that of Pierson
    and Moskowitz. `height` is the significant wave height (m), `period` that of the peak (s).
    """
    peak = 2 * math.pi / period
    moskowitz = 5 / 16 * height**2 * peak**4 * omega**-5.0 * np.exp(-1.25 * (omega / peak) ** -4.0)
    width = np.where(omega <= peak, 0.07, 0.09)
    bump = np.exp(-0.5 * ((omega - peak) / (width * peak)) ** 2)
    return np.asarray((1 - 0.287 * math.log(peak_factor)) * moskowitz * peak_factor**bump)


def _low_pass(omega: Floats, period_s: float, damping: float) -> NDArray[np.complex128]:
    natural = 2 * math.pi / period_s
    return np.asarray(natural**2 / (natural**2 - omega**2 + 2j * damping * natural * omega))


def responses(omega: Floats, wave_from: float, roll_period_s: float) -> NDArray[np.complex128]:
    """Return surge (forward), sway (to the right), heave, roll, pitch, yaw per metre of wave.

    Parameters
    ----------
    omega : array, shape (m,)
        rad/s.
    wave_from : float
        Where the waves come from, rad clockwise from the bow.
    roll_period_s : float
        Natural period of roll.

    Returns
    -------
    array, shape (6, m)
        Complex amplitudes of `exp(i ω t)`; m per m, rad per m.
    """
    # Direction of travel, opposite to where the waves come from: forward and right components.
    ahead, right = -math.cos(wave_from), -math.sin(wave_from)
    slope = -1j * omega**2 / STANDARD_GRAVITY  # of the surface, in the direction of travel
    follow = _low_pass(omega, _HEAVE_PERIOD_S, _DAMPING)
    pitch = _low_pass(omega, _PITCH_PERIOD_S, _DAMPING)
    roll = _low_pass(omega, roll_period_s, _ROLL_DAMPING)
    return np.stack(
        [
            -1j * ahead * follow,
            -1j * right * follow,
            follow,
            -right * slope * roll,  # a surface that rises to the right lifts the right side
            ahead * slope * pitch,
            _YAW_SHARE * ahead * right * slope * pitch,
        ]
    )


def _harmonics(motion: Motion, period_s: float, count: int) -> NDArray[np.complex128]:
    """Return the complex amplitudes, (6, count // 2 + 1), of the six motions' harmonics."""
    number = np.arange(count // 2 + 1, dtype=np.float64)
    omega: Floats = 2 * math.pi * number / period_s
    peak = 2 * math.pi / motion.wave_period_s
    band = (omega > _BAND[0] * peak) & (omega < min(_BAND[1] * peak, _HIGHEST))
    inside = omega[band]
    density = wave_spectrum(
        inside, motion.wave_height_m, motion.wave_period_s, _PEAK_FACTOR[motion.wave_spectrum]
    )
    generator = np.random.default_rng(motion.seed)
    phase = np.exp(2j * math.pi * generator.random(len(number)))[band]
    amplitude = np.sqrt(2 * density * 2 * math.pi / period_s) * phase
    found = np.zeros((6, len(number)), dtype=np.complex128)
    found[:, band] = amplitude * responses(
        inside, math.radians(motion.wave_from_deg), motion.roll_period_s
    )
    return found


def _periodic(harmonics: NDArray[np.complex128], count: int) -> Floats:
    """Return spline coefficients, (count, 6), that pass through the harmonics at all knots."""
    # At the knots, a harmonic of the coefficients is scaled by the transform of the basis.
    turn = 2 * math.pi * np.arange(harmonics.shape[1]) / count
    about = np.arange(DEGREE) - DEGREE // 2
    transform = (AT_KNOTS * np.cos(turn[:, None] * about)).sum(axis=1)
    return np.fft.irfft(harmonics / transform * (count / 2), count, axis=1).T


def _rise(count: int, ramp: int) -> Floats:
    """Return 0 while still, then a smooth step to 1 over `ramp` coefficients."""
    u = np.clip((np.arange(count) - _STILL_PIECES - DEGREE) / ramp, 0.0, 1.0)
    return u**3 * (10 + u * (6 * u - 15))


def synthetic_sway(motion: Motion, period_s: float, base: Floats, period_ns: int) -> Trajectory:
    """Return sway about a position and an attitude: the sea builds up, then repeats.

    Parameters
    ----------
    motion : Motion
        Sets the sea, the ship and the seed.
    period_s : float
        Time after which the motion repeats exactly.
    base : array, shape (6,)
        Latitude, longitude (rad), height (m), roll, pitch, heading (rad) in calm water.
    period_ns : int
        Sampling period.
    """
    step_ns = knot_ns(period_ns)
    step_s = step_ns * 1e-9
    loop = round(period_s / step_s)
    waves = _periodic(_harmonics(motion, loop * step_s, loop), loop)
    ramp = math.ceil(RAMP_S / step_s)
    begin = _STILL_PIECES + DEGREE + ramp
    count = begin + loop + DEGREE
    swayed = waves[np.arange(count) % loop] * _rise(count, ramp)[:, None]
    surge, sway, heave = swayed[:, :3].T
    sine, cosine = math.sin(base[5]), math.cos(base[5])
    offsets = np.stack([surge * sine + sway * cosine, surge * cosine - sway * sine, heave], axis=1)
    coefficients = np.concatenate([Local(*base[:3]).places(offsets), swayed[:, 3:]], axis=1)
    angles = monomials_of(coefficients)[:, 3:5, 0] + base[3:5]
    if np.abs(angles).max() > _LARGEST_ANGLE:
        raise MotionError("motion: in this sea the ship rolls or pitches beyond 60°")
    return trajectory_of(
        Path(step_ns, base, coefficients), loop_from=begin, notes=(_sway_note(motion, swayed),)
    )


def _sway_note(motion: Motion, swayed: Floats) -> str:
    heave, *angles = (swayed[:, k].std() for k in (2, 3, 4))
    roll, pitch = (rounded(math.degrees(angle), 2) for angle in angles)
    return (
        f"sea of {motion.wave_height_m:g} m and {motion.wave_period_s:g} s: "
        f"heave {rounded(heave, 2)} m, roll {roll}°, pitch {pitch}° rms"
    )
