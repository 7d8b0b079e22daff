"""What a run's summary says of redundant sensors: alarms, what was left out, what was repaired."""

from __future__ import annotations

from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.redundancy_records import Found, Parity, Readmission, Refusal
from rrins.host_tools.files import JsonObject
from rrins.host_tools.monitor.words import FOUND_BY, NOT_READMITTED

KINDS = ("gyros", "accelerometers")


def _of_kind(state: Ram, parity: Parity, count: int) -> JsonObject:
    rate_hz = 1e9 / int(state.parameters.period_ns)
    begun = int(state.redundancy.navigation_epoch)

    def seconds(epoch: int) -> float:
        return round((epoch - begun) / rate_hz, 3)

    isolated = int(parity.isolated) >= 0
    alarmed = isolated or int(parity.alarm_epoch) > 0
    is_open = int(parity.alarm_epoch) > (int(parity.found_epoch) if isolated else 0)
    excluded = [k + 1 for k in range(count) if int(parity.excluded) >> k & 1]
    repaired = isolated and int(parity.repaired_epoch) >= 0
    came_back = int(parity.readmitted) >= 0
    alarm_epoch = parity.found_epoch if isolated else parity.alarm_epoch
    return {
        "alarm_s": seconds(int(alarm_epoch)) if alarmed else None,
        "isolated_s": seconds(int(parity.isolated_epoch)) if isolated else None,
        "sensor": int(parity.isolated) + 1 if isolated else None,
        "how": Found(int(parity.how)).name.lower() if isolated else None,
        "excluded": excluded or None,
        "repaired": seconds(int(parity.repaired_epoch)) if repaired else None,
        "unresolved_s": seconds(int(parity.alarm_epoch)) if is_open else None,
        "readmitted": int(parity.readmitted) + 1 if came_back else None,
        "readmitted_s": seconds(int(parity.readmitted_epoch)) if came_back else None,
        "readmission_refused": _refusal(state.redundancy.readmission, int(parity.kind)),
        "redundancy_left": bool(parity.redundant),
    }


def _refusal(readmission: Readmission, kind: int) -> str | None:
    """Return why the last order to readmit a sensor was refused, if it was of this kind."""
    if not readmission.refusal or int(readmission.kind) != kind:
        return None
    return Refusal(int(readmission.refusal)).name.lower()


def redundancy_summary(state: Ram) -> JsonObject | None:
    """Return what happened to the sensors of each kind; None if they are not compared.

    Times are seconds since navigation began, null where nothing happened.
    """
    redundancy = state.redundancy
    if not redundancy.enabled:
        return None
    counts = (int(state.gyros.count), int(state.accelerometers.count))
    kinds = (redundancy.gyros, redundancy.accelerometers)
    return {
        name: _of_kind(state, parity, count)
        for name, parity, count in zip(KINDS, kinds, counts, strict=True)
    }


def redundancy_lines(redundancy: JsonObject | None) -> list[str]:
    """Return the lines of the summary for a person; none if nothing happened."""
    lines = []
    for name, kind in (redundancy or {}).items():
        one = name.removesuffix("s")
        if kind["isolated_s"] is not None:
            text = f"{one} {kind['sensor']} left out at {kind['isolated_s']:.3f} s"
            text += f" (found by {FOUND_BY[kind['how'].upper()]}, alarm at {kind['alarm_s']:.3f} s)"
            if kind["repaired"] is not None:
                text += f", navigation repaired from {kind['repaired']:.0f} s on"
            if not kind["redundancy_left"]:
                text += "; no redundancy left"
            lines.append(text)
        if kind["readmitted_s"] is not None:
            lines.append(
                f"{one} {kind['readmitted']} in use again from {kind['readmitted_s']:.3f} s on"
            )
        if kind["readmission_refused"] is not None:
            refusal = NOT_READMITTED[kind["readmission_refused"].upper()]
            lines.append(f"{one} not readmitted: {refusal}")
        if kind["unresolved_s"] is not None:
            lines.append(
                f"one of the {name} fails since {kind['unresolved_s']:.3f} s: unknown which, or "
                "none can be spared; all in use"
            )
    return lines
