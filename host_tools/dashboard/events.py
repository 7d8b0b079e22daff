"""Events in words: what has changed on the bus that a person wants to know."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from rrins.compiled.record import Floats
from rrins.dbc.codec import load
from rrins.host_tools.files import JsonObject
from rrins.host_tools.monitor.words import FOUND_BY, abandoned_words, drift_words, parity_words

Weight = Literal["note", "good", "warning", "bad", "order"]
"""How an event is shown; `order` is what somebody asked for."""

_Change = tuple[str, str, Weight]  # the signal that has changed, words, weight

MOST: Final = 500
"""Events that are kept."""

_UNKNOWN: Final = -1.0  # value of a signal that was not on the bus yet; no other is negative
_STATUS, _FAULTS, _TABLE = "FIRMWARE_STATUS", "FIRMWARE_FAULTS", "TABLE_STATUS"
_KINDS: Final = {"gyro": "GYRO_REDUNDANCY", "accelerometer": "ACCELEROMETER_REDUNDANCY"}
_OF_KIND = ("alarm", "excluded", "repairing", "isolated", "how", "suspect", "parity_ratio", "drift")
_AXES = ("inner", "outer")
_SOURCES = ("gnss", "odometer", "altimeter")

SIGNALS: Final = {
    f"{message}.{signal}": (message, signal)
    for message, signals in (
        (_STATUS, ("mode", "fault", "sync_lost", "usable_sensors", "scheme_cycle")),
        (_STATUS, tuple(f"axis_{axis}_not_following" for axis in _AXES)),
        *((message, _OF_KIND) for message in _KINDS.values()),
        (_TABLE, tuple(f"axis_{axis}_source" for axis in _AXES)),
        (_TABLE, tuple(f"axis_{axis}_abandoned" for axis in _AXES)),
        ("READMISSION_STATUS", ("state", "kind", "sensor", "refusal")),
        ("AIDING_STATUS", _SOURCES),
        ("BRIDGING", ("degraded",)),
        ("FAULT_STATUS", ("active_faults",)),
        ("HARDWARE_FAULT_STATUS", ("active_faults",)),
        (_FAULTS, ("overruns",)),
    )
    for signal in signals
}
"""Signals from which events are made."""

_MODES: Final[dict[str, tuple[str, Weight]]] = {
    "SELF_TEST": ("self-test", "note"),
    "STANDBY": ("standby", "note"),
    "ALIGNMENT": ("alignment begins", "note"),
    "FINE_ALIGNMENT": ("fine alignment begins", "note"),
    "NAVIGATION_STRAPDOWN": ("navigation without rotation", "good"),
    "NAVIGATION_ROTATING": ("navigation with rotation", "good"),
    "SHUTDOWN": ("shut down", "note"),
}


def facts() -> JsonObject:
    """Return what a page needs to make events itself."""
    rotating = load().value(_STATUS, "mode", "NAVIGATION_ROTATING")
    return {"signals": SIGNALS, "modes": _MODES, "rotating": rotating}


@dataclass(frozen=True)
class Event:
    """Something that happened."""

    time_s: float  #: bus time of its effect
    text: str
    weight: Weight  #: see `Weight`


class EventLog:
    """Makes events of what changes.

    Attributes
    ----------
    events : list of Event
        In the order in which they became known; the oldest are dropped.
    count : int
        Of all so far.
    late : int
        Of those whose place was before another.
    """

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.count = self.late = 0
        self._codec = load()
        self._rotating = self._codec.value(_STATUS, "mode", "NAVIGATION_ROTATING")
        self._octets = b""
        self._now = dict.fromkeys(SIGNALS, _UNKNOWN)

    def add(self, time_s: float, text: str, weight: Weight = "note") -> Event:
        """Add an event at its place in time."""
        event = Event(time_s, text, weight)
        insort(self.events, event, key=lambda one: one.time_s)
        self.count += 1
        if self.events[-1] is not event:
            self.late += 1
        if len(self.events) > MOST:
            del self.events[0]
        return event

    def follow(self, values: Floats, since_s: Floats) -> list[Event]:
        """Compare the values of `SIGNALS` with those before; return the new events.

        Parameters
        ----------
        values : array, shape (signals,)
        since_s : array, shape (signals,)
            Bus time since which each has its value.
        """
        octets = values.tobytes()
        if octets == self._octets:
            return []
        self._octets = octets
        old = self._now
        known = np.where(np.isnan(values), _UNKNOWN, values).tolist()
        self._now = dict(zip(SIGNALS, known, strict=True))
        times_s = dict(zip(SIGNALS, since_s.tolist(), strict=True))
        found = sorted(
            (times_s[key], k, *told) for k, (key, *told) in enumerate(self._changes(old))
        )
        return [self.add(time_s, text, weight) for time_s, _, text, weight in found]

    def _changes(self, old: dict[str, float]) -> Iterator[_Change]:
        yield from self._of_mode(old)
        for kind, message in _KINDS.items():
            yield from self._of_redundancy(kind, message, old)
        yield from self._of_table(old)
        yield from self._of_readmission(old)
        yield from self._of_aiding(old)
        yield from self._of_faults(old)

    def _has_changed(self, key: str, old: dict[str, float]) -> bool:
        return 0 <= self._now[key] != old[key]

    def _rises(self, key: str, old: dict[str, float]) -> bool:
        return self._now[key] > max(old[key], 0.0)

    def _falls(self, key: str, old: dict[str, float]) -> bool:
        return 0 <= self._now[key] < old[key]

    def _word(self, key: str) -> str:
        """Return a value by its name in the DBC."""
        value = self._now[key]
        return self._codec.choices(*SIGNALS[key]).get(int(value)) or f"{value:g}"

    def _of_mode(self, old: dict[str, float]) -> Iterator[_Change]:
        key = f"{_STATUS}.mode"
        if self._has_changed(key, old):
            mode = self._word(key)
            if mode == "FAULT":
                yield key, f"mode FAULT: {self._word(f'{_STATUS}.fault')}", "bad"
            elif mode == "NAVIGATION_STRAPDOWN" and old[key] == self._rotating:
                yield key, "the rotation has stopped: navigation goes on without", "warning"
            elif mode in _MODES:
                yield key, *_MODES[mode]
        key = f"{_STATUS}.sync_lost"
        if self._rises(key, old):
            yield key, "SYNC is lost: the firmware runs on its own clock", "bad"
        elif self._falls(key, old):
            yield key, "SYNC is back", "good"
        key = f"{_STATUS}.scheme_cycle"
        if self._rises(key, old):
            yield key, f"cycle {self._now[key]:.0f} of the scheme is complete", "note"

    def _of_redundancy(self, kind: str, message: str, old: dict[str, float]) -> Iterator[_Change]:
        now = self._now
        alarm, left_out, drift = (f"{message}.{name}" for name in ("alarm", "excluded", "drift"))
        excluded, was = (max(0, int(one[left_out])) for one in (now, old))
        if self._rises(alarm, old):
            ratio = now[f"{message}.parity_ratio"]
            parity = f": parity {parity_words(ratio)} × its threshold" if ratio > 1 else ""
            yield alarm, f"the {kind}s disagree{parity}", "warning"
        elif self._falls(alarm, old) and excluded == was:
            yield alarm, f"the {kind}s agree again", "good"
        for sensor in range(1, 17):
            bit = 1 << (sensor - 1)
            if excluded & bit and not was & bit:
                is_last = now[f"{message}.isolated"] == sensor
                word = self._word(f"{message}.how")
                how = f", found by {FOUND_BY.get(word, word)}" if is_last else ""
                yield left_out, f"{kind} {sensor} left out{how}", "bad"
            elif was & bit and not excluded & bit:
                yield left_out, f"{kind} {sensor} is back in use", "good"
        repairing = f"{message}.repairing"
        if self._rises(repairing, old):
            yield repairing, "the navigation is being repaired from before the fault", "note"
        elif self._falls(repairing, old):
            yield repairing, "the navigation is repaired", "good"
        if now[drift] > 0 >= old[drift]:
            yield drift, drift_words(kind, self._word(drift)), "warning"
        elif now[drift] == 0 < old[drift]:
            yield drift, f"{kind} calibration: no drift is reported any more", "good"

    def _of_table(self, old: dict[str, float]) -> Iterator[_Change]:
        for axis in _AXES:
            lags = f"{_STATUS}.axis_{axis}_not_following"
            if self._rises(lags, old):
                yield lags, f"the {axis} axis does not follow its command", "bad"
            elif self._falls(lags, old):
                yield lags, f"the {axis} axis follows again", "good"
            source = f"{_TABLE}.axis_{axis}_source"
            if self._has_changed(source, old) and (self._now[source] or old[source] > 0):
                word = self._word(source)
                is_sound = word == "ENCODER"
                text = f"angle of the {axis} axis from: {word}"
                yield source, text, "good" if is_sound else "warning"
            abandoned = f"{_TABLE}.axis_{axis}_abandoned"
            if self._rises(abandoned, old):
                yield abandoned, abandoned_words(axis), "bad"

    def _of_readmission(self, old: dict[str, float]) -> Iterator[_Change]:
        key = "READMISSION_STATUS.state"
        if self._has_changed(key, old) and self._now[key]:
            kind = self._word("READMISSION_STATUS.kind").lower()
            sensor = int(self._now["READMISSION_STATUS.sensor"])
            state = self._word(key)
            refusal = self._now["READMISSION_STATUS.refusal"]
            why = f" ({self._word('READMISSION_STATUS.refusal')})" if refusal else ""
            yield key, f"readmission of {kind} {sensor}: {state}{why}", "note"

    def _of_aiding(self, old: dict[str, float]) -> Iterator[_Change]:
        for source in _SOURCES:
            key = f"AIDING_STATUS.{source}"
            if self._has_changed(key, old) and (self._now[key] or old[key] > 0):
                word = self._word(key)
                if word == "LOST" and old[key] < 0:
                    continue  # it has never been there
                yield key, f"{source}: {word.lower()}", "warning" if word == "LOST" else "good"
        key = "BRIDGING.degraded"
        if self._rises(key, old):
            yield key, "the navigation is degraded: much sensor data was bridged", "warning"

    def _of_faults(self, old: dict[str, float]) -> Iterator[_Change]:
        for key, where in (
            ("FAULT_STATUS.active_faults", "on the wire"),
            ("HARDWARE_FAULT_STATUS.active_faults", "of the hardware"),
        ):
            if not self._has_changed(key, old):
                continue
            count = int(self._now[key])
            if count:
                are = "active" if self._rises(key, old) else "still active"
                weight: Weight = "warning" if self._rises(key, old) else "note"
                yield key, f"{count} fault{'' if count == 1 else 's'} {where} {are}", weight
            elif old[key] > 0:
                yield key, f"no fault {where} is active any more", "good"
        key = f"{_FAULTS}.overruns"
        if self._rises(key, old):
            yield key, f"the firmware missed deadlines: {self._now[key]:.0f}", "warning"
