"""Records of a start by transfer: what the master sends, and how it is carried on."""

from __future__ import annotations

from typing import Annotated

from rrins.compiled.record import F8, I8, Bool, Floats, Record, Words

MASTER_FRAMES = 8
"""Frames of a transfer."""

INCREMENT_EPOCHS = 2048
"""Epochs of increments that are kept, for transfers of the past; 2 s at 1 kHz."""


class Master(Record):
    """The master unit: the group of frames of this epoch, and the latest transfer."""

    arrived: I8  #: frames of this epoch's group, one bit each
    refused: Bool  #: whether two frames disagree about this epoch
    word: Annotated[Words, MASTER_FRAMES]  #: payloads of the group
    silent_epochs: I8  #: since the last whole group
    valid: Bool  #: whether it navigates, as last received
    transfers: I8  #: since power-on
    too_old: I8  #: transfers that were not used for their age
    age_epochs: I8  #: since the latest transfer was valid
    epoch: I8  #: in which the latest transfer was valid
    before_end_ns: I8  #: from then to the end of that epoch
    level_sigma: F8  #: rad, of roll and of pitch
    heading_sigma: F8  #: rad
    velocity_sigma: F8  #: m/s, of each component
    position_sigma: F8  #: m, of each component
    roll: F8  #: rad, of the body
    pitch: F8  #: rad, of the body
    heading: F8  #: rad, of the body
    latitude: F8  #: rad
    longitude: F8  #: rad
    height: F8  #: m
    velocity_n: Annotated[Floats, 3]  #: m/s


class Transfer(Record):
    """The latest transfer on its way to the present epoch, and the increments that carry it."""

    increments: Annotated[Floats, (INCREMENT_EPOCHS, 6)]  #: dtheta_s, dv_s by epoch, a ring
    axis_angle: Annotated[Floats, (INCREMENT_EPOCHS, 2)]  #: rad, at the end of each epoch, a ring
    first: I8  #: epoch from which on the rings are whole
    last: I8  #: epoch, of the rings
    left_out: I8  #: sensors left out, one bit each, accelerometers above gyros
    begun: Bool  #: whether a transfer is carried
    taken: I8  #: its number since power-on
    epoch: I8  #: at whose end the carried navigation stands
    partial: Annotated[Floats, (2, 3)]  #: share of an epoch's increments, scratch
    C_s_b: Annotated[Floats, (3, 3)]  #: scratch
    C_b_n: Annotated[Floats, (3, 3)]  #: scratch
    C_s_n: Annotated[Floats, (3, 3)]  #: scratch
