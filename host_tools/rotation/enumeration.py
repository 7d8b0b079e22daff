"""Enumerates all half-turn schemes that follow the paper's principles within given ranges.

Principles (paper, section 3), as followed by table 1:

1. One axis turns at a time, by half turns.
2. The axis changes after every half turn. Table 1 turns one axis twice in a row only where a group
   of four positions ends (rows 4-5, 8-9, 12-13).
3. An axis reverses after a half turn: within a group of four positions each axis turns once in each
   direction *as seen from the body*. For the inner axis that direction is the turntable's, or the
   opposite while the outer axis has it upside down.
4. The second half is the mirror image of the first: "retraced" as in table 1, the turns in reverse
   order and opposite sense; "inverted", in the same order and opposite sense; or "reversed", in
   reverse order and the same sense, as rows 5-8 after rows 1-4. With a slip ring also "repeated":
   the same turns again.

Both axes return to 0; with a slip ring the inner one may end whole turns away.

`loose` drops principle 3 and relaxes 2: no axis may turn three times in a row within a half.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.rotation.kinematics import INNER, OUTER

Moves = NDArray[np.int8]
"""Half turns, shape (n, positions): 0 inner +, 1 inner -, 2 outer +, 3 outer -."""

MIRRORS: Final = ("retraced", "inverted", "reversed", "repeated")
SENSE: Final = np.array([1, -1, 1, -1], dtype=np.int8)

_GROUP = 4
_MOST_POSITIONS = 64  # limit of the firmware
_MOST_HALVES = 400_000


class SearchError(RehearsalError):
    """No scheme is within the limits of a search, or too many are."""


@dataclass(frozen=True)
class Limits:
    """Limits of a search; the default ranges are those of table 1.

    Attributes
    ----------
    inner_range_deg, outer_range_deg : float
        Maximum range of angles of an axis.
    turn_rate_dps, stand_s : float
        Rate of turning, and standing time after each turn.
    """

    positions: int = 16  #: even, 4 to 64
    inner_range_deg: float = 720.0
    outer_range_deg: float = 360.0
    slip_ring: bool = False  #: whether the inner axis may rotate without limit
    loose: bool = False  #: see the module docstring
    turn_rate_dps: float = 2.0
    stand_s: float = 10.0


def candidates(limits: Limits) -> tuple[Moves, NDArray[np.int8]]:
    """Return all schemes within limits, with the index of their mirroring in `MIRRORS`.

    Raises
    ------
    SearchError
        If no scheme is within the limits, or too many would have to be tried.
    """
    if limits.positions % 2 or not _GROUP <= limits.positions <= _MOST_POSITIONS:
        raise SearchError(f"--positions {limits.positions}: must be even, 4 to {_MOST_POSITIONS}")
    halves = np.zeros((1, 0), dtype=np.int8)
    for _ in range(limits.positions // 2):
        halves = _within(_extended(halves, limits.loose), limits)
        if len(halves) > _MOST_HALVES:
            raise SearchError(
                f"--positions {limits.positions}: over {_MOST_HALVES} first halves to try; "
                "use fewer positions or narrower ranges"
            )
    found = [_within(whole, limits) for whole in _mirrored(halves, limits.slip_ring)]
    moves = np.concatenate(found)
    if not len(moves):
        raise SearchError("no half-turn scheme fits these ranges; allow wider ones")
    mirrors = np.repeat(np.arange(len(found), dtype=np.int8), [len(part) for part in found])
    moves, first = np.unique(moves, axis=0, return_index=True)
    return moves, mirrors[first]


def angles(moves: Moves, axis: int) -> NDArray[np.int_]:
    """Return the angle of an axis at the beginning and after each position, in half turns."""
    steps = np.where(moves // 2 == axis, SENSE[moves], 0)
    start = np.zeros((len(moves), 1), dtype=int)
    return np.concatenate([start, np.cumsum(steps, axis=1)], axis=1)


def _extended(moves: Moves, loose: bool) -> Moves:
    """Return the sequences extended by every half turn that the principles allow."""
    count, done = moves.shape
    following = np.tile(np.arange(4, dtype=np.int8), count)[:, None]
    longer = np.concatenate([np.repeat(moves, 4, axis=0), following], axis=1)
    axis = longer // 2
    if loose:
        if done < 2:
            return longer
        return longer[(axis[:, -1] != axis[:, -2]) | (axis[:, -1] != axis[:, -3])]
    allowed = np.ones(len(longer), dtype=bool)
    if done % _GROUP >= 1:
        allowed &= axis[:, -1] != axis[:, -2]
    if done % _GROUP >= 2:
        sense = _body_sense(longer)
        allowed &= sense[:, -1] == -sense[:, -3]
    return longer[allowed]


def _body_sense(moves: Moves) -> NDArray[np.int8]:
    """Return the sense of each half turn as seen from the body, ±1."""
    turned_over = angles(moves, OUTER)[:, :-1] % 2
    sense = SENSE[moves]
    return np.where(moves // 2 == INNER, sense * (1 - 2 * turned_over), sense).astype(np.int8)


def _within(moves: Moves, limits: Limits) -> Moves:
    """Return the sequences within the ranges."""
    keeps = np.ptp(angles(moves, OUTER), axis=1) * 180 <= limits.outer_range_deg
    if not limits.slip_ring:
        keeps &= np.ptp(angles(moves, INNER), axis=1) * 180 <= limits.inner_range_deg
    return moves[keeps]


def _mirrored(halves: Moves, slip_ring: bool) -> Iterator[Moves]:
    """Yield the complete schemes, in the order of `MIRRORS`."""
    opposite = halves ^ 1
    yield np.concatenate([halves, opposite[:, ::-1]], axis=1)
    yield np.concatenate([halves, opposite], axis=1)
    # These two repeat the net rotation of the first half.
    inner, outer = angles(halves, INNER)[:, -1], angles(halves, OUTER)[:, -1]
    comes_back = (outer == 0) & ((inner == 0) | slip_ring)
    yield np.concatenate([halves, halves[:, ::-1]], axis=1)[comes_back]
    if slip_ring:
        yield np.concatenate([halves, halves], axis=1)[comes_back]
