"""Seconds of a scheme without measurements: how the table turns, at the full rate throughout."""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.record import Floats
from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.calibration.seconds import Seconds
from rrins.host_tools.rotation.kinematics import INNER, OUTER, Leg, legs_of

_POINTS = 9
"""Of Simpson's rule within a second; at 60 °/s it errs by 1e-6."""


def seconds_of(scheme: Scheme, gyros: int, accelerometers: int) -> Seconds:
    """Return the seconds of a cycle, all sums of sensors zero."""
    parts = [of_leg(leg, gyros, accelerometers) for leg in legs_of(scheme)]
    whole = parts[0]
    for part in parts[1:]:
        whole = whole + part
    return whole


def of_leg(leg: Leg, gyros: int, accelerometers: int) -> Seconds:
    """Return the seconds of a turn or a rest; the last is shorter."""
    count = max(1, math.ceil(leg.duration_s - 1e-9))
    begin = np.minimum(np.arange(count, dtype=float), leg.duration_s)
    end = np.minimum(begin + 1.0, leg.duration_s)
    angles = []
    for axis in (INNER, OUTER):
        turned = leg.turn_deg / leg.duration_s if leg.axis == axis else 0.0
        angles.append((leg.start_deg[axis], turned))
    share = np.linspace(0.0, 1.0, _POINTS)
    time = begin[:, None] + (end - begin)[:, None] * share
    inner, outer = (np.radians(start + rate * time) for start, rate in angles)
    weights = np.where(np.arange(_POINTS) % 2 == 1, 4.0, 2.0)
    weights[[0, -1]] = 1.0
    weights /= weights.sum()
    T = end - begin
    ci, si, co, so = np.cos(inner), np.sin(inner), np.cos(outer), np.sin(outer)
    products = (ci, si, co, so, ci * co, ci * so, si * co, si * so)
    orientation = np.column_stack([T * (product @ weights) for product in products])
    return Seconds(
        epoch=np.zeros(count),
        duration_s=T,
        position=np.full(count, leg.position - 1),
        gyro_usable=np.ones((count, gyros), dtype=bool),
        accelerometer_usable=np.ones((count, accelerometers), dtype=bool),
        angles_deg=np.column_stack([start + rate * end for start, rate in angles]),
        orientation=orientation,
        turn=_turn(leg, T, ci[:, 0], si[:, 0]),
        gyro=np.zeros((count, gyros)),
        accelerometer=np.zeros((count, accelerometers)),
    )


def _turn(leg: Leg, T: Floats, cosine: Floats, sine: Floats) -> Floats:
    """Return the turns of the seconds; while the outer axis turns, the inner one rests."""
    turned = leg.rate * T if leg.axis is not None else np.zeros_like(T)
    zero = np.zeros_like(T)
    if leg.axis == INNER:
        return np.column_stack([turned, zero, zero, zero])
    return np.column_stack([zero, turned, cosine * turned, sine * turned])
