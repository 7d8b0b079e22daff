"""The slow part of what a browser gets: vitals, sensors, troubles, the table of messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from rrins.host_tools.files import JsonObject
from rrins.host_tools.monitor.dialogue import MeasuredRow
from rrins.host_tools.monitor.redundancy import RedundancyVitals
from rrins.host_tools.monitor.state import BusState
from rrins.host_tools.monitor.tally import LEVELS
from rrins.host_tools.monitor.troubles import troubles_of
from rrins.host_tools.monitor.vitals import AxisVitals, Vitals, vitals_of
from rrins.host_tools.monitor.wording import value_with_unit
from rrins.host_tools.monitor.words import WITHOUT_ENCODER
from rrins.host_tools.rounding import kept, unit_words

SOUND, SUSPECT, EXCLUDED, ABSENT, SATURATED = "sound", "suspect", "excluded", "absent", "saturated"
UNHEARD = "not heard"
"""States of a sensor."""

_SPARK_STEP: Final = 2  # bins of a history for each point of a small plot
_PATIENCE_S: Final = 1.0  # of bus time, within which a sensor may still be heard

_TABLE: Final = "TABLE_STATUS"
_MEASURING: Final = "XCP_RESPONSE"
ABSENT_BIT: Final = {"gyros": 4, "accelerometers": 8}
SATURATED_BIT: Final = {"gyros": 1, "accelerometers": 2}
"""Bits of a sensor group's status."""


def state_of(state: BusState, counts: dict[str, int]) -> JsonObject:
    """Return the state of a bus for the page.

    Parameters
    ----------
    state : BusState
    counts : dict of str to int
        Number of gyros and accelerometers.
    """
    vitals = vitals_of(state)
    return {
        "speed": state.times.speed,
        "firmware": None if vitals.firmware is None else vars(vitals.firmware),
        "sensors": {kind: sensor_states(state, vitals, kind, n) for kind, n in counts.items()},
        "axes": {name: _axis(state, name, axis) for name, axis in vitals.axes.items()},
        "parity": {kind: _parity(vitals.redundancy[kind]) for kind in counts},
        "troubles": troubles_of(state, vitals),
        "messages": [
            [
                message.hexadecimal,
                message.label,
                kept(message.rate_hz),
                kept(message.age_s),
                message.errors,
                _flags(message.is_silent, message.has_recent_errors, message.is_sound_or_unknown),
                message.data.hex(),
            ]
            for message in state.messages
        ],
    }


def _flags(is_silent: bool, has_recent_errors: bool, is_sound: bool) -> int:
    return is_silent | has_recent_errors << 1 | (not is_sound) << 2


def sensor_states(state: BusState, vitals: Vitals, kind: str, count: int) -> list[str]:
    """Return the state of each sensor of a kind, `gyros` or `accelerometers`."""
    return [_sensor_state(state, vitals.redundancy[kind], kind, k) for k in range(1, count + 1)]


def _axis(state: BusState, name: str, axis: AxisVitals | None) -> tuple[str, bool] | None:
    """Return an axis in words, and whether it is sound; None before it is heard."""
    if axis is None:
        return None
    if axis.is_silent:
        return "silent", False
    if axis.state == "FAULT":
        return "fault", False
    if state.text(_TABLE, f"axis_{name}_abandoned") == "1":
        return "abandoned", False
    if axis.follows is False:
        return "does not follow", False
    source = state.text(_TABLE, f"axis_{name}_source")
    if source in WITHOUT_ENCODER:
        return f"encoder wrong: {source.lower()}", False
    return axis.state.lower(), True


def _parity(redundancy: RedundancyVitals | None) -> tuple[float | None, int, int] | None:
    """Return parity over threshold, the sensor it points at (0: none), its window in s.

    The parity is None where nothing is compared any more; all is None where nothing is reported.
    """
    if redundancy is None:
        return None
    ratio = redundancy.parity_ratio if redundancy.redundancy_left else None
    return ratio, redundancy.points_at or 0, redundancy.window_s


def _sensor_state(
    state: BusState, redundancy: RedundancyVitals | None, kind: str, number: int
) -> str:
    group = f"SENSOR_{number}"
    message = state.message(group)
    status = int(state.value(group, "status") or 0) if message is not None else 0
    if redundancy is not None and number in redundancy.excluded:
        return EXCLUDED
    if message is None and state.watched_s < _PATIENCE_S:
        return UNHEARD
    if message is None or message.is_silent or status & ABSENT_BIT[kind]:
        return ABSENT
    if status & SATURATED_BIT[kind]:
        return SATURATED
    if redundancy is not None and redundancy.alarm and redundancy.suspect in (None, number):
        return SUSPECT
    return SOUND


def message_of(
    state: BusState,
    name: str,
    signal: str | None,
    level: int,
    measured: Sequence[MeasuredRow] = (),
) -> JsonObject | None:
    """Return a message with its signals, and one of them over time; None if it was not seen.

    Parameters
    ----------
    state : BusState
    name : str
    signal : str or None
        The signal over time.
    level : int
        Of the signal over time, and of the small plots of all; see `BusState.history`.
    measured : sequence of MeasuredRow
        Signals of the computer's memory that XCP_RESPONSE carries.
    """
    level = min(max(level, 0), LEVELS - 1)
    if state.message(name) is None:
        return None
    message = state.message(name)
    assert message is not None
    signals = state.signals(name)
    names = [one.name for one in signals]
    carried = measured if name == _MEASURING else ()
    return {
        "name": name,
        "text": state.description(message),
        "signals": [
            [
                one.name,
                value_with_unit(one),
                one.low,
                one.high,
                unit_words(one.unit),
                one.comment,
            ]
            for one in signals
        ]
        + [[one.name, one.text, None, None, one.unit, one.comment] for one in carried],
        "sparks": [_spark(state, name, one.name, level) for one in signals] + [[] for _ in carried],
        "signal": signal if signal in names else None,
        "over_time": state.history(name, signal, level)
        if signal is not None and signal in names
        else None,
    }


def _spark(state: BusState, name: str, signal: str, level: int) -> list[float | None]:
    """Return a signal over time in few points: the middle of each of two bins."""
    bins = state.history(name, signal, level)
    return [
        None if pair is None else kept((pair[0] + pair[1]) / 2)
        for pair in bins[_SPARK_STEP - 1 :: _SPARK_STEP]
    ]
