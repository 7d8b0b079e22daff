"""Records of the integrity: what each fault would do to the navigation, and the bounds."""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated

from rrins.compiled.record import F8, I8, Bool, Floats, Integers, Record, Records
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.records.estimator_records import (
    AIDS,
    BIASES,
    COMPONENTS,
    STATE_CAPACITY,
)

RUNGS = 11
AGES = RUNGS + 2
SINCE_BEGIN, SUSPECT, AT_BEGIN = RUNGS, RUNGS + 1, RUNGS + 2
"""Times since which a fault is assumed to last: those of a ladder, then since the filter began, and
since when it has shown most. The last is the beginning, too, for a fault that the parity has
learned, as if it were a bias."""

OTHER_FAULTS = 13
GNSS_STEP, GNSS_DRIFT, ODOMETER_FAULT, ALTIMETER_FAULT, ALTIMETER_DRIFT = 0, 3, 6, 7, 8
"""Faults of the aids, each with the components of a fix where there are some: latitude, longitude,
height. A step is an offset of the position (m), a drift is one of the velocity that also moves the
position (m/s). The odometer's scale (1) and the altimeter's bias (m) change, or that drifts (m/s).
"""

ALL_GYROS, ALL_ACCELEROMETERS = 9, 10
"""The scale (1) of all sensors of a kind alike, which the parity does not show."""

GYROS_SHIFT, ACCELEROMETERS_SHIFT = 11, 12
"""The bias of all sensors of a kind alike."""

FAULT_CAPACITY = 2 * SENSOR_GROUPS + OTHER_FAULTS
TABLE_FAULT = FAULT_CAPACITY
"""Number of what has no effect to be followed: an angle of the table that is in doubt."""

RECEIVER, ODOMETER, ALTIMETER = 0, 1, 2
"""Devices that aid, whose refused measurements count apart."""

DEVICES = 3
CHANNELS = DEVICES + COMPONENTS - 1
"""Latitude, longitude and height of the receiver, with their velocities; odometer; altimeter."""

HORIZONTAL, VERTICAL, HEADING = 0, 1, 2
"""Bounds: m, m, rad."""

BOUNDS = 3


class IntegrityStatus(IntEnum):
    """Whether the navigation can be trusted; the DBC's value table of `status`."""

    OFF = 0
    AVAILABLE = 1
    DEGRADED = 2
    NOT_AVAILABLE = 3


class Verdict(IntEnum):
    """The verdict on a device since a measurement of it was refused."""

    NONE = 0  # nothing is refused, nor was of late
    ASKED = 1  # it is to be judged in this second
    OPEN = 2  # it may be right
    OWN_FAULT = 3  # the device fails, for certain
    PASSED = 4  # it did, and agrees again, but not yet often enough


class Effect(Record):
    """Effect of a fault of size 1 on the error that the filter leaves."""

    state: Annotated[Floats, STATE_CAPACITY]
    begun_s: I8  #: second of the filter in which the fault began
    information: F8  #: of the innovations within the gate about the fault's size
    correlation: F8  #: of these with what the fault would make of them
    refused_information: Annotated[Floats, CHANNELS]  #: of those refused, apart from it
    refused_correlation: Annotated[Floats, CHANNELS]  #: of these
    left: F8  #: of an aid's fault: mean square of the innovations that it does not explain, of late


class Fault(Record):
    """A fault that may have happened: its effect, for each time since which it may last."""

    sensor: I8  #: of its kind; -1: none, or all
    present: Bool  #: whether the unit has the part
    known: F8  #: information about its size before it shows: 1 over the variance
    young_s: F8  #: in which one begins with the probability that young faults may have
    odds: Annotated[Floats, AGES + 1]  #: 2 ln of its probability over an equal share of the risk
    allowed: F8  #: 2 ln of its own share over that, where nothing shows it
    effects: Annotated[Records[Effect], AGES]


class Integrity(Record):
    """Protection levels: bounds of the error that is exceeded no more often than stated."""

    enabled: Bool
    alert: Annotated[Floats, BOUNDS]  #: m, m, rad: beyond, the navigation is of no use
    faultless: F8  #: standard deviations of the error without a fault
    certain: F8  #: `Fault.odds` of what is there for certain
    faults: Annotated[Records[Fault], FAULT_CAPACITY]
    driven: Annotated[Floats, (2, BIASES)]  #: by a scale of 1 of all of a kind, in this second
    seconds: I8  #: since the filter began
    noted: I8  #: seconds that the filter has noted, an epoch ago
    compared: Annotated[Integers, 2]  #: by kind: seconds that the parity had taken a second ago
    idle_s: Annotated[Integers, 2]  #: by kind: seconds in which the parity took none
    refused: Annotated[Floats, COMPONENTS]  #: m: the last fix beyond the gate, its noise included
    owed: Annotated[Integers, (AIDS, COMPONENTS)]  #: that have to agree, since one was refused
    verdicts: Annotated[Integers, DEVICES]  #: a `Verdict` on what is owed
    excess: Annotated[Floats, CHANNELS]  #: 2 ln of how far beyond the risk a device's fault is
    agreement: F8  #: mean square of the normalised innovations, of late
    protection: Annotated[Floats, BOUNDS]  #: m, m, rad; infinite where there is no bound
    limit: Annotated[Integers, BOUNDS]  #: number of the fault that sets each bound; -1: none does
    status: I8  #: an `IntegrityStatus`
    suspected: Bool  #: whether a fault is suspected that is not resolved
    unmonitored: Bool  #: whether redundant sensors are not compared, or one is left out
    refusing: Bool  #: whether an aid is refused
    counts: Annotated[Integers, 4]  #: by `IntegrityStatus`: seconds of navigation
    transmissions: I8  #: of INTEGRITY, for its counter
    sigmas: Annotated[Floats, BOUNDS]  #: scratch
    sums: Annotated[Floats, BOUNDS]  #: scratch
