"""Events of a run, and when they happened: faults, orders, modes, and what the firmware found."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rrins.compiled.record import Records
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.records.memory import NavigationOutput
from rrins.host_tools.files import JsonObject
from rrins.host_tools.injection.fault_report import fault_keys, fault_words
from rrins.host_tools.monitor.words import FOUND_BY, NOT_READMITTED
from rrins.host_tools.runs.results.summary_types import Summary
from rrins.host_tools.scenario.scenario import Scenario


class Event(NamedTuple):
    """Something that happened."""

    time_s: float
    """Since navigation began."""
    kind: str
    """`fault`, `request`, `mode`, `outage`, `alarm`, `exclusion`, `readmission` or `finding`."""
    text: str


def events_of(
    scenario: Scenario, summary: Summary, navigation: Records[NavigationOutput]
) -> list[Event]:
    """Return what happened in a run, in order of time."""
    first = int(navigation["epoch"][0]) if len(navigation) else scenario.navigation_epoch
    begin_s = first / scenario.rate_hz
    found = [Event(at_s - begin_s, kind, text) for at_s, kind, text in _planned(scenario)]
    end_s = float(summary["duration_s"])
    found = [event for event in found if event.time_s <= end_s]
    found += _modes(navigation, first, scenario.rate_hz)
    for kind, sensors in (summary["redundancy"] or {}).items():
        if isinstance(sensors, dict):
            found += _of_sensors(kind.removesuffix("s"), sensors)
    for axis, encoder in (summary["firmware"].get("encoders") or {}).items():
        if encoder is not None:
            words = f"the {axis} encoder contradicts the gyros"
            found.append(Event(encoder["found_at_s"] - begin_s, "finding", words))
    return sorted(found, key=lambda event: event.time_s)


def _planned(scenario: Scenario) -> Iterator[Event]:
    """Yield what the scenario has, in seconds since power-on."""
    for fault in scenario.faults:
        words = fault_words(fault_keys(fault))
        yield Event(fault.at_s, "fault", words)
        if fault.for_s is not None:
            yield Event(fault.at_s + fault.for_s, "fault", f"{words} ends")
    for request in scenario.requests:
        yield Event(request.at_s, "request", request.request)
    for order in scenario.redundancy.readmit:
        yield Event(order.at_s, "request", f"readmit {order.kind} {order.sensor}")
    for still in scenario.zero_velocity:
        yield Event(still.at_s, "request", "zero velocity")
        yield Event(still.at_s + still.for_s, "request", "zero velocity ends")
    for name in ("gnss", "master"):
        unit = getattr(scenario, name)
        for outage in () if unit is None else unit.outages:
            yield Event(outage.at_s, "outage", f"{name} has no fix" if name == "gnss" else name)
            yield Event(outage.at_s + outage.for_s, "outage", f"{name} is back")


def _modes(navigation: Records[NavigationOutput], first: int, rate_hz: int) -> Iterator[Event]:
    modes = navigation["mode"]
    changes = np.flatnonzero(np.diff(modes, prepend=-1))
    for k in changes.tolist():
        time_s = (int(navigation["epoch"][k]) - first) / rate_hz
        yield Event(time_s, "mode", Mode(int(modes[k])).name)


def _of_sensors(one: str, found: JsonObject) -> Iterator[Event]:
    """Yield what happened to the sensors of a kind."""
    if found["isolated_s"] is not None:
        by = FOUND_BY[found["how"].upper()]
        left = "" if found["redundancy_left"] else "; no redundancy left"
        yield Event(found["alarm_s"], "alarm", f"the {one}s disagree")
        words = f"{one} {found['sensor']} left out, found by {by}{left}"
        yield Event(found["isolated_s"], "exclusion", words)
    if found["repaired"] is not None:
        yield Event(found["repaired"], "finding", f"{one}s: navigation repaired from here on")
    if found["unresolved_s"] is not None:
        words = f"one of the {one}s fails: unknown which, or none can be spared"
        yield Event(found["unresolved_s"], "alarm", words)
    if found["readmitted_s"] is not None:
        words = f"{one} {found['readmitted']} in use again"
        yield Event(found["readmitted_s"], "readmission", words)
    if found["readmission_refused"] is not None:
        why = NOT_READMITTED[found["readmission_refused"].upper()]
        yield Event(float("nan"), "readmission", f"{one} not readmitted: {why}")
