"""Records of the comparison of the encoders with the gyros, in the RAM image."""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated

from rrins.compiled.record import F8, I8, Bytes, Floats, Integers, Record
from rrins.firmware_py.core.maths.angles import Angle


class AngleSource(IntEnum):
    """Where the angle of an axis comes from; the DBC's value table of the same name."""

    ENCODER = 0
    CORRECTED = 1  # the encoder, less an offset
    GYROS = 2
    COMMAND = 3  # what the scheme expects: while the vehicle moves


class Encoders(Record):
    """The encoders, compared with the gyros and the commands; arrays over the two axes."""

    step_deg: F8  #: of the coarsest encoder
    seen: Annotated[Bytes, 2]  #: whether there was a reading, 0 or 1
    reading_deg: Annotated[Floats, 2]  #: the last one
    angle_deg: Annotated[Floats, 2]  #: of the axis, as used
    increment_deg: Annotated[Floats, 2]  #: of the axis, in the last epoch
    gyro_deg: Annotated[Floats, 2]  #: the gyros' increment about the axis, in the last epoch
    since_epochs: Annotated[Integers, 2]  #: since the last reading
    since_deg: Annotated[Floats, 2]  #: the gyros' increments since then
    since_known: Annotated[Bytes, 2]  #: whether none of them was bridged, 0 or 1
    expected_deg: Annotated[Floats, 2]  #: the commanded angle
    contradiction_deg: Annotated[Floats, 2]  #: encoder less gyros, lately
    missed_deg: Annotated[Floats, 2]  #: encoder less gyros, since they were last close
    apart_epochs: Annotated[Integers, 2]  #: since then
    disobedience_deg: Annotated[Floats, 2]  #: gyros less command, lately
    obedient_epochs: Annotated[Integers, 2]  #: since gyros and command were far apart
    jumping_epochs: Annotated[Integers, 2]  #: of jumps in a row
    source: Annotated[Integers, 2]  #: an `AngleSource`
    offset_deg: Annotated[Floats, 2]  #: reading less angle
    uncertain_deg: Annotated[Floats, 2]  #: of the offset
    anchor_deg: Annotated[Floats, 2]  #: offset from which it has not moved lately
    agreed_epochs: Annotated[Integers, 2]  #: since it moved
    agreed_deg: Annotated[Floats, 2]  #: turned since then, by the encoder
    lag_deg: Annotated[Floats, 2]  #: angle less commanded angle
    strayed_deg: Annotated[Floats, 2]  #: by how much that has changed while the axis was to turn
    unfelt_deg: Annotated[Floats, 2]  #: gyros less angle, since that was more than rounding
    doubted: Annotated[Bytes, 2]  #: whether it was much, and the gyros have not felt it
    found_epoch: Annotated[Integers, 2]  #: in which the last fault was found, plus 1; 0: none
    transmissions: I8  #: of TABLE_STATUS, for its counter
    turn_s: Annotated[Floats, 3]  #: rad, fused less the Earth's, in this epoch
    middle: Angle  #: of the inner axis, in the middle of this epoch
