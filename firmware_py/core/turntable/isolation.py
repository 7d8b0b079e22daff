"""Isolated heading: the inner axis takes the vehicle's turn out, besides what the scheme wants.

It is turned against the change of the body's heading, times the cosine of the outer axis' angle:
whenever that is 0° or 180°, the sensors point as in a vehicle that keeps its heading. Whole turns
are dropped while the inner axis is level, where they cost nothing. The angle that is commanded
keeps within rate and acceleration of the drive, so that an axis can follow it.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.records.memory import INNER, OUTER, Isolation, Parameters, Ram
from rrins.firmware_py.core.turntable import sequencer

_CATCH_UP_S = 0.1
"""Time constant with which a small deviation from the wanted angle fades."""


@compiled
def _heading(state: Ram) -> float:
    """Return the body's heading, rad: that of its y axis, ``C_s_n`` times ``C_s_b`` transposed."""
    east, north = 0.0, 0.0
    for j in range(3):
        east += state.ins.C_s_n[0, j] * state.C_s_b[1, j]
        north += state.ins.C_s_n[1, j] * state.C_s_b[1, j]
    return math.atan2(east, north)


@compiled
def _add_turn(isolation: Isolation, heading: float) -> None:
    """Count by how much the vehicle has turned since the epoch before."""
    if isolation.known:
        change = heading - isolation.heading
        isolation.turned -= change - 2.0 * math.pi * round(change / (2.0 * math.pi))
    isolation.heading = heading
    isolation.known = True


@compiled
def _approach(isolation: Isolation, parameters: Parameters, wanted_deg: float) -> None:
    """Move the commanded angle by an epoch, within the limits of the drive.

    Its rate is that of the wanted angle, and what takes the deviation back: as much as the drive
    can brake with half its acceleration, and with `_CATCH_UP_S` close by.
    """
    dt = parameters.period_ns * 1e-9
    if not isolation.begun:
        isolation.wanted_deg = wanted_deg
        isolation.begun = True
    deviation_deg = isolation.wanted_deg - isolation.angle_deg
    acceleration = parameters.axis_acceleration_dps2
    closing_dps = min(
        abs(deviation_deg) / max(_CATCH_UP_S, 4.0 * dt),
        math.sqrt(acceleration * abs(deviation_deg)),
    )
    rate_dps = (wanted_deg - isolation.wanted_deg) / dt + math.copysign(closing_dps, deviation_deg)
    limit_dps = parameters.isolation_rate_dps
    rate_dps = min(limit_dps, max(-limit_dps, rate_dps))
    before_dps, change_dps = isolation.rate_dps, acceleration * dt
    rate_dps = min(before_dps + change_dps, max(before_dps - change_dps, rate_dps))
    isolation.angle_deg += 0.5 * (before_dps + rate_dps) * dt
    isolation.rate_dps = rate_dps
    isolation.wanted_deg = wanted_deg


@compiled
def follow(state: Ram) -> None:
    """Find by how much the vehicle has turned, and what the inner axis is told in this epoch.

    Called while the strapdown runs, after the scheme has advanced.
    """
    running, parameters = state.sequencer, state.parameters
    isolation = running.isolation
    _add_turn(isolation, _heading(state))
    if not sequencer.is_isolating(running):
        return
    outer_deg = sequencer.scheme_angle_deg(running, parameters, OUTER)
    cosine = math.cos(math.radians(outer_deg))
    if cosine * isolation.cosine <= 0.0:  # level between the two epochs
        isolation.turned -= 2.0 * math.pi * round(isolation.turned / (2.0 * math.pi))
    isolation.cosine = cosine
    inner_deg = sequencer.scheme_angle_deg(running, parameters, INNER)
    wanted_deg = inner_deg - math.degrees(isolation.turned) * cosine
    _approach(isolation, parameters, wanted_deg)
