"""What is wrong, in plain lines: what the firmware says, and what the bus shows."""

from __future__ import annotations

from collections.abc import Iterator

from host_tools.faults import FaultKind
from host_tools.monitor.state import BusState, MessageState
from host_tools.monitor.vitals import AXES, Vitals
from host_tools.monitor.wording import age_words, rate_words

HIGH_LOAD = 0.8
"""Share of the bus time, or of the firmware's period, above which load is a trouble."""

_EVENTS = (  # nobody waits for these
    "MODE_COMMAND",
    "FAULT_COMMAND",
    "FAULT_STATUS",
    "FAULT_ACTIVE",
    "FAULT_TIMES",
    "HARDWARE_FAULT_COMMAND",
    "HARDWARE_FAULT_STATUS",
    "HARDWARE_FAULT_ACTIVE",
    "HARDWARE_FAULT_TIMES",
)
_NAVIGATION_PREFIX = "NAV_"  # sent in navigation only
_SENSOR_PREFIX = "SENSOR_"
_DIAGNOSIS = (0x7DF, *range(0x7E0, 0x7F0))  # ISO 15765-4, identifiers of diagnostic requests


def troubles_of(state: BusState, vitals: Vitals) -> list[str]:
    """Return what is wrong now, the gravest first; nothing when all is well."""
    return [
        *_of_firmware(vitals),
        *_of_axes(vitals),
        *_of_sensors(state, vitals),
        *_of_silence(state, vitals),
        *_of_messages(state),
        *_of_counters(vitals),
        *_of_bus(state),
        *_of_wire(state),
    ]


def _of_firmware(vitals: Vitals) -> Iterator[str]:
    firmware = vitals.firmware
    if firmware is None:
        return
    if firmware.mode == "FAULT":
        yield f"mode FAULT: {firmware.fault}"
    if firmware.sync_lost:
        yield "the firmware has lost SYNC and runs on its own clock"
    if firmware.load_percent > 100 * HIGH_LOAD:
        yield f"the firmware computes for {firmware.load_percent:.0f} % of its period"


def _of_axes(vitals: Vitals) -> Iterator[str]:
    for name in AXES:
        axis = vitals.axes[name]
        if axis is None:
            continue
        if axis.follows is False:
            yield f"the {name} axis did not follow its command"
        if axis.state == "FAULT":
            yield f"the {name} axis reports FAULT"


def _of_sensors(state: BusState, vitals: Vitals) -> Iterator[str]:
    sensors = [m for m in state.messages if m.name and m.name.startswith(_SENSOR_PREFIX)]
    if vitals.firmware is not None and vitals.firmware.usable_sensors < len(sensors):
        usable = vitals.firmware.usable_sensors
        yield f"the firmware uses {usable} of {len(sensors)} sensor groups"
    for sensor in sensors:
        assert sensor.name is not None
        status = state.text(sensor.name, "status")
        if status not in (None, "OK") and not sensor.is_silent:
            yield f"{sensor.name} says {status}"


def _of_silence(state: BusState, vitals: Vitals) -> Iterator[str]:
    firmware = vitals.firmware
    navigates = firmware is not None and firmware.mode.startswith("NAVIGATION")
    for message in state.messages:
        if message.name is None or not message.is_silent or message.name in _EVENTS:
            continue
        if navigates or not message.name.startswith(_NAVIGATION_PREFIX):
            yield f"{message.name} is silent for {age_words(message.age_s)}"


def _of_messages(state: BusState) -> Iterator[str]:
    for message in state.messages:
        kinds = {
            "lost": message.recent_lost,
            "out of turn": message.recent_out_of_turn,
            "with a wrong CRC": message.recent_crc_errors,
        }
        found = [f"{count} {kind}" for kind, count in kinds.items() if count]
        if found:
            yield f"{message.label}: {', '.join(found)} lately"


def _of_counters(vitals: Vitals) -> Iterator[str]:
    for name, counter in (vitals.counters or {}).items():
        if counter.recent > 0:
            yield f"the firmware counts {name}: {counter.recent} lately"


def _of_bus(state: BusState) -> Iterator[str]:
    if state.load is not None and state.load > HIGH_LOAD:
        yield f"the bus is loaded to {100 * state.load:.0f} %"
    if state.recent_error_frames:
        yield f"{state.recent_error_frames} error frames lately"
    unknown = [message for message in state.messages if _is_strange(message)]
    for message in unknown:
        yield f"unknown identifier {message.hexadecimal}, {rate_words(message.rate_hz)} a second"


def _is_strange(message: MessageState) -> bool:
    return message.name is None and message.rate_hz != 0 and message.identifier not in _DIAGNOSIS


def _of_wire(state: BusState) -> Iterator[str]:
    if _active_faults(state, "FAULT_STATUS"):
        mask = int(state.value("FAULT_STATUS", "active_kinds") or 0)
        kinds = [kind.name.lower() for kind in FaultKind if mask >> kind & 1]
        yield f"put on the wire by rrins: {', '.join(kinds)}"
    count = _active_faults(state, "HARDWARE_FAULT_STATUS")
    if count:
        yield f"put into the hardware by rrins: {count} fault{'' if count == 1 else 's'}"


def _active_faults(state: BusState, name: str) -> int:
    """Return how many faults a status says there are; 0 when it is not there."""
    message = state.message(name)
    if message is None or message.is_silent:
        return 0
    return int(state.value(name, "active_faults") or 0)
