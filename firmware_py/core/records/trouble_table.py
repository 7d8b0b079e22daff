"""The table of diagnostic trouble codes (DTC)."""

from __future__ import annotations

from collections.abc import Iterator

from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.records.redundancy_records import SensorKind
from rrins.firmware_py.core.records.troubles import (
    AidingFault,
    AxisFault,
    Debounce,
    Kind,
    Source,
    SystemFault,
    Trouble,
)

# Failure types of SAE J2012-DA.
_NO_SIGNAL = 0x31
_STUCK_IN_RANGE = 0x2A
_DATA_MEMORY = 0x44
_PARAMETER_MEMORY = 0x46
_INTERNAL = 0x49
_CONFIGURATION = 0x56
_COMPARISON = 0x62
_PLAUSIBILITY = 0x64
_NOT_REACHABLE = 0x77
_COUNTER = 0x82
_PROTECTION = 0x83
_ABOVE_RANGE = 0x85
_INVALID = 0x86
_MISSING_MESSAGE = 0x87
_BUS_OFF = 0x88
_PERFORMANCE = 0x92
_UNEXPECTED = 0x94

_CHASSIS, _NETWORK = 0x4000, 0xC000  # C0000 and U0000 of SAE J2012


def _number(base: int, part: int, failure: int) -> int:
    return (base | part) << 8 | failure


_SOURCES: tuple[tuple[Source, str, int, str], ...] = (
    (Source.AXIS_INNER, "axis_inner", 0x1301, "AXIS_INNER_STATUS"),
    (Source.AXIS_OUTER, "axis_outer", 0x1302, "AXIS_OUTER_STATUS"),
    (Source.ALTIMETER, "altimeter", 0x1401, "ALTIMETER"),
    (Source.SYNC, "sync", 0x1001, "SYNC"),
    (Source.MODE_COMMAND, "mode_command", 0x1002, "MODE_COMMAND"),
    (Source.GNSS, "gnss", 0x1402, "GNSS"),
    (Source.ODOMETER, "odometer", 0x1403, "ODOMETER"),
)

_ONCE = Debounce(events=1)

_FRAMES = {
    Kind.SILENT: ("silent", _MISSING_MESSAGE, Debounce(fail_s=0.1),
        "no {message} frames arrive, although others do"),
    Kind.STALE: ("stale", _INVALID, Debounce(fail_s=0.05),
        "{message} frames belong to an earlier epoch"),
    Kind.CRC: ("crc", _PROTECTION, Debounce(events=5), "{message} frames have a wrong CRC"),
    Kind.COUNTER: ("counter", _COUNTER, Debounce(events=5),
        "{message} frames have a wrong or repeated counter"),
    Kind.TWO_SENDERS: ("two_senders", _COMPARISON, Debounce(events=5),
        "two senders send {message}: of frames that disagree about an epoch, none is used"),
}  # fmt: skip

_SILENT_OF = {
    Source.ALTIMETER: Debounce(fail_s=0.5),
    Source.SYNC: Debounce(fail_s=0.05),
    Source.MODE_COMMAND: Debounce(fail_s=1.0),
    Source.GNSS: Debounce(fail_s=0.5),
    Source.ODOMETER: Debounce(fail_s=0.5),
}  # fmt: skip
_FITTED = {
    Source.ALTIMETER: (0, "altimeter"),
    Source.GNSS: (0, "gnss"),
    Source.ODOMETER: (0, "odometer"),
}
_TEXTS = {
    (Kind.SILENT, Source.SYNC): "no SYNC arrives: the loop runs on its own clock",
    (Kind.SILENT, Source.MODE_COMMAND): "the operator's MODE_COMMAND has stopped arriving",
    (Kind.SILENT, Source.GNSS): "no whole group of GNSS frames arrives",
    (Kind.TWO_SENDERS, Source.SYNC):
        "two senders send SYNC: the one that continues the count is used",
}  # fmt: skip

_SENSING = (
    ("absent", _NO_SIGNAL, Debounce(fail_s=0.1), "is flagged as absent"),
    ("saturated", _ABOVE_RANGE, Debounce(fail_s=0.05), "exceeds its measuring range"),
    ("stuck", _STUCK_IN_RANGE, Debounce(fail_s=0.5),
        "repeats its increment while others vary, or for longer than its noise allows"),
    ("left_out", _PLAUSIBILITY, _ONCE, "is faulty, and left out of the navigation"),
)  # fmt: skip
_SENSORS = (
    ("gyro", 0x1101,
        (Kind.GYRO_ABSENT, Kind.GYRO_SATURATED, Kind.GYRO_STUCK, Kind.GYRO_LEFT_OUT)),
    ("accelerometer", 0x1201,
        (Kind.ACCELEROMETER_ABSENT, Kind.ACCELEROMETER_SATURATED, Kind.ACCELEROMETER_STUCK,
        Kind.ACCELEROMETER_LEFT_OUT)),
)  # fmt: skip

_AXIS = (
    (AxisFault.NOT_FOLLOWING, "not_following", _NOT_REACHABLE, _ONCE,
        "does not follow its command"),
    (AxisFault.DRIVE, "drive", _INTERNAL, Debounce(fail_s=0.05), "reports a drive fault"),
    (AxisFault.ENCODER, "encoder", _PLAUSIBILITY, _ONCE,
        "has an encoder that contradicts the gyros: its angle is corrected, or not used"),
    (AxisFault.LIMIT, "limit", _ABOVE_RANGE, Debounce(fail_s=0.1),
        "turns faster than any command allows"),
    (AxisFault.ABANDONED, "abandoned", _PERFORMANCE, _ONCE,
        "did not follow in any of 8 tries: the rotation is not taken up again"),
)  # fmt: skip

_SYSTEM = (
    (SystemFault.OVERRUN, 0x1003, _PERFORMANCE, Debounce(events=3, pass_s=10.0),
        "epochs began more than a period late"),
    (SystemFault.BUS_LOAD, _NETWORK | 0x1003, _PERFORMANCE, Debounce(fail_s=1.0),
        "the bus load exceeds 80 %, averaged over 0.25 s"),
    (SystemFault.ERROR_PASSIVE, _NETWORK | 0x1004, _UNEXPECTED, _ONCE,
        "the CAN controller is error-passive"),
    (SystemFault.BUS_OFF, _NETWORK | 0x1004, _BUS_OFF, _ONCE, "the CAN controller is bus-off"),
    (SystemFault.PARAMETER_COPY_DAMAGED, 0x1005, _PARAMETER_MEMORY, _ONCE,
        "one copy of the parameter memory is damaged; the other is used"),
    (SystemFault.PARAMETERS_LOST, 0x1005, _DATA_MEMORY, _ONCE,
        "both copies of the parameter memory are damaged; the set-up values are used"),
    (SystemFault.PARAMETER_OUT_OF_LIMITS, 0x1005, _CONFIGURATION, _ONCE,
        "the parameter memory has a value beyond its limits; the set-up value is used"),
    (SystemFault.SELF_TEST_FAILED, 0x1006, _INTERNAL, _ONCE, "the self-test failed"),
    (SystemFault.ALIGNMENT_FAILED, 0x1007, _PLAUSIBILITY, _ONCE,
        "the alignment found no attitude: the vehicle moves, or a sensor is faulty"),
    (SystemFault.ALIGNMENT_NOT_CONVERGED, 0x1007, _PERFORMANCE, _ONCE,
        "the alignment has taken more than twice its time"),
    (SystemFault.SENSORS_LOST, 0x1008, _NO_SIGNAL, _ONCE,
        "too few sensors were usable for longer than the bridging limit"),
    (SystemFault.NAVIGATION_IMPLAUSIBLE, 0x1008, _PLAUSIBILITY, _ONCE,
        "the navigation solution is impossible for a vehicle"),
    (SystemFault.NAVIGATION_BRIDGED, 0x1008, _PERFORMANCE, _ONCE,
        "more than 1 s of the last 100 s was bridged: the navigation is degraded"),
    (SystemFault.RESTARTED, 0x1008, _UNEXPECTED, _ONCE,
        "began beside running hardware: the position was the set-up's"),
    (SystemFault.CLOCK_JUMP, _NETWORK | 0x1001, _PLAUSIBILITY, Debounce(events=1, pass_s=10.0),
        "SYNC jumped in epoch or time"),
    (SystemFault.CLOCK_OFF_NOMINAL, _NETWORK | 0x1001, _PERFORMANCE, Debounce(fail_s=5.0),
        "the period of SYNC deviates by more than 300 ppm"),
    (SystemFault.GYROS_INCONSISTENT, 0x1100, _PLAUSIBILITY, Debounce(fail_s=5.0),
        "the gyros disagree: one of them is faulty"),
    (SystemFault.ACCELEROMETERS_INCONSISTENT, 0x1200, _PLAUSIBILITY, Debounce(fail_s=5.0),
        "the accelerometers disagree: one of them is faulty"),
    (SystemFault.GYROS_NOT_REDUNDANT, 0x1100, _PERFORMANCE, _ONCE,
        "too few gyros are in use, or received, to check each other"),
    (SystemFault.ACCELEROMETERS_NOT_REDUNDANT, 0x1200, _PERFORMANCE, _ONCE,
        "too few accelerometers are in use, or received, to check each other"),
    (SystemFault.GYRO_CALIBRATION_DRIFTED, 0x1100, _COMPARISON, _ONCE,
        "scale factors or installation of the gyros are not as they were calibrated"),
    (SystemFault.ACCELEROMETER_CALIBRATION_DRIFTED, 0x1200, _COMPARISON, _ONCE,
        "scale factors or installation of the accelerometers are not as they were calibrated"),
)  # fmt: skip

_AIDING = (
    (AidingFault.GNSS_LOST, "gnss", 0x1402, _NO_SIGNAL, "the GNSS receiver has no fix"),
    (AidingFault.ODOMETER_LOST, "odometer", 0x1403, _NO_SIGNAL, "the odometer does not count"),
    (AidingFault.GNSS_REJECTED, "gnss", 0x1402, _PLAUSIBILITY,
        "the fixes contradict the navigation; they are not used"),
    (AidingFault.ODOMETER_REJECTED, "odometer", 0x1403, _PLAUSIBILITY,
        "the odometer contradicts the navigation; it is not used"),
    (AidingFault.ALTIMETER_REJECTED, "altimeter", 0x1401, _PLAUSIBILITY,
        "the altimeter contradicts the navigation; it is not used"),
    (AidingFault.ZERO_VELOCITY_REJECTED, "estimator", 0x1404, _PLAUSIBILITY,
        "a vehicle that stands, as was declared or found, moves by the navigation; it is not used"),
    (AidingFault.KNOWN_POSITION_REJECTED, "estimator", 0x1404, _PERFORMANCE,
        "the position changes by the navigation in the fine alignment; it is not taken as known"),
    (AidingFault.GATE_OPENED, "gnss", 0x1402, _PERFORMANCE,
        "the navigation rejected all fixes for 120 s, and nothing else aided it: it doubts itself, "
        "and takes them again"),
)  # fmt: skip


def _frame_troubles() -> Iterator[Trouble]:
    for kind, (name, failure, debounce, text) in _FRAMES.items():
        for group in range(SENSOR_GROUPS):
            message = f"SENSOR_{group + 1}"
            number, stem = _number(_NETWORK, 0x1101 + group, failure), f"sensor_{group + 1}_{name}"
            words, bit = text.format(message=message), Source.SENSOR_1 + group
            yield Trouble(number, stem, words, kind, bit, debounce, group)
        for source, stem, part, message in _SOURCES:
            if kind == Kind.STALE and source > Source.ALTIMETER:
                continue  # never stale: a repeated frame has a wrong counter
            if kind == Kind.TWO_SENDERS and source >= Source.MODE_COMMAND:
                continue  # any operator may send it; aiding that disagrees is not used
            yield Trouble(
                _number(_NETWORK, part, failure),
                f"{stem}_{name}",
                _TEXTS.get((kind, source), text.format(message=message)),
                kind,
                source,
                _SILENT_OF.get(source, debounce) if kind == Kind.SILENT else debounce,
                *_FITTED.get(source, ()),
            )


def _sensor_troubles() -> Iterator[Trouble]:
    for sensor, part, kinds in _SENSORS:
        for kind, (name, failure, debounce, text) in zip(kinds, _SENSING, strict=True):
            for group in range(SENSOR_GROUPS):
                number = _number(_CHASSIS, part + group, failure)
                stem, words = f"{sensor}_{group + 1}_{name}", f"{sensor} {group + 1} {text}"
                yield Trouble(number, stem, words, kind, group, debounce, group, sensor)


def _other_troubles() -> Iterator[Trouble]:
    for fault, name, failure, debounce, text in _AXIS:
        for axis, which in enumerate(("inner", "outer")):
            number, words = _number(_CHASSIS, 0x1301 + axis, failure), f"the {which} axis {text}"
            stem = f"axis_{which}_{name}"
            yield Trouble(number, stem, words, Kind.AXIS, fault + axis, debounce)
    for system, part, failure, debounce, text in _SYSTEM:
        number = _number(0 if part & _NETWORK else _CHASSIS, part, failure)
        yield Trouble(number, system.name.lower(), text, Kind.SYSTEM, system, debounce)


def _aiding_troubles() -> Iterator[Trouble]:
    for fault, needs, part, failure, text in _AIDING:
        number = _number(_CHASSIS, part, failure)
        yield Trouble(number, fault.name.lower(), text, Kind.AIDING, fault, _ONCE, 0, needs)


_ALL = (*_frame_troubles(), *_sensor_troubles(), *_other_troubles(), *_aiding_troubles())
TROUBLES = tuple(sorted(_ALL, key=lambda trouble: (trouble.kind, trouble.bit)))
"""All trouble codes, ordered by kind and bit, as in the RAM image."""

_PARITY_SYSTEM = {
    SystemFault.GYROS_INCONSISTENT: SensorKind.GYRO,
    SystemFault.GYROS_NOT_REDUNDANT: SensorKind.GYRO,
    SystemFault.ACCELEROMETERS_INCONSISTENT: SensorKind.ACCELEROMETER,
    SystemFault.ACCELEROMETERS_NOT_REDUNDANT: SensorKind.ACCELEROMETER,
}


def _parity_kind(trouble: Trouble) -> SensorKind | None:
    if trouble.kind == Kind.GYRO_LEFT_OUT:
        return SensorKind.GYRO
    if trouble.kind == Kind.ACCELEROMETER_LEFT_OUT:
        return SensorKind.ACCELEROMETER
    return _PARITY_SYSTEM.get(SystemFault(trouble.bit)) if trouble.kind == Kind.SYSTEM else None


PARITY_KIND = {
    index: kind
    for index, trouble in enumerate(TROUBLES)
    if (kind := _parity_kind(trouble)) is not None
}
"""Kind of the sensors whose parity is in a trouble code's freeze frames, by index of the code."""

FIRST = tuple(
    next(index for index, trouble in enumerate(TROUBLES) if trouble.kind == kind) for kind in Kind
)
"""Index of each kind's first trouble code."""
