"""Troubles of this moment: how severe they are, since when, and which guide explains them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from rrins.host_tools.files import JsonObject

_KINDS: Final = tuple(
    (re.compile(pattern), severity, page)
    for pattern, severity, page in (
        (r"^mode FAULT", "bad", "something-is-wrong#where-to-look-first"),
        (r"lost SYNC", "bad", "something-is-wrong#frames-are-missing"),
        (r"^the firmware is busy", "warning", "bench"),
        (r"is degraded", "warning", "something-is-wrong#frames-are-missing"),
        (r" axis ", "bad", "something-is-wrong#the-rotation-has-stopped"),
        (r" encoder ", "bad", "redundancy"),
        (r"disagree", "bad", "something-is-wrong#the-position-drifts-away"),
        (r"left out", "warning", "something-is-wrong#a-sensor-has-been-left-out"),
        (r"^no redundancy", "bad", "redundancy"),
        (r"calibration drifted", "warning", "calibration"),
        (r"^the firmware uses", "warning", "something-is-wrong#where-to-look-first"),
        (r"^SENSOR_\d+ reports", "bad", "redundancy"),
        (r"silent", "bad", "something-is-wrong#frames-are-missing"),
        (r"^injected ", "note", "faults"),
        (r"^the firmware counts overruns", "warning", "bench"),
        (r"recently$", "warning", "something-is-wrong#frames-are-missing"),
        (r"^the bus load", "warning", "bus"),
        (r"^unknown identifier", "warning", "bus-contract"),
    )
)
_BEGIN_WITH: Final = tuple(  # troubles that begin as a signal changes, with words of its name
    (re.compile(pattern), words)
    for pattern, words in (
        (r"left out|^no redundancy", ".excluded"),
        (r"disagree", ".alarm"),
        (r"^injected ", ".active_faults"),
        (r"^the firmware uses", ".usable_sensors"),
        (r"^mode FAULT", ".mode"),
        (r"lost SYNC", ".sync_lost"),
        (r" axis ", "_not_following"),
        (r"is degraded", ".degraded"),
    )
)
_NUMBER: Final = re.compile(r"(?<![A-Z_])\d+(\.\d+)?( (s|ms|h)\b)?")  # not of SENSOR_3
_ORDER: Final = {"bad": 0, "warning": 1, "note": 2}


def facts() -> JsonObject:
    """Return what a page needs to judge troubles itself."""
    kinds = [[pattern.pattern, severity, page] for pattern, severity, page in _KINDS]
    return {"kinds": kinds, "order": _ORDER}


def key_of(trouble: str) -> str:
    """Return what stays of a trouble's words while it lasts: all but amounts and ages."""
    if "left out" in trouble or "identifier" in trouble:
        return trouble.partition(",")[0]
    if trouble.startswith("injected"):
        return trouble.partition(":")[0]
    return _NUMBER.sub("#", trouble)


def kind_of(trouble: str) -> tuple[str, str | None]:
    """Return how severe a trouble is, and the guide that explains it, with its section."""
    for pattern, severity, page in _KINDS:
        if pattern.search(trouble):
            return severity, page
    return "warning", None


def _begin_of(
    trouble: str, changed_s: Mapping[str, float], after_s: float, until_s: float
) -> float:
    """Return when a trouble began that was not there at a look, and is at the next one."""
    words = next((words for pattern, words in _BEGIN_WITH if pattern.search(trouble)), None)
    times = [
        time
        for signal, time in changed_s.items()
        if words and words in signal and after_s < time <= until_s
    ]
    return max(times, default=until_s)


class Since:
    """Remembers since when each trouble has been there.

    Live, it is told all troubles now and then. Of a recording it is told all of them once, in
    order, and `is_whole` is set: then it finds when a trouble began, wherever the playback is.
    """

    def __init__(self) -> None:
        self.is_whole = False
        self._spans: dict[str, list[list[float]]] = {}  # by key: begin and end of each time
        self._last_s = 0.0

    def follow(
        self, time_s: float, troubles: list[str], changed_s: Mapping[str, float] | None = None
    ) -> None:
        """Take the troubles of a moment, and the bus times at which signals of events changed."""
        if self.is_whole:
            return
        if time_s < self._last_s:
            self._spans.clear()
        for trouble in troubles:
            spans = self._spans.setdefault(key_of(trouble), [])
            if spans and spans[-1][1] == self._last_s:
                spans[-1][1] = time_s
            else:
                begin_s = _begin_of(trouble, changed_s or {}, self._last_s, time_s)
                spans.append([begin_s, time_s])
        self._last_s = time_s

    def told(self, time_s: float, troubles: list[str]) -> list[JsonObject]:
        """Return the troubles of a moment for the page, the most severe first."""
        found = []
        for text in troubles:
            severity, page = kind_of(text)
            spans = self._spans.get(key_of(text), [])
            begun = [begin for begin, _ in spans if begin <= time_s + 1e-9]
            one: JsonObject = {"text": text, "severity": severity, "page": page}
            found.append(one | {"since_s": begun[-1] if begun else None})
        return sorted(found, key=lambda one: _ORDER[str(one["severity"])])
