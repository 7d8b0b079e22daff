"""Numbers of several runs side by side, which the processor computes with at once.

Compiled code that loads a row of eight floats has them as `Lanes`, and computes with these as with
one float: ``+ - * /``, ``math.sqrt`` and `abs`, also with floats that hold for all lanes. So one
formula serves a run or eight of them, as long as it has no branch that depends on a lane.

Plain Python has no lanes: what computes with them runs compiled or not at all.
"""

from __future__ import annotations

import functools
from typing import Any

from rrins.compiled.kinds import LANES as LANES

Lanes = Any
"""Eight floats."""


class Operation:
    """Something that compiled code does with lanes, beside arithmetic."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __call__(self, *arguments: object) -> Any:
        """Refuse: only compiled code has lanes."""
        raise TypeError(f"{self.name} is for compiled code")

    @functools.cached_property
    def _numba_type_(self) -> object:
        from rrins.compiled.lane_types import operation_type

        return operation_type(self.name)


spread = Operation("spread")
"""``spread(x)``: a float in all lanes."""

fetch = Operation("fetch")
"""``fetch(array, index)``: have what surrounds an element brought from memory; wait for nothing."""

load = Operation("load")
"""``load(array, row)``: a row of an array of shape (n, `LANES`)."""

store = Operation("store")
"""``store(array, row, lanes)``: write such a row."""

rounded = Operation("rounded")
"""``rounded(lanes)``: to the nearest whole number, of two to the even one."""

sign = Operation("sign")
"""``sign(lanes)``: 1, or -1 of what is negative."""

larger = Operation("larger")
"""``larger(one, other)``: the larger one of each lane."""

unchanged = Operation("unchanged")
"""``unchanged(before, one, other)``: one more than before where two are equal, else zero."""
