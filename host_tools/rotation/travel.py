"""How far a scheme makes the axes of the turntable travel in one cycle: wear, and cable or ring."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from firmware_py.settings import Scheme


@dataclass(frozen=True)
class AxisTravel:
    """What one axis does in one cycle, which it begins at 0°.

    Attributes
    ----------
    forward_deg, backward_deg : float
        Travel in each sense, both positive.
    lowest_deg, highest_deg : float
        Angles that it reaches.
    net_deg : float
        Angle at the end of the cycle; unless 0, the axis winds on and needs a slip ring.
    reversals : int
        Changes of sense within the cycle and into the next.
    """

    forward_deg: float
    backward_deg: float
    lowest_deg: float
    highest_deg: float
    net_deg: float
    reversals: int

    @property
    def range_deg(self) -> float:
        """Width of the angles of one cycle."""
        return self.highest_deg - self.lowest_deg


@dataclass(frozen=True)
class Travel:
    """What both axes do in one cycle."""

    inner: AxisTravel
    outer: AxisTravel

    @property
    def returns(self) -> bool:
        """Whether the sensor frame ends as it began, so that every cycle is like the first."""
        return self.inner.net_deg % 360 == 0 and self.outer.net_deg % 360 == 0


def travel_of(scheme: Scheme) -> Travel:
    """Return what both axes do in one cycle of a scheme."""
    return Travel(_axis_travel(scheme, "inner"), _axis_travel(scheme, "outer"))


def _axis_travel(scheme: Scheme, axis: Literal["inner", "outer"]) -> AxisTravel:
    turns = [turn.angle_deg for turn in scheme.turns if turn.axis == axis and turn.angle_deg != 0]
    reached = [0.0]
    for turn in turns:
        reached.append(reached[-1] + turn)
    return AxisTravel(
        forward_deg=sum(turn for turn in turns if turn > 0),
        backward_deg=-sum(turn for turn in turns if turn < 0),
        lowest_deg=min(reached),
        highest_deg=max(reached),
        net_deg=reached[-1],
        reversals=sum(a * b < 0 for a, b in zip(turns, turns[1:] + turns[:1], strict=True)),
    )
