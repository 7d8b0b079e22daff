"""From true increments to counts: bandwidth, latency, errors of (16), (17), range, quantisation.

Per sensor, on increments: the input along the true axis h', for an accelerometer away from the
reference point with the size effect (`rrins.host_tools.hardware.size_effect`); first-order low
pass and latency; dead zone; ``N = [1 + λ + μ sign(x)] x + b + η``, where b includes drift, and for
gyros the effect of the specific force along the axis; the sensor's range; its resolution; then
whole counts of the
frame's unit. The fraction of a count is carried into the next epoch.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.host_tools.hardware.memory import FLICKER_POLES, LATENCY_CAPACITY, Sensors
from rrins.host_tools.hardware.noise import normal


def input_axis(alpha: float, beta: float) -> NDArray[np.float64]:
    """Return the input axis h of a sensor at polar angle α and azimuth β, rad. Paper, (5), (8)."""
    sine = math.sin(alpha)
    return np.array([sine * math.cos(beta), sine * math.sin(beta), math.cos(alpha)])


def transverse_axes(alpha: float, beta: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (u, v), so that (h, u, v) is right-handed and orthonormal. Paper, (11).

    u points to increasing polar angle, v to increasing azimuth.
    """
    u = np.array(
        [math.cos(alpha) * math.cos(beta), math.cos(alpha) * math.sin(beta), -math.sin(alpha)]
    )
    v = np.array([-math.sin(beta), math.cos(beta), 0.0])
    return u, v


def installed_axis(
    alpha: float, beta: float, delta_u: float, delta_v: float
) -> NDArray[np.float64]:
    """Return the true input axis ``h' = h - δu v - δv u``, angles in rad. Paper, (13)."""
    u, v = transverse_axes(alpha, beta)
    return input_axis(alpha, beta) - delta_u * v - delta_v * u


def axis_by_angle(alpha: float, beta: float) -> NDArray[np.float64]:
    """Return the derivatives of `installed_axis` by δu and by δv, shape (2, 3)."""
    u, v = transverse_axes(alpha, beta)
    return np.array([-v, -u])


@compiled
def _lagged(sensors: Sensors, k: int, x: float) -> float:
    """Return the increment after bandwidth and latency, for the input `x`.

    The low pass is exact for a rate that is constant within each epoch: its state is the rate
    at the epoch's end (as an increment), its output the integral over the epoch.
    """
    before = sensors.lag_state[k]
    sensors.lag_state[k] = x + sensors.lag_share * (before - x)
    x += sensors.lag_mean * (before - x)
    if sensors.latency_epochs == 0 and sensors.latency_fraction == 0.0:
        return x
    sensors.history[k, sensors.history_at] = x
    newer = (sensors.history_at - sensors.latency_epochs) % LATENCY_CAPACITY
    older = (newer - 1) % LATENCY_CAPACITY
    share = sensors.latency_fraction
    return (1.0 - share) * sensors.history[k, newer] + share * sensors.history[k, older]


@compiled
def feel(sensors: Sensors, true_s: Floats, out: Floats) -> None:
    """Write what sensors along the frame's axes feel of an increment: late, and smoothed."""
    for k in range(3):
        out[k] = _lagged(sensors, k, true_s[k]) if sensors.lags else true_s[k]
    sensors.history_at = (sensors.history_at + 1) % LATENCY_CAPACITY


@compiled
def _analog(sensors: Sensors, k: int, x: float, force: float) -> float:
    """Return the output of sensor `k` for the input `x`, before its range. Paper, (16), (17)."""
    if abs(x) < sensors.dead_zone_increment[k]:
        x = 0.0
    scale = 1.0 + sensors.scale_error[k] + sensors.fault_scale_error[k]
    if x > 0.0:
        scale += sensors.asymmetric_scale_error[k]
    elif x < 0.0:
        scale -= sensors.asymmetric_scale_error[k]
    measured = scale * x + sensors.bias_increment[k] + sensors.fault_bias_increment[k]
    measured += sensors.g_sensitivity[k] * force
    noise, more = sensors.noise_increment[k], sensors.fault_noise_increment[k]
    if more > 0.0:
        noise = math.sqrt(noise * noise + more * more)
    if noise > 0.0:
        measured += noise * normal(sensors, k)
    return measured


@compiled
def _resolved(sensors: Sensors, k: int, measured: float) -> float:
    """Return whole steps of the sensor's resolution; the remainder is carried over."""
    wanted = sensors.resolution_remainder[k] + measured / sensors.resolution
    steps = np.rint(wanted)
    sensors.resolution_remainder[k] = wanted - steps
    return steps * sensors.resolution


@compiled
def measure(sensors: Sensors, true_s: Floats, dv_s: Floats, unit: float, largest: int) -> None:
    """Turn a true increment in the sensor frame into the counts of all sensors of a kind.

    Parameters
    ----------
    sensors : Sensors
        `counts` and `saturated` are the result.
    true_s : array, shape (3,)
        rad or m/s.
    dv_s : array, shape (3,)
        m/s, for the sensitivity of gyros to specific force.
    unit : float
        Increment of one count.
    largest : int
        Largest absolute count that the frame can carry.
    """
    sensors.saturated = 0
    lags = sensors.lags
    for k in range(sensors.count):
        axis = sensors.axis[k]
        x = axis[0] * true_s[0] + axis[1] * true_s[1] + axis[2] * true_s[2]
        force = axis[0] * dv_s[0] + axis[1] * dv_s[1] + axis[2] * dv_s[2]
        if sensors.displaced:
            x += sensors.arm_increment[k]
        if lags:
            x = _lagged(sensors, k, x)
        measured = _analog(sensors, k, x, force)
        limit = sensors.range_increment
        if sensors.dead >> k & 1:
            measured = 0.0
        elif sensors.full_scale >> k & 1:
            measured = 2.0 * limit
        if abs(measured) > limit:
            sensors.saturated |= 1 << k
            measured = limit if measured > 0.0 else -limit
        if sensors.resolution > 0.0:
            measured = _resolved(sensors, k, measured)
        wanted = sensors.remainder[k] + measured / unit
        count = int(np.rint(wanted))
        if abs(count) > largest:
            sensors.saturated |= 1 << k
            count = largest if count > 0 else -largest
            wanted = float(count)
        sensors.remainder[k] = wanted - count
        if sensors.stuck >> k & 1 == 0:
            sensors.counts[k] = count
    if lags:
        sensors.history_at = (sensors.history_at + 1) % LATENCY_CAPACITY


@compiled
def drift(sensors: Sensors, warmer: float) -> None:
    """Update the drifting errors: bias instability, rate random walk, temperature.

    Parameters
    ----------
    sensors : Sensors
    warmer : float
        K, above the calibration temperature.
    """
    for k in range(sensors.count):
        bias = sensors.constant_bias_increment[k] + warmer * sensors.bias_temperature_increment[k]
        for p in range(FLICKER_POLES):
            if sensors.flicker_drive[k, p] > 0.0:
                sensors.flicker_state[k, p] *= sensors.flicker_decay[p]
                sensors.flicker_state[k, p] += sensors.flicker_drive[k, p] * normal(sensors, k)
                bias += sensors.flicker_state[k, p]
        if sensors.walk_drive[k] > 0.0:
            sensors.walk_state[k] += sensors.walk_drive[k] * normal(sensors, k)
            bias += sensors.walk_state[k]
        sensors.bias_increment[k] = bias
        sensors.scale_error[k] = (
            sensors.constant_scale_error[k] + warmer * sensors.scale_temperature[k]
        )
