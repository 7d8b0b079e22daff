"""Finds the scheme that shows the constants best in a given time, within the table's limits.

Turns are whole quarter turns, so a scheme is a path through 16 attitudes of the table. The
information of a quarter turn from each attitude, and of a rest in each, adds up: it is computed
once, and a scheme's is a sum. Among schemes, annealing: change, insert, remove or exchange a move,
keep what is better, and now and then what is not (Kirkpatrick, Science 220 (1983) 671).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Floats
from rrins.firmware_py.core.records.memory import SCHEME_CAPACITY
from rrins.firmware_py.core.settings import Scheme, Turn
from rrins.host_tools.calibration.estimation import Unit, normal_equations, scales
from rrins.host_tools.calibration.ideal import of_leg
from rrins.host_tools.calibration.model import BASE, CONSTANTS
from rrins.host_tools.calibration.observability import LIMITS, noise_of, prior_of
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.rotation.kinematics import INNER, OUTER, Leg

_LONGEST_QUARTERS = 4
_CHECKED = 50

Move = tuple[int, int]
"""Axis and signed quarter turns."""


@dataclass(frozen=True)
class SearchLimits:
    """Limits of a scheme.

    Attributes
    ----------
    inner_range_deg, outer_range_deg : float
        Largest range of each axis.
    """

    duration_s: float = 1720.0  #: of a cycle, at most
    turn_rate_dps: float = 2.0
    stand_s: float = 10.0
    inner_range_deg: float = 720.0
    outer_range_deg: float = 360.0


@dataclass(frozen=True)
class Found:
    """A scheme and its merit: the largest standard deviation over its limit; see `merit_of`."""

    scheme: Scheme
    merit: float


class _Information:
    """The information of every quarter turn and rest."""

    def __init__(self, unit: Unit, limits: SearchLimits) -> None:
        self.unit = unit
        counts = (len(unit.gyros), len(unit.accelerometers))
        noise = noise_of(unit, 0.005, 10.0)
        weight = np.outer(scales(unit) * prior_of(unit), scales(unit) * prior_of(unit))
        quarter_s = 90.0 / limits.turn_rate_dps

        def of(leg: Leg) -> Floats:
            return normal_equations(unit, of_leg(leg, *counts), *noise) * weight

        self.rest: dict[tuple[int, int], Floats] = {}
        self.turn: dict[tuple[int, int, int, int], Floats] = {}
        for inner in range(4):
            for outer in range(4):
                start = (90.0 * inner, 90.0 * outer)
                if limits.stand_s > 0:
                    self.rest[inner, outer] = of(Leg(1, None, start, 0.0, limits.stand_s))
                else:
                    self.rest[inner, outer] = np.zeros_like(weight)
                for axis in (INNER, OUTER):
                    for sign in (1, -1):
                        leg = Leg(1, axis, start, 90.0 * sign, quarter_s)
                        self.turn[inner, outer, axis, sign] = of(leg)

    def of_moves(self, moves: list[Move]) -> Floats:
        """Return the information of moves from zero."""
        at = [0, 0]
        total = np.zeros_like(self.rest[0, 0])
        for axis, quarters in moves:
            sign = 1 if quarters > 0 else -1
            for _ in range(abs(quarters)):
                total += self.turn[at[0] % 4, at[1] % 4, axis, sign]
                at[axis] += sign
            total += self.rest[at[0] % 4, at[1] % 4]
        return total


def merit_of(unit: Unit, information: Floats) -> float:
    """Return a mean of ten figures over their limits, for weighted information.

    The figures are the root mean squares over the sensors of each of the five constants of gyros
    and accelerometers; the limits `observability.LIMITS`; the mean is that of the fourth powers, so
    that the worst counts most. Less is better.
    """
    left = np.linalg.inv(information + np.eye(len(information)))
    sigma = np.sqrt(np.diag(left)) * prior_of(unit)
    gyros = len(CONSTANTS) * len(unit.gyros)
    parts = (sigma[:gyros], sigma[gyros:-BASE])
    ratios = [
        np.sqrt((part.reshape(-1, len(CONSTANTS)) ** 2).mean(axis=0)) / limit
        for part, limit in zip(parts, LIMITS, strict=True)
    ]
    return float((np.concatenate(ratios) ** 4).mean() ** 0.25)


def _fits(moves: list[Move], limits: SearchLimits) -> bool:
    if not moves or len(moves) > SCHEME_CAPACITY:
        return False
    quarters = sum(abs(quarter) for _, quarter in moves)
    duration_s = quarters * 90.0 / limits.turn_rate_dps + len(moves) * limits.stand_s
    if duration_s > limits.duration_s + 1e-9:
        return False
    for axis, most_deg in ((INNER, limits.inner_range_deg), (OUTER, limits.outer_range_deg)):
        reached = np.cumsum([0, *(q for a, q in moves if a == axis)])
        if reached[-1] != 0 or 90.0 * (reached.max() - reached.min()) > most_deg + 1e-9:
            return False
    return True


def _changed(moves: list[Move], rng: np.random.Generator) -> list[Move]:
    changed = list(moves)
    for _ in range(int(rng.integers(1, 4))):
        what, k = int(rng.integers(4)), int(rng.integers(max(1, len(changed))))
        quarters = int(rng.integers(0, _LONGEST_QUARTERS + 1)) * (1 if rng.random() < 0.5 else -1)
        move = (int(rng.integers(2)), quarters)
        if what == 0 or not changed:
            changed.insert(k, move)
            if quarters:
                changed.insert(int(rng.integers(len(changed) + 1)), (move[0], -quarters))
        elif what == 1:
            changed.pop(k)
        elif what == 2:
            changed[k] = move
        else:
            other = int(rng.integers(len(changed)))
            changed[k], changed[other] = changed[other], changed[k]
    return changed


def _merged(moves: list[Move]) -> list[Move]:
    """Return the moves without empty ones, neighbours on one axis in one sense as one."""
    merged: list[Move] = []
    for axis, quarters in moves:
        if merged and merged[-1][0] == axis and merged[-1][1] * quarters > 0:
            total = merged[-1][1] + quarters
            if abs(total) <= _LONGEST_QUARTERS:
                merged[-1] = (axis, total)
                continue
        merged.append((axis, quarters))
    return merged


def _scheme(moves: list[Move], limits: SearchLimits) -> Scheme:
    turns = tuple(
        Turn(axis="inner" if axis == INNER else "outer", angle_deg=90.0 * quarters)
        for axis, quarters in moves
    )
    return Scheme(turns=turns, turn_rate_dps=limits.turn_rate_dps, stand_s=limits.stand_s)


def search(
    unit: Unit,
    limits: SearchLimits,
    begin: Scheme,
    tries: int = 20_000,
    seed: int = 1,
    on_progress: Callable[[int, int], None] | None = None,
) -> Found:
    """Return the best scheme that was found.

    Parameters
    ----------
    begin : Scheme
        Whole quarter turns; where the search begins, as far as it fits the limits.
    on_progress : callable, optional
        Receives the number of tries done and the total.

    Raises
    ------
    RehearsalError
        When no scheme fits the limits.
    """
    rng = np.random.default_rng(seed)
    information = _Information(unit, limits)
    now = [
        (INNER if turn.axis == "inner" else OUTER, round(turn.angle_deg / 90.0))
        for turn in begin.turns
    ]
    while now and not _fits(now, limits):
        now.pop()
    if not now:
        now = _first(limits)
    merit = merit_of(unit, information.of_moves(now))
    best, best_merit = list(now), merit
    for k in range(tries):
        heat = 0.05 * (1.0 - k / tries) ** 2
        tried = _merged(_changed(now, rng))
        if _fits(tried, limits):
            value = merit_of(unit, information.of_moves(tried))
            if math.log(value / merit) < -heat * math.log(1.0 - rng.random()):
                now, merit = tried, value
            if merit < best_merit:
                best, best_merit = list(now), merit
        if on_progress is not None and k % _CHECKED == 0:
            on_progress(k, tries)
    return Found(_scheme(best, limits), best_merit)


def _first(limits: SearchLimits) -> list[Move]:
    for turn in (4, 2, 1):
        for axis in (OUTER, INNER):
            moves = [(axis, turn), (axis, -turn)]
            if _fits(moves, limits):
                return moves
    raise RehearsalError(
        f"no scheme of quarter turns lasts {limits.duration_s:g} s at most within these ranges"
    )
