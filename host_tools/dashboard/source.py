"""Where the page's data come from: a bus, a rehearsal of its own, or a recording."""

from __future__ import annotations

from typing import Protocol

from rrins.host_tools.dashboard.page_orders import Order
from rrins.host_tools.dashboard.view import View, scheme_angles
from rrins.host_tools.files import JsonObject
from rrins.host_tools.scenario.scenario import Scenario


class Source(Protocol):
    """One source. All but `carry_out`, which may wait, is called by the loop of the server."""

    kind: str
    """`rehearsal`, `bus` or `recording`."""

    orders: frozenset[str]
    """The orders that it takes."""

    @property
    def view(self) -> View:
        """The view; another object once another run has begun."""

    def turn(self) -> None:
        """Do what is due; called some thirty times a second."""

    def describe(self) -> JsonObject:
        """Return what a browser needs to know once for each view."""

    def status(self) -> JsonObject:
        """Return how it is: `phase`, `words` and whatever belongs to the kind."""

    def carry_out(self, order: Order) -> JsonObject:
        """Carry out an order; return the answer's `text` and more once it is confirmed.

        Raises
        ------
        RehearsalError
            When it cannot be, or nobody confirms it.
        """

    def close(self) -> None:
        """Let go of everything."""


def described(scenario: Scenario | None) -> JsonObject | None:
    """Return what a page shows of a scenario: sensors, scheme, limits."""
    if scenario is None:
        return None
    angles = scheme_angles(scenario) if scenario.mode == "rotating" else None
    return {
        "title": scenario.title,
        "duration_s": scenario.epochs / scenario.rate_hz,
        "rate_hz": scenario.rate_hz,
        "mode": scenario.mode,
        "gyros_deg": [list(axis) for axis in scenario.rimu.gyros],
        "accelerometers_deg": [list(axis) for axis in scenario.rimu.accelerometers],
        "held_deg": [] if angles is None else angles.held_deg.tolist(),
        "moves": scenario.motion.kind not in ("rest", "none", "static"),
        "has_truth": True,
        "estimates": scenario.estimator.model_dump().get("enabled", True),
        "axes": {"gnss": scenario.gnss is not None, "odometer": scenario.odometer is not None},
    }
