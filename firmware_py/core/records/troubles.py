"""The definition of a diagnostic trouble code (DTC); `trouble_table` lists them all.

A number has three bytes: two name the part, as SAE J2012-DA writes codes (``C1103`` is 0x5103,
``U1103`` 0xD103), the third is a failure type of SAE J2012-DA. The step reports faults as bits in
one word per `Kind`; a trouble code is one bit of one kind.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from rrins.dbc.contract import SENSOR_GROUPS

AGING_CYCLES = 40
"""Operation cycles without the fault after which a confirmed trouble code is erased."""

STATUS_AVAILABILITY = 0x7F
"""Bits of the status byte that the firmware supports: all but warningIndicatorRequested."""

FORMAT_IDENTIFIER = 0x01
"""DTCFormatIdentifier: ISO_14229-1_DTCFormat."""

ALL_GROUPS = 0xFFFFFF
"""groupOfDTC for all trouble codes."""


class Status(IntEnum):
    """Bits of a trouble code's status byte (ISO 14229-1, annex D.2)."""

    TEST_FAILED = 0x01
    TEST_FAILED_THIS_OPERATION_CYCLE = 0x02
    PENDING = 0x04
    CONFIRMED = 0x08
    TEST_NOT_COMPLETED_SINCE_LAST_CLEAR = 0x10
    TEST_FAILED_SINCE_LAST_CLEAR = 0x20
    TEST_NOT_COMPLETED_THIS_OPERATION_CYCLE = 0x40
    WARNING_INDICATOR_REQUESTED = 0x80


CLEARED_STATUS = int(
    Status.TEST_NOT_COMPLETED_SINCE_LAST_CLEAR | Status.TEST_NOT_COMPLETED_THIS_OPERATION_CYCLE
)
"""Status byte of a trouble code after clearing."""


class Kind(IntEnum):
    """Kinds of faults; each has one word of bits in the RAM image."""

    SILENT = 0
    STALE = 1
    CRC = 2
    COUNTER = 3
    GYRO_ABSENT = 4
    GYRO_SATURATED = 5
    GYRO_STUCK = 6
    ACCELEROMETER_ABSENT = 7
    ACCELEROMETER_SATURATED = 8
    ACCELEROMETER_STUCK = 9
    AXIS = 10
    SYSTEM = 11
    TWO_SENDERS = 12
    GYRO_LEFT_OUT = 13
    ACCELEROMETER_LEFT_OUT = 14
    AIDING = 15


class Source(IntEnum):
    """Sources of frames: the bits of SILENT, STALE, CRC, COUNTER and TWO_SENDERS."""

    SENSOR_1 = 0
    AXIS_INNER = SENSOR_GROUPS
    AXIS_OUTER = SENSOR_GROUPS + 1
    ALTIMETER = SENSOR_GROUPS + 2
    SYNC = SENSOR_GROUPS + 3
    MODE_COMMAND = SENSOR_GROUPS + 4
    GNSS = SENSOR_GROUPS + 5
    ODOMETER = SENSOR_GROUPS + 6


class AxisFault(IntEnum):
    """First bit of each fault of an axis in AXIS: the inner axis, then the outer."""

    NOT_FOLLOWING = 0
    DRIVE = 2
    ENCODER = 4
    LIMIT = 6
    ABANDONED = 8


class SystemFault(IntEnum):
    """Bits of SYSTEM."""

    OVERRUN = 0
    BUS_LOAD = 1
    ERROR_PASSIVE = 2
    BUS_OFF = 3
    PARAMETER_COPY_DAMAGED = 4
    PARAMETERS_LOST = 5
    PARAMETER_OUT_OF_LIMITS = 6
    SELF_TEST_FAILED = 7
    ALIGNMENT_FAILED = 8
    ALIGNMENT_NOT_CONVERGED = 9
    SENSORS_LOST = 10
    NAVIGATION_IMPLAUSIBLE = 11
    CLOCK_JUMP = 12
    CLOCK_OFF_NOMINAL = 13
    GYROS_INCONSISTENT = 14
    ACCELEROMETERS_INCONSISTENT = 15
    GYROS_NOT_REDUNDANT = 16
    ACCELEROMETERS_NOT_REDUNDANT = 17
    NAVIGATION_BRIDGED = 18
    GYRO_CALIBRATION_DRIFTED = 19
    ACCELEROMETER_CALIBRATION_DRIFTED = 20
    RESTARTED = 21


class AidingFault(IntEnum):
    """Bits of AIDING."""

    GNSS_LOST = 0
    ODOMETER_LOST = 1
    GNSS_REJECTED = 2
    ODOMETER_REJECTED = 3
    ALTIMETER_REJECTED = 4
    GATE_OPENED = 5
    ZERO_VELOCITY_REJECTED = 6
    KNOWN_POSITION_REJECTED = 7


@dataclass(frozen=True)
class Debounce:
    """When a test counts as failed or passed.

    A fault detection counter goes up in each epoch with the fault and down in each without it; at
    127 the test has failed, at -128 it has passed. At the onset of a fault it is at least 0.
    """

    fail_s: float = 0.0  #: how long a fault must last; 0 if `events` is given
    events: int = 0  #: alternatively, the number of epochs with the fault
    #: how long the fault must be absent, from a counter of 127 to 0, and from 0 to -128
    pass_s: float = 1.0

    def fail_epochs(self, rate_hz: float) -> float:
        """Return the number of epochs with the fault; half an event may be forgotten meanwhile."""
        return max(1.0, self.events - 0.5 if self.events else round(self.fail_s * rate_hz))

    def pass_epochs(self, rate_hz: float) -> int:
        """Return the number of epochs without the fault."""
        return max(1, round(self.pass_s * rate_hz))

    def __str__(self) -> str:
        fails = f"{self.events} epochs" if self.events else f"{self.fail_s:g} s"
        return f"{fails} / {self.pass_s:g} s"


@dataclass(frozen=True)
class Trouble:
    """A trouble code."""

    number: int  #: three bytes
    name: str
    text: str
    kind: Kind
    bit: int  #: of the kind's word
    debounce: Debounce
    #: its sensor group, from 0; -1 for none. The firmware has the trouble codes of the groups in
    #: its set-up.
    group: int = -1
    #: "gyro" or "accelerometer" if the group must have one; a source of aiding if one must be
    #: fitted: "altimeter", "gnss" or "odometer"; "estimator" if it must be enabled
    needs: str = ""

    @property
    def code(self) -> str:
        """The number as SAE J2012-DA writes it, such as ``U1103-87``."""
        high, failure = self.number >> 8, self.number & 0xFF
        return f"{'PCBU'[high >> 14]}{high & 0x3FFF:04X}-{failure:02X}"


SNAPSHOT_IDENTIFIERS = ("epoch", "mode", "axis_angles", "position", "velocity", "attitude")
"""Names of the data identifiers in a freeze frame."""

FIRST_SNAPSHOT, LATEST_SNAPSHOT = 0x01, 0x02
"""Numbers of a trouble code's freeze frames: first and latest occurrence."""

ALL_RECORDS = 0xFF
"""Record number for all freeze frames, or all extended data, of a trouble code."""
