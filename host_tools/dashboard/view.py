"""View of one run: its latest row, its history, its events, a snapshot of its bus."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.dashboard import events, quantities
from rrins.host_tools.dashboard.bus_table import state_of
from rrins.host_tools.dashboard.diagnosis import DiagnosisEvents
from rrins.host_tools.dashboard.history import History
from rrins.host_tools.dashboard.now import Since
from rrins.host_tools.dashboard.quantities import NAMES, Quantities, SchemeAngles
from rrins.host_tools.dashboard.truth import Truth
from rrins.host_tools.diag.trace import Trace
from rrins.host_tools.files import JsonObject
from rrins.host_tools.monitor.dialogue import Dialogue
from rrins.host_tools.monitor.state import BusState
from rrins.host_tools.monitor.troubles import troubles_of
from rrins.host_tools.monitor.vitals import vitals_of
from rrins.host_tools.monitor.watch import Latest, Watch
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.xcp.trace import MeasuredData

_LOAD_NS: Final = 1_000_000_000  # over which the load is taken, at least
_GAP_NS: Final = 60_000_000_000  # beyond which a load means nothing
_REAL_TIME: Final = (0.97, 1.03)  # speeds at which lateness means something
_MOST_SENSORS: Final = 16


def scheme_angles(scenario: Scenario) -> SchemeAngles:
    """Return where a scenario's scheme wants the axes."""
    turned = np.zeros((len(scenario.scheme.turns), 2))
    for row, turn in zip(turned, scenario.scheme.turns, strict=True):
        row[0 if turn.axis == "inner" else 1] = turn.angle_deg
    held = np.cumsum(turned, axis=0)
    return SchemeAngles(held, held[-1] if len(held) else np.zeros(2))


class View:
    """One run, as an observer of its bus sees it.

    Parameters
    ----------
    watch : Watch
    scenario : Scenario or None
        For the truth, the scheme and the sensors; None if it is not known.

    Attributes
    ----------
    history : History
    log : EventLog
    dialogue : Dialogue
        Diagnosis and measured data.
    row : array
        The latest quantities, in the order of `NAMES`.
    time_s : float
        Bus time of the row.
    keeps : bool
        Whether rows and events are added to history and log.
    since : Since
        When troubles began.
    """

    def __init__(self, watch: Watch, scenario: Scenario | None) -> None:
        self.watch = watch
        self.scenario = scenario
        self.history = History(len(NAMES))
        self.log = events.EventLog()
        self.row: Floats = np.full(len(NAMES), math.nan)
        self.time_s = 0.0
        self.dialogue = Dialogue(watch, Trace(), MeasuredData())
        self._diagnosis = DiagnosisEvents()
        self._sampled = quantities.rows_of(quantities.SAMPLED)
        self._rows = np.concatenate([self._sampled, quantities.rows_of(events.SIGNALS)])
        self._quantities = self._new_quantities()
        self.keeps = True
        self.since = Since()
        self._looked_ns: int | None = None
        self._marks: deque[tuple[int, int]] = deque()
        self._speed: float | None = None
        self._least_lag_ns: int | None = None

    def _new_quantities(self) -> Quantities:
        if self.scenario is None:
            return Quantities(None, None)
        scheme = scheme_angles(self.scenario) if self.scenario.mode == "rotating" else None
        return Quantities(Truth(self.scenario), scheme)

    def look(self) -> bool:
        """Take a row and what has happened; return whether there is anything new."""
        latest = self.watch.latest(self._rows)
        if latest.now_ns == self._looked_ns:
            return False
        self._looked_ns = latest.now_ns
        sampled = latest.values[: len(self._sampled)]
        of_events = latest.values[len(self._sampled) :]
        lateness = self._lateness_ms(latest.heard_ns - latest.now_ns)
        self.time_s = latest.now_ns / 1e9
        self.row = self._quantities.row(sampled, self._load_percent(latest), lateness)
        if self.keeps:
            self.history.add(self.time_s, self.row)
            self.log.follow(of_events, latest.changed_ns[len(self._sampled) :] / 1e9)
            self.hear()
        return True

    def hear(self) -> None:
        """Follow measured data; add what was said in diagnosis to the events."""
        for one in self.dialogue.look():
            if not self.keeps:
                continue
            event = self._diagnosis.event_of(one)
            if event is not None:
                self.log.add(one.time_s, *event)

    def forget(self) -> None:
        """Forget what was computed from earlier frames: the watch has gone to another time."""
        self._looked_ns = None
        self._marks.clear()
        self._quantities.forget()

    def _load_percent(self, latest: Latest) -> float:
        """Return how busy the wire was in about the last second of bus time."""
        marks = self._marks
        if marks and not 0 <= latest.now_ns - marks[-1][0] <= _GAP_NS:
            marks.clear()
        marks.append((latest.now_ns, latest.busy_ns))
        while len(marks) > 2 and latest.now_ns - marks[1][0] >= _LOAD_NS:
            marks.popleft()
        begun_ns, busy_ns = marks[0]
        passed_ns = latest.now_ns - begun_ns
        return 100 * (latest.busy_ns - busy_ns) / passed_ns if passed_ns else math.nan

    def _lateness_ms(self, lag_ns: int) -> float:
        """Return by how much the bus is behind its clock, as far as an observer can tell."""
        if self._speed is None or not _REAL_TIME[0] <= self._speed <= _REAL_TIME[1]:
            self._least_lag_ns = None
            return math.nan
        self._least_lag_ns = min(self._least_lag_ns or lag_ns, lag_ns)
        return (lag_ns - self._least_lag_ns) * 1e-6

    def sensor_counts(self, state: BusState) -> dict[str, int]:
        """Return the number of gyros and accelerometers: the scenario's, or the groups seen."""
        if self.scenario is not None:
            rimu = self.scenario.rimu
            return {"gyros": len(rimu.gyros), "accelerometers": len(rimu.accelerometers)}
        seen = [n for n in range(1, _MOST_SENSORS + 1) if state.message(f"SENSOR_{n}") is not None]
        return dict.fromkeys(("gyros", "accelerometers"), max(seen, default=0))

    def state(self, has_histories: bool) -> BusState:
        """Return a snapshot of the bus; see `Watch.state`."""
        state = self.watch.state(has_histories)
        self._speed = state.times.speed
        if not self.since.is_whole:
            changed_ns = self.watch.latest(self._rows).changed_ns[len(self._sampled) :]
            changed_s = dict(zip(events.SIGNALS, (changed_ns / 1e9).tolist(), strict=True))
            self.since.follow(state.time_s, troubles_of(state, vitals_of(state)), changed_s)
        return state

    def told(self, state: BusState) -> JsonObject:
        """Return what the page gets of a snapshot."""
        told = state_of(state, self.sensor_counts(state))
        return told | {"troubles": self.since.told(state.time_s, told["troubles"])}
