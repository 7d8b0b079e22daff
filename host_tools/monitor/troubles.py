"""Troubles in plain words: those that the firmware reports, and those seen on the bus."""

from __future__ import annotations

from collections.abc import Iterator

from rrins.host_tools.monitor.redundancy import redundancy_troubles
from rrins.host_tools.monitor.state import BusState, MessageState
from rrins.host_tools.monitor.vitals import AXES, Vitals
from rrins.host_tools.monitor.wording import age_words, rate_words
from rrins.host_tools.monitor.words import WITHOUT_ENCODER, abandoned_words
from rrins.host_tools.wire.fault_kinds import FaultKind

HIGH_LOAD = 0.8
"""Fraction of the bus time, or of the firmware's period, above which load is a trouble."""

_TABLE = "TABLE_STATUS"
_SENSOR_PREFIX = "SENSOR_"
_DIAGNOSIS = (0x7DF, *range(0x7E0, 0x7F0))  # ISO 15765-4, identifiers of diagnostic requests


def troubles_of(state: BusState, vitals: Vitals) -> list[str]:
    """Return the current troubles, the most severe first; none if all is well."""
    return [
        *_firmware_troubles(vitals),
        *_bridging_troubles(state),
        *_axis_troubles(vitals),
        *_encoder_troubles(state),
        *_sensor_troubles(state, vitals),
        *redundancy_troubles(vitals.redundancy),
        *_silence_troubles(state, vitals),
        *_message_troubles(state),
        *_counter_troubles(vitals),
        *_bus_troubles(state),
        *_wire_troubles(state),
    ]


def _firmware_troubles(vitals: Vitals) -> Iterator[str]:
    firmware = vitals.firmware
    if firmware is None:
        return
    if firmware.mode == "FAULT":
        yield f"mode FAULT: {firmware.fault}"
    if firmware.sync_lost:
        yield "the firmware has lost SYNC and runs on its own clock"
    if firmware.load_percent > 100 * HIGH_LOAD:
        yield f"the firmware is busy for {firmware.load_percent:.0f} % of its period"


def _bridging_troubles(state: BusState) -> Iterator[str]:
    if state.text("BRIDGING", "degraded") == "1":
        percent = state.value("BRIDGING", "recent_percent") or 0.0
        yield f"the navigation is degraded: {percent:.1f} % of the last 100 s bridged"


def _axis_troubles(vitals: Vitals) -> Iterator[str]:
    for name in AXES:
        axis = vitals.axes[name]
        if axis is None:
            continue
        if axis.follows is False:
            yield f"the {name} axis did not follow its command"
        if axis.state == "FAULT":
            yield f"the {name} axis reports FAULT"


def _encoder_troubles(state: BusState) -> Iterator[str]:
    for name in AXES:
        source = state.text(_TABLE, f"axis_{name}_source")
        if source in WITHOUT_ENCODER:
            yield f"the {name} encoder contradicts the gyros: {WITHOUT_ENCODER[source]}"
        if state.text(_TABLE, f"axis_{name}_abandoned") == "1":
            yield abandoned_words(name)
    if state.text(_TABLE, "interrupted") == "1":
        tries = int(state.value(_TABLE, "tries") or 0)
        yield f"the rotation is interrupted: {tries} tries so far, another follows"


def _sensor_troubles(state: BusState, vitals: Vitals) -> Iterator[str]:
    sensors = [m for m in state.messages if m.name and m.name.startswith(_SENSOR_PREFIX)]
    if vitals.firmware is not None and vitals.firmware.usable_sensors < len(sensors):
        usable = vitals.firmware.usable_sensors
        yield f"the firmware uses {usable} of {len(sensors)} sensor groups"
    for sensor in sensors:
        assert sensor.name is not None
        status = state.text(sensor.name, "status")
        if status not in (None, "OK") and not sensor.is_silent:
            yield f"{sensor.name} reports {status}"


def _silence_troubles(state: BusState, vitals: Vitals) -> Iterator[str]:
    firmware = vitals.firmware
    navigates = firmware is not None and firmware.mode.startswith("NAVIGATION")
    for message in state.messages:
        is_due = message.send_type == "Cyclic" or (navigates and message.send_type == "IfActive")
        if is_due and message.is_silent:
            yield f"{message.name} has been silent for {age_words(message.age_s)}"


def _message_troubles(state: BusState) -> Iterator[str]:
    for message in state.messages:
        counts = {
            "lost": message.recent_lost,
            "out of turn": message.recent_out_of_turn,
            "with a wrong CRC": message.recent_crc_errors,
        }
        found = [f"{count} {kind}" for kind, count in counts.items() if count]
        if found:
            yield f"{message.label}: {', '.join(found)} recently"


def _counter_troubles(vitals: Vitals) -> Iterator[str]:
    for name, counter in (vitals.counters or {}).items():
        if counter.recent > 0:
            yield f"the firmware counts {name}: {counter.recent} recently"


def _bus_troubles(state: BusState) -> Iterator[str]:
    if state.load is not None and state.load > HIGH_LOAD:
        yield f"the bus load is {100 * state.load:.0f} %"
    if state.recent_error_frames:
        yield f"{state.recent_error_frames} error frames recently"
    unknown = [message for message in state.messages if _is_strange(message)]
    for message in unknown:
        yield f"unknown identifier {message.hexadecimal}, {rate_words(message.rate_hz)} per second"


def _is_strange(message: MessageState) -> bool:
    return message.name is None and message.rate_hz != 0 and message.identifier not in _DIAGNOSIS


def _wire_troubles(state: BusState) -> Iterator[str]:
    if _active_faults(state, "FAULT_STATUS"):
        mask = int(state.value("FAULT_STATUS", "active_kinds") or 0)
        names = [kind.name.lower() for kind in FaultKind if mask >> kind & 1]
        yield f"injected on the wire by rrins: {', '.join(names)}"
    count = _active_faults(state, "HARDWARE_FAULT_STATUS")
    if count:
        yield f"injected into the hardware by rrins: {count} fault{'' if count == 1 else 's'}"


def _active_faults(state: BusState, name: str) -> int:
    """Return the number of active faults in a status message; 0 if it is missing."""
    message = state.message(name)
    if message is None or message.is_silent:
        return 0
    return int(state.value(name, "active_faults") or 0)
