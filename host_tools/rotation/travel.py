"""Axis travel of a scheme in one cycle, which determines wear and the need for a slip ring."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rrins.firmware_py.core.settings import Scheme


@dataclass(frozen=True)
class AxisTravel:
    """Travel of one axis in one cycle that starts at 0°.

    Attributes
    ----------
    forward_deg, backward_deg : float
        Travel in each direction, both positive.
    lowest_deg, highest_deg : float
        Extreme angles.
    """

    forward_deg: float
    backward_deg: float
    lowest_deg: float
    highest_deg: float
    #: angle at the end of the cycle; unless it is 0, the axis keeps winding and needs a slip ring
    net_deg: float
    reversals: int  #: changes of direction within the cycle and into the next

    @property
    def range_deg(self) -> float:
        """Range of angles in one cycle."""
        return self.highest_deg - self.lowest_deg


@dataclass(frozen=True)
class Travel:
    """Travel of both axes in one cycle."""

    inner: AxisTravel
    outer: AxisTravel

    @property
    def returns(self) -> bool:
        """Whether the sensor frame ends in its initial attitude, so that all cycles are alike."""
        return self.inner.net_deg % 360 == 0 and self.outer.net_deg % 360 == 0


def travel_of(scheme: Scheme) -> Travel:
    """Return the travel of both axes in one cycle of a scheme."""
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
