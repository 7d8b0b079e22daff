"""Removes the size effect: what accelerometers feel because they are not at one point.

With the calibrated position r of an accelerometer and the rate ω of the sensor frame, its increment
holds ``h'ᵀ ∫ [ω' x r + ω x (ω x r)] dt`` too much. Savage, *Strapdown Analytics* (2000), chapter 8,
"size effect". The rates are those of the fused gyro increments: the mean of an epoch for the
centripetal part, the change of the extrapolated rate at the epochs' ends for the other. Errors of
the extrapolation do not add up: the changes of all epochs sum to the last rate.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.records.memory import Fusion, SizeEffect
from rrins.firmware_py.core.sensors.calibration import AccelerometerCalibration, each

_M_PER_MM = 1e-3


def fill(effect: SizeEffect, accelerometers: AccelerometerCalibration, count: int) -> None:
    """Fill the calibrated positions of `count` accelerometers into their record."""
    effect.position_s[:count, 0] = each(accelerometers.position_x_mm, count) * _M_PER_MM
    effect.position_s[:count, 1] = each(accelerometers.position_y_mm, count) * _M_PER_MM
    effect.position_s[:count, 2] = each(accelerometers.position_z_mm, count) * _M_PER_MM
    effect.present = bool(effect.position_s.any())


@compiled
def follow(effect: SizeEffect, dtheta_s: Floats, dt: float) -> None:
    """Take the rates of an epoch from its fused increment, rad, and its length, s."""
    for i in range(3):
        rate = dtheta_s[i] / dt
        end = rate
        if effect.begun:
            end += 0.5 * (rate - effect.rate_s[i])
            effect.change_s[i] = end - effect.end_rate_s[i]
        effect.rate_s[i] = rate
        effect.end_rate_s[i] = end
    effect.begun = True


@compiled
def remove(
    effect: SizeEffect, accelerometers: Fusion, received: int, measured: Floats, dt: float
) -> None:
    """Remove the size effect from the increments of `received`, one bit each, in place.

    `measured` has shape (m,), m/s along the input axes; other increments remain unchanged. Call
    `follow` before.
    """
    wx, wy, wz = effect.rate_s[0], effect.rate_s[1], effect.rate_s[2]
    dx, dy, dz = effect.change_s[0], effect.change_s[1], effect.change_s[2]
    square = wx * wx + wy * wy + wz * wz
    for k in range(accelerometers.count):
        if received >> k & 1 == 0:
            continue
        x, y, z = effect.position_s[k, 0], effect.position_s[k, 1], effect.position_s[k, 2]
        along = wx * x + wy * y + wz * z  # ω x (ω x r) = ω (ω r) - r ω²
        measured[k] -= (
            accelerometers.H[k, 0] * (dt * (wx * along - square * x) + dy * z - dz * y)
            + accelerometers.H[k, 1] * (dt * (wy * along - square * y) + dz * x - dx * z)
            + accelerometers.H[k, 2] * (dt * (wz * along - square * z) + dx * y - dy * x)
        )
