"""The phases of a run in which a part may fail."""

from __future__ import annotations

from typing import Final

from rrins.host_tools.scenario.scenario import Scenario

PHASES: Final = ("alignment", "first_turn", "later", "outage")
"""Within the alignment, the table's first turn, half-way through, and soon after GNSS is lost."""

_AFTER_OUTAGE_S = 10.0
"""From the beginning of an outage to the fault, at most."""


def instants(scenario: Scenario) -> dict[str, int]:
    """Return the epoch in which a fault begins, of each phase that a scenario has."""
    rate_hz, begin = scenario.rate_hz, scenario.navigation_epoch
    end = begin + round(scenario.duration_s * rate_hz)
    aligning_s = scenario.firmware.alignment_s + scenario.estimator.fine_alignment_s
    found = {"alignment": begin - max(1, round(0.5 * aligning_s * rate_hz))}
    if scenario.mode == "rotating":
        turn = scenario.scheme.turns[0]
        half_s = 0.5 * abs(turn.angle_deg) / scenario.scheme.turn_rate_dps
        found["first_turn"] = begin + round(half_s * rate_hz)
    found["later"] = begin + round(0.5 * scenario.duration_s * rate_hz)
    for outage in scenario.gnss.outages if scenario.gnss is not None else ():
        at_s = outage.at_s + min(_AFTER_OUTAGE_S, 0.5 * outage.for_s)
        if begin < (epoch := round(at_s * rate_hz)) < end:
            found["outage"] = epoch
            break
    return {name: epoch for name, epoch in found.items() if 0 < epoch < end}
