"""The error sources of a scenario, and the set-up of both sides without some of them.

A source is taken away from the hardware alone: the firmware keeps its data sheets, weights and
tuning. What a run draws stays as it is for all other sources: noise is not switched off but made
a billion times smaller, so that the generators go on in step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, Final

import rrins.firmware_py.core.settings as firmware
import rrins.host_tools.hardware.settings as hardware
from rrins.firmware_py.core.sensors.calibration import Calibration
from rrins.host_tools.hardware.units import by_name, split
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    first_pose,
    hardware_settings,
)
from rrins.host_tools.scenario.fault_tables import FaultOfHardware, FaultOnWire
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.tables import each
from rrins.host_tools.wire.faults import WireFault

SENSOR_KINDS: Final = {"gyros": "gyro", "accelerometers": "accelerometer"}

_OF_SENSORS: Final = {
    "bias": ("bias",),
    "bias at power-up": ("bias_repeatability",),
    "bias instability": ("bias_instability",),
    "bias random walk": ("rate_random_walk",),
    "white noise": ("white_noise",),
    "scale factor": ("scale_error",),
    "scale factor at power-up": ("scale_repeatability",),
    "scale factor asymmetry": ("asymmetric_scale_error",),
    "installation": ("installation_u", "installation_v"),
    "g-sensitivity": ("g_sensitivity",),
    "temperature": ("bias_temperature", "scale_temperature"),
    "dead zone": ("dead_zone",),
    "size effect": ("position_x", "position_y", "position_z"),
}
"""Errors that each sensor has for itself, and the names of their keys without units."""

_DRAWN_IN_RUN: Final = {"bias_instability", "rate_random_walk", "white_noise"}
_QUIET: Final = 1e-9

_OF_AXES: Final = {
    "encoder offset": "encoder_offset_deg",
    "ripple of the axis": "ripple_arcsec",
    "stiction of the axis": "stiction_arcsec",
    "run-out": "run_out_um",
}
_OF_TABLE: Final = {
    "non-orthogonality": "non_orthogonality_arcsec",
    "wobble of the inner axis": "wobble_arcsec",
}
_OF_AIDS: Final = {
    "altimeter": {"bias": "bias_m", "noise": "noise_m", "random walk": "random_walk_m_per_sqrt_h"},
    "gnss": {
        "position noise": "position_noise_m",
        "correlated position noise": "position_correlated_noise_m",
        "velocity noise": "velocity_noise_mps",
    },
    "odometer": {"scale factor": "scale_error_ppm", "noise": "noise_mps"},
}
_ANGLES: Final = ("roll", "pitch", "heading")
_SIDES: Final = ("east", "north", "up")


@dataclass(frozen=True)
class Sides:
    """The set-up of both sides of a run."""

    firmware: firmware.Settings
    hardware: hardware.Settings
    wire: tuple[WireFault, ...]


Change = Callable[[Sides], Sides]


@dataclass(frozen=True)
class Source:
    """A source of error, and how it is taken away."""

    name: str  #: such as "gyro bias"
    part: str  #: which sensor, axis or component; empty where there is but one
    remove: Change
    sensors: tuple[tuple[str, int], ...] = ()  #: kind and index, of what each sensor has for itself


def sides_of(scenario: Scenario) -> Sides:
    """Return the set-up of a scenario as it is.

    Raises
    ------
    RehearsalError
        When a file that it names cannot be used.
    """
    wire = tuple(
        fault.fault(scenario.rate_hz) for fault in scenario.faults if isinstance(fault, FaultOnWire)
    )
    return Sides(firmware_settings(scenario), hardware_settings(scenario), wire)


def without(sides: Sides, sources: Sequence[Source]) -> Sides:
    """Return the set-up without some sources."""
    return reduce(lambda left, source: source.remove(left), sources, sides)


def joined(sources: Sequence[Source]) -> list[Source]:
    """Return one source for all sensors, axes or components of a name."""
    groups: dict[str, list[Source]] = {}
    for source in sources:
        groups.setdefault(source.name, []).append(source)
    return [one[0] if len(one) == 1 else _joined(name, one) for name, one in groups.items()]


def _joined(name: str, sources: list[Source]) -> Source:
    sensors = tuple(one for source in sources for one in source.sensors)
    return Source(name, "", lambda sides: without(sides, sources), sensors)


def sources_of(scenario: Scenario) -> list[Source]:
    """Return the sources of a scenario: all that is not zero.

    Raises
    ------
    RehearsalError
        When a file that it names cannot be used.
    """
    calibration = firmware_settings(scenario).calibration
    return [
        *_of_sensors(scenario, calibration),
        *_of_turntable(scenario),
        *_of_start(scenario),
        *_of_aids(scenario),
        *_of_faults(scenario),
    ]


def words_of(key: str) -> str:
    """Return the name of the source that a key of a sensor, such as `gyros.bias_dph`, belongs to.

    What is neither a sensor's nor an aid's stays as it is, but for the attitude that the firmware
    is given.
    """
    kind, _, end = key.partition(".")
    for words, of in _OF_AIDS.get(kind, {}).items():
        if of == end:
            return f"{_shown(kind)} {words}"
    if kind not in SENSOR_KINDS:
        return key.removeprefix("firmware: ")
    called = {"angle_random_walk_deg_per_sqrt_h": "white_noise"}
    called["random_walk_ug_per_sqrt_h"] = "rate_random_walk"
    name = called.get(end, split(end)[0])
    return next(f"{SENSOR_KINDS[kind]} {words}" for words, of in _OF_SENSORS.items() if name in of)


def _of_sensors(scenario: Scenario, calibration: Calibration) -> Iterator[Source]:
    thermal = scenario.thermal
    is_warm = thermal.ambient_offset_k != 0 or thermal.warm_up_k != 0
    for kind, word in SENSOR_KINDS.items():
        table, known = getattr(scenario, kind), getattr(calibration, kind)
        count = len(getattr(scenario.rimu, kind))
        keys = dict(zip(by_name(table), type(table).model_fields, strict=True))
        for words, all_names in _OF_SENSORS.items():
            names = tuple(name for name in all_names if name in keys)
            if words == "temperature" and not is_warm:
                continue
            for k in range(count):
                ideals: dict[str, float] = {}
                for name in names:
                    key = keys[name]
                    value = each(getattr(table, key), count)[k]
                    ideal = each(getattr(known, key, 0.0), count)[k]
                    if value != ideal:
                        ideals[key] = _QUIET * value if name in _DRAWN_IN_RUN else ideal
                if ideals:
                    change = _sensor_change(kind, k, count, ideals)
                    yield Source(f"{word} {words}", f"{word} {k + 1}", change, ((kind, k),))
        if table.bandwidth_hz is not None or table.latency_ms:
            yield Source(f"{word} bandwidth and latency", "", _no_lag(kind))
        resolution = "resolution_arcsec" if kind == "gyros" else "resolution_um_per_s"
        if getattr(table, resolution):
            yield Source(f"{word} resolution", "", _table_change(kind, {resolution: 0.0}))


def _sensor_change(kind: str, k: int, count: int, ideals: dict[str, float]) -> Change:
    def change(sides: Sides) -> Sides:
        table = getattr(sides.hardware, kind)
        update: dict[str, Any] = {}
        for key, ideal in ideals.items():
            values = list(each(getattr(table, key), count))
            values[k] = ideal
            update[key] = tuple(values)
        new = {kind: table.model_copy(update=update)}
        return replace(sides, hardware=replace(sides.hardware, **new))

    return change


def _table_change(name: str, values: dict[str, Any]) -> Change:
    """Return a change of keys of one of the hardware's tables."""

    def change(sides: Sides) -> Sides:
        new: dict[str, Any] = {name: getattr(sides.hardware, name).model_copy(update=values)}
        return replace(sides, hardware=replace(sides.hardware, **new))

    return change


def _no_lag(kind: str) -> Change:
    """Return the change to sensors that are not late, and to a firmware that knows it."""
    of_table = _table_change(kind, {"bandwidth_hz": None, "latency_ms": 0.0})

    def change(sides: Sides) -> Sides:
        redundancy = sides.firmware.redundancy
        if kind == "gyros" and redundancy is not None:
            redundancy = redundancy.model_copy(update={"gyro_lag_s": 0.0})
        settings = sides.firmware.model_copy(update={"redundancy": redundancy})
        return of_table(replace(sides, firmware=settings))

    return change


def _of_turntable(scenario: Scenario) -> Iterator[Source]:
    table = scenario.turntable
    for words, key in _OF_AXES.items():
        for name in ("inner", "outer"):
            if getattr(getattr(table, name), key):
                yield Source(words, f"{name} axis", _axis_change(name, key))
    for words, key in _OF_TABLE.items():
        if getattr(table, key):
            yield Source(words, "", _table_change("turntable", {key: 0.0}))


def _axis_change(name: str, key: str) -> Change:
    def change(sides: Sides) -> Sides:
        axis = getattr(sides.hardware.turntable, name).model_copy(update={key: 0.0})
        return _table_change("turntable", {name: axis})(sides)

    return change


def _of_start(scenario: Scenario) -> Iterator[Source]:
    """Yield the errors of what the navigation begins with."""
    table = scenario.firmware
    if table.initial_attitude == "given" and table.has_attitude_error:
        pose = first_pose(scenario)
        for angle in _ANGLES:
            value = {f"{angle}_deg": getattr(pose, f"{angle}_deg")}
            yield Source("given attitude", angle, _firmware_change(value))
    if table.initial_attitude != "transferred":
        return
    for words, parts, is_off in (
        ("attitude", _ANGLES, table.has_attitude_error),
        ("velocity", _SIDES, table.velocity_error_sigma_mps > 0),
        ("position", _SIDES, table.position_error_sigma_m > 0),
    ):
        for k, part in enumerate(parts if is_off else ()):
            yield Source(f"transferred {words}", part, _master_change(f"{words}_error", k))


def _firmware_change(values: dict[str, Any]) -> Change:
    return lambda sides: replace(sides, firmware=sides.firmware.model_copy(update=values))


def _master_change(field: str, k: int) -> Change:
    def change(sides: Sides) -> Sides:
        master = sides.hardware.master
        assert master is not None
        value = tuple(0.0 if i == k else v for i, v in enumerate(getattr(master, field)))
        changed: dict[str, Any] = {field: value}
        return replace(sides, hardware=replace(sides.hardware, master=replace(master, **changed)))

    return change


def _of_aids(scenario: Scenario) -> Iterator[Source]:
    for name, keys in _OF_AIDS.items():
        table = getattr(scenario, name)
        for words, key in keys.items():
            value = None if table is None else getattr(table, key)
            if value:
                ideal = _QUIET * value if "noise" in key else 0.0
                yield Source(f"{_shown(name)} {words}", "", _table_change(name, {key: ideal}))
    odometer = scenario.odometer
    if odometer is None or not (odometer.mounting_heading_deg or odometer.mounting_pitch_deg):
        return
    straight = scenario.varied(odometer__mounting_heading_deg=0.0, odometer__mounting_pitch_deg=0.0)
    yield Source("odometer mounting", "", _mounting_change(scenario, straight))


def _shown(aid: str) -> str:
    """Return the name of an aid, as words have it."""
    return aid.upper() if aid == "gnss" else aid


def _mounting_change(scenario: Scenario, straight: Scenario) -> Change:
    """Return the change to a vehicle whose forward axis is that of the body."""
    before, pose = hardware_settings(straight), first_pose(straight)
    was = first_pose(scenario)

    def change(sides: Sides) -> Sides:
        of_pose = {f"{angle}_deg": getattr(pose, f"{angle}_deg") for angle in _ANGLES}
        zero = {"mounting_heading_deg": 0.0, "mounting_pitch_deg": 0.0}
        changed = _table_change("odometer", zero)(sides)
        given = {
            key: getattr(sides.firmware, key) + value - getattr(was, key)
            for key, value in of_pose.items()
        }
        return replace(
            changed,
            firmware=sides.firmware.model_copy(update=given),
            hardware=replace(changed.hardware, motion=before.motion, **of_pose),
        )

    return change


def _of_faults(scenario: Scenario) -> Iterator[Source]:
    """Yield the faults; one that is taken away stays in its place and never begins."""
    never = scenario.epochs + 1
    of_hardware = of_wire = 0
    for number, fault in enumerate(scenario.faults, 1):
        where = "hardware" if isinstance(fault, FaultOfHardware) else "wire"
        index = of_hardware if where == "hardware" else of_wire
        part = f"{fault.kind.replace('_', ' ')}{_target(fault)} at {fault.at_s:g} s"
        yield Source(f"fault {number}", part, _no_fault(where, index, never))
        of_hardware += where == "hardware"
        of_wire += where == "wire"


def _target(fault: FaultOfHardware | FaultOnWire) -> str:
    if isinstance(fault, FaultOnWire):
        return "" if fault.message is None else f" {fault.message}"
    key = fault.hardware_kind.target
    found = None if key is None else getattr(fault, key.key)
    return "" if found is None else f" {found}"


def _no_fault(where: str, index: int, never: int) -> Change:
    def change(sides: Sides) -> Sides:
        if where == "wire":
            faults = list(sides.wire)
            faults[index] = replace(faults[index], first_epoch=never, last_epoch=-1)
            return replace(sides, wire=tuple(faults))
        planned = list(sides.hardware.faults)
        planned[index] = replace(planned[index], first_epoch=never, last_epoch=-1)
        return replace(sides, hardware=replace(sides.hardware, faults=tuple(planned)))

    return change
