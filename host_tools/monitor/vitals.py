"""State of the navigation computer, the turntable and the navigation, as they report it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, get_type_hints

from rrins.host_tools.files import JsonObject
from rrins.host_tools.monitor.redundancy import (
    MESSAGES,
    ReadmissionVitals,
    RedundancyVitals,
    readmission_of,
    redundancy_of,
)
from rrins.host_tools.monitor.state import BusState

STATUS = "FIRMWARE_STATUS"
FAULTS = "FIRMWARE_FAULTS"

COUNTERS = ("crc_errors", "counter_errors", "missing_frames", "bridged_epochs", "overruns")
"""Signals of FIRMWARE_FAULTS."""

AXES = ("inner", "outer")


@dataclass(frozen=True)
class FirmwareVitals:
    """The navigation computer, from FIRMWARE_STATUS."""

    mode: str
    fault: str
    scheme_position: int
    scheme_cycle: int
    usable_sensors: int
    load_percent: float
    sync_lost: bool
    clock_error_ppm: float
    age_s: float
    is_silent: bool


@dataclass(frozen=True)
class AxisVitals:
    """An axis of the turntable, from its status; `follows` from FIRMWARE_STATUS."""

    state: str
    angle_deg: float
    rate_dps: float
    follows: bool | None
    is_silent: bool


@dataclass(frozen=True)
class NavigationVitals:
    """The navigation output, from the NAV messages; degrees, metres, metres per second."""

    latitude_deg: float
    longitude_deg: float
    height: float
    velocity_east: float
    velocity_north: float
    velocity_up: float
    roll_deg: float
    pitch_deg: float
    heading_deg: float
    is_silent: bool


@dataclass(frozen=True)
class Counter:
    """A fault counter of the firmware: count since power-on, and recent increase."""

    count: int
    recent: int


@dataclass(frozen=True)
class Vitals:
    """All vitals; None for what has not been on the bus yet."""

    firmware: FirmwareVitals | None
    axes: dict[str, AxisVitals | None]
    navigation: NavigationVitals | None
    counters: dict[str, Counter] | None
    redundancy: dict[str, RedundancyVitals | None]
    readmission: ReadmissionVitals | None

    def as_dict(self) -> JsonObject:
        """Return the vitals for JSON."""
        return asdict(self)


def vitals_of(state: BusState) -> Vitals:
    """Return the vitals in a snapshot."""
    return Vitals(
        _firmware(state),
        {axis: _axis(state, axis) for axis in AXES},
        _navigation(state),
        _counters(state),
        {kind: redundancy_of(state, kind) for kind in MESSAGES},
        readmission_of(state),
    )


def _is_silent(state: BusState, message: str) -> bool:
    found = state.message(message)
    return found is not None and found.is_silent


def _signal(state: BusState, message: str, name: str, kind: Callable[[Any], Any] = float) -> Any:
    """Return the value of a signal that was on the bus, or its name for `str`."""
    value = state.text(message, name) if kind is str else state.value(message, name)
    assert value is not None, f"{message} was on the bus"
    return kind(value)


_FIRMWARE = get_type_hints(FirmwareVitals)
"""Type of each signal of FIRMWARE_STATUS, and of age and silence."""


def _firmware(state: BusState) -> FirmwareVitals | None:
    message = state.message(STATUS)
    if message is None or not state.has_values(STATUS):
        return None
    values: dict[str, Any] = {"age_s": message.age_s, "is_silent": message.is_silent}
    signals = _FIRMWARE.keys() - values.keys()
    values |= {name: _signal(state, STATUS, name, _FIRMWARE[name]) for name in signals}
    return FirmwareVitals(**values)


def _axis(state: BusState, axis: str) -> AxisVitals | None:
    name = f"AXIS_{axis.upper()}_STATUS"
    if not state.has_values(name):
        return None
    lags = state.value(STATUS, f"axis_{axis}_not_following")
    return AxisVitals(
        state=_signal(state, name, "state", str),
        angle_deg=_signal(state, name, "encoder_angle_deg"),
        rate_dps=_signal(state, name, "encoder_rate_dps"),
        follows=None if lags is None else not lags,
        is_silent=_is_silent(state, name),
    )


_NAVIGATION = {
    "latitude_deg": "NAV_LATITUDE",
    "longitude_deg": "NAV_LONGITUDE",
    "height": "NAV_HEIGHT",
    "velocity_east": "NAV_VELOCITY",
    "velocity_north": "NAV_VELOCITY",
    "velocity_up": "NAV_HEIGHT",
    "roll_deg": "NAV_ATTITUDE",
    "pitch_deg": "NAV_ATTITUDE",
    "heading_deg": "NAV_ATTITUDE",
}


def _navigation(state: BusState) -> NavigationVitals | None:
    messages = set(_NAVIGATION.values())
    if not all(state.has_values(message) for message in messages):
        return None
    values = {signal: _signal(state, message, signal) for signal, message in _NAVIGATION.items()}
    return NavigationVitals(
        **values, is_silent=any(_is_silent(state, message) for message in messages)
    )


def _counters(state: BusState) -> dict[str, Counter] | None:
    if not state.has_values(FAULTS):
        return None
    return {
        name: Counter(_signal(state, FAULTS, name, int), round(state.growth(FAULTS, name)))
        for name in COUNTERS
    }
