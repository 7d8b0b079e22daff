"""Sums over a second of a calibration: the sensors' increments, and how the table turned meanwhile.

With ``C_s_b = Rx(αO) Rz(αI)`` all that sound sensors measure on a table at rest follows from the
integrals of cosines and sines of its angles, whatever its motion within the second:
`rrins.host_tools.calibration.model` has the equations.
"""

from __future__ import annotations

import math
from typing import Annotated

from rrins.compiled.compilation import compiled
from rrins.compiled.record import I8, Bool, Floats, Record, Records
from rrins.dbc.codec import unwrapped
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.records.memory import INNER, OUTER, Fusion, Ram

ORIENTATIONS = 8
"""Integrals over time of cI, sI, cO, sO, cI cO, cI sO, sI cO, sI sO."""

TURNS = 4
"""Turns of the inner and the outer axis, and the integrals of cI and sI over the outer's angle."""


class TableSums(Record):
    """A second of a calibration."""

    begun: Bool  #: whether the angles of the epoch before are known
    epochs: I8  #: summed
    gyro_missing: I8  #: gyros that were not valid in an epoch, one bit each
    accelerometer_missing: I8  #: accelerometers that were not valid in an epoch, one bit each
    axis_missing: Bool  #: whether an axis' frame was missing in an epoch
    angle_before: Annotated[Floats, 2]  #: rad, at the end of the epoch before
    orientation: Annotated[Floats, ORIENTATIONS]  #: s
    turn: Annotated[Floats, TURNS]  #: rad
    gyro: Annotated[Floats, SENSOR_GROUPS]  #: rad, as measured, without calibration
    accelerometer: Annotated[Floats, SENSOR_GROUPS]  #: m/s, as measured, without calibration
    rotation_s: Annotated[Floats, 3]  #: rad, fused
    velocity_s: Annotated[Floats, 3]  #: m/s, fused


@compiled
def begin(sums: TableSums) -> None:
    """Begin the next second, where the one before ended."""
    sums.epochs = 0
    sums.gyro_missing = 0
    sums.accelerometer_missing = 0
    sums.axis_missing = False
    for k in range(ORIENTATIONS):
        sums.orientation[k] = 0.0
    for k in range(TURNS):
        sums.turn[k] = 0.0
    for k in range(SENSOR_GROUPS):
        sums.gyro[k] = 0.0
        sums.accelerometer[k] = 0.0
    for k in range(3):
        sums.rotation_s[k] = 0.0
        sums.velocity_s[k] = 0.0


@compiled
def _measured(fusion: Fusion, k: int, compensated: float) -> float:
    """Return an increment as it was before `fusion.compensate`."""
    if not fusion.calibrated:
        return compensated
    scale = 1.0 + fusion.scale_error[k]
    if compensated > 0.0:
        scale += fusion.asymmetric_scale_error[k]
    elif compensated < 0.0:
        scale -= fusion.asymmetric_scale_error[k]
    return compensated * scale + fusion.bias_increment[k]


@compiled
def _add_orientation(sums: TableSums, inner: float, outer: float, seconds: float) -> None:
    ci, si = math.cos(inner), math.sin(inner)
    co, so = math.cos(outer), math.sin(outer)
    total = sums.orientation
    total[0] += seconds * ci
    total[1] += seconds * si
    total[2] += seconds * co
    total[3] += seconds * so
    total[4] += seconds * ci * co
    total[5] += seconds * ci * so
    total[6] += seconds * si * co
    total[7] += seconds * si * so


@compiled
def add(ram: Records[Ram], records: Records[TableSums]) -> None:
    """Add the epoch that the firmware has just stepped through.

    Parameters
    ----------
    ram : Records[Ram]
        One record; only read.
    records : Records[TableSums]
        One record. The first epoch only tells it where the axes are.
    """
    state, sums = ram[0], records[0]
    assembly = state.assembly
    span = math.radians(state.parameters.angle_span_deg)
    dt = state.parameters.period_ns * 1e-9
    inner, outer = sums.angle_before[INNER], sums.angle_before[OUTER]
    inner_end = math.radians(assembly.encoder_angle_deg[INNER])
    outer_end = math.radians(assembly.encoder_angle_deg[OUTER])
    sums.angle_before[INNER] = inner_end
    sums.angle_before[OUTER] = outer_end
    if not sums.begun:
        sums.begun = True
        return
    dinner = unwrapped(inner_end, inner, span) - inner
    douter = unwrapped(outer_end, outer, span) - outer
    # Simpson's rule: in an epoch an axis turns steadily, and by little.
    for step in range(3):
        weight = 4.0 / 6.0 if step == 1 else 1.0 / 6.0
        share = 0.5 * step
        _add_orientation(sums, inner + share * dinner, outer + share * douter, weight * dt)
    middle = inner + 0.5 * dinner
    sums.turn[0] += dinner
    sums.turn[1] += douter
    sums.turn[2] += math.cos(middle) * douter
    sums.turn[3] += math.sin(middle) * douter
    gyros, accelerometers = state.gyros, state.accelerometers
    for k in range(gyros.count):
        sums.gyro[k] += _measured(gyros, k, assembly.gyro_dtheta[k])
    for k in range(accelerometers.count):
        sums.accelerometer[k] += _measured(accelerometers, k, assembly.accelerometer_dv[k])
    for k in range(3):
        sums.rotation_s[k] += state.dtheta_s[k]
        sums.velocity_s[k] += state.dv_s[k]
    every_gyro, every_accelerometer = (1 << gyros.count) - 1, (1 << accelerometers.count) - 1
    sums.gyro_missing |= every_gyro & ~assembly.gyro_valid
    sums.accelerometer_missing |= every_accelerometer & ~assembly.accelerometer_valid
    if not (assembly.axis_received[INNER] and assembly.axis_received[OUTER]):
        sums.axis_missing = True
    sums.epochs += 1
