"""Record of the increments that a tool has put in the place of the sensors'."""

from __future__ import annotations

from typing import Annotated

from rrins.compiled.record import I8, Floats, Record
from rrins.dbc.contract import SENSOR_GROUPS


class Stimulation(Record):
    """Increments of a tool for the next step, which replace what those sensors sent (XCP STIM)."""

    gyros: I8  #: gyros that are replaced, one bit each
    accelerometers: I8  #: accelerometers that are replaced, one bit each
    gyro_dtheta: Annotated[Floats, SENSOR_GROUPS]  #: rad, along the input axes
    accelerometer_dv: Annotated[Floats, SENSOR_GROUPS]  #: m/s, along the input axes
