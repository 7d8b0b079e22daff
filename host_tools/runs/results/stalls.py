"""A stall of the machine in real time, and the fault that it led to."""

from __future__ import annotations

from rrins.host_tools.files import JsonObject
from rrins.host_tools.runs.results.summary_types import StallSummary

_AFTERMATH_S = 1.0  # by then a stall has shown in the firmware


def stall_before_fault(
    firmware: JsonObject, hardware: JsonObject, navigated_until_s: float | None, bridge_s: float
) -> JsonObject | None:
    """Return the stall that made the firmware lose its sensors: `side`, `at_s`, `late_ms`.

    None where the run did not end in FAULT (SENSORS_LOST), or no stall was so long.

    Parameters
    ----------
    firmware, hardware : dict
        The summaries of both sides.
    navigated_until_s : float or None
        Simulated time of the last epoch that was navigated; None where that is not known.
    bridge_s : float
        How long the firmware navigates without sensors.
    """
    if firmware.get("fault") != "SENSORS_LOST":
        return None
    stalls = [
        {"side": side, **stall}
        for side, summary in (("hardware", hardware), ("firmware", firmware))
        for stall in summary.get("lateness_us", {}).get("stalls", ())
        if stall["late_ms"] / 1e3 > bridge_s / 2 and _led_to(stall, navigated_until_s, bridge_s)
    ]
    return max(stalls, key=lambda stall: stall["late_ms"], default=None)


def _led_to(stall: JsonObject, navigated_until_s: float | None, bridge_s: float) -> bool:
    """Return whether navigation ended with a stall."""
    if navigated_until_s is None:
        return True
    end_s = stall["at_s"] + stall["late_ms"] / 1e3 + bridge_s + _AFTERMATH_S
    return bool(stall["at_s"] - _AFTERMATH_S <= navigated_until_s <= end_s)


def stall_words(stall: StallSummary) -> str:
    """Return what a person reads of a stall."""
    return (
        f"the {stall['side']} was {stall['late_ms']:.0f} ms late at {stall['at_s']:.1f} s: the "
        "machine stalled; rehearse where less runs beside, or without --speed 1"
    )
