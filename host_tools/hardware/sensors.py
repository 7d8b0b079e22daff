"""From true increments to counts: errors of (16), (17), range, quantisation.

``N = [1 + λ + μ sign(h' x)] h' x + b + η`` per sensor, on increments; then the sensor's range;
then whole counts of the frame's unit, what is left over carried into the next epoch.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from host_tools.hardware.noise import normal


def input_axis(alpha: float, beta: float) -> NDArray[np.float64]:
    """Return the input axis h of a sensor at polar angle α and azimuth β, rad. Paper, (5), (8)."""
    sine = math.sin(alpha)
    return np.array([sine * math.cos(beta), sine * math.sin(beta), math.cos(alpha)])


def transverse_axes(alpha: float, beta: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (u, v), so that (h, u, v) is right-handed and orthonormal. Paper, (11).

    u points to growing polar angle, v to growing azimuth.
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


@njit(cache=True)
def measure(sensors: Any, true_s: Any, unit: float, largest: int) -> None:
    """Turn a true increment in the sensor frame into the counts of all sensors of a kind.

    Parameters
    ----------
    sensors : record of dtype `host_tools.hardware.memory.SENSORS`
        `counts` and `saturated` are the result.
    true_s : array, shape (3,)
        rad or m/s.
    unit : float
        Increment of one count.
    largest : int
        Largest count that the frame carries, either way.
    """
    sensors.saturated = 0
    for k in range(sensors.count):
        axis = sensors.axis[k]
        x = axis[0] * true_s[0] + axis[1] * true_s[1] + axis[2] * true_s[2]
        scale = 1.0 + sensors.scale_error[k]
        if x > 0.0:
            scale += sensors.asymmetric_scale_error[k]
        elif x < 0.0:
            scale -= sensors.asymmetric_scale_error[k]
        measured = scale * x + sensors.bias_increment[k]
        if sensors.noise_increment[k] > 0.0:
            measured += sensors.noise_increment[k] * normal(sensors, k)
        limit = sensors.range_increment
        if abs(measured) > limit:
            sensors.saturated |= 1 << k
            measured = limit if measured > 0.0 else -limit
        wanted = sensors.remainder[k] + measured / unit
        count = int(np.rint(wanted))
        if abs(count) > largest:
            sensors.saturated |= 1 << k
            count = largest if count > 0 else -largest
            wanted = float(count)
        sensors.remainder[k] = wanted - count
        sensors.counts[k] = count
