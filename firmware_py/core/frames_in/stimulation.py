"""Increments of a tool in the place of what the sensors sent (XCP STIM)."""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.records.memory import Ram


@compiled
def apply(state: Ram) -> None:
    """Replace increments of this epoch, once: the next epoch is the sensors' own again.

    A sensor whose frame did not arrive stays silent.
    """
    given, assembly = state.stimulation, state.assembly
    for k in range(SENSOR_GROUPS):
        bit = 1 << k
        if given.gyros & bit:
            assembly.gyro_dtheta[k] = given.gyro_dtheta[k]
        if given.accelerometers & bit:
            assembly.accelerometer_dv[k] = given.accelerometer_dv[k]
    given.gyros = 0
    given.accelerometers = 0
