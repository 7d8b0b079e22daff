"""The point and the noise of each run: they follow from root seed and number alone.

A run is addressed, not streamed: its point follows from the root seed and its number alone, so the
same run comes out of any worker, in any order. Run *i* belongs to a *block*: runs of one block
share what the design does not change between them, noise and power-up included, so that their
difference shows the change.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final, Literal

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.campaigns.distributions import Value
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.inputs import Input, correlated
from rrins.host_tools.campaigns.statistics import Integers

Design = Literal["random", "lhs", "sobol", "saltelli", "grid", "one-at-a-time"]
DESIGNS: Final = ("random", "lhs", "sobol", "saltelli", "grid", "one-at-a-time")
EXTENDABLE: Final = ("random", "sobol", "saltelli", "grid", "one-at-a-time")
"""Designs whose runs stay the same when more are asked for."""

_POINTS, _NOISE, _SEQUENCE = 0, 1, 2
"""Last word of the spawn keys, so that draws of one run are independent."""

_SEED_BITS = 53
"""Seeds are whole in every table and language."""

_EDGE = 2.0**-60
"""Smallest number of the unit cube, for no quantile is infinite."""


@dataclass(frozen=True)
class Plan:
    """The points of a campaign."""

    design: str
    inputs: tuple[Input, ...]
    factor: Floats  #: shape (n, n); cholesky factor of the correlations
    runs: int  #: counts for Latin hypercubes only, whose points depend on it
    root: int  #: the campaign's seed

    @property
    def block(self) -> int:
        """Runs of a block."""
        if self.design == "saltelli":
            return len(self.inputs) + 3
        if self.design == "grid":
            return math.prod(len(one.distribution.values) for one in self._swept)
        if self.design == "one-at-a-time":
            return 1 + sum(len(levels) for _, levels in self._alone)
        return 1

    def blocks(self, runs: Integers) -> Integers | None:
        """Return the block of each run; None where runs are independent."""
        return runs // self.block if self.block > 1 else None

    @property
    def _swept(self) -> tuple[Input, ...]:
        return tuple(one for one in self.inputs if one.distribution.kind == "list")

    def point(self, run: int) -> dict[Input, Value]:
        """Return the inputs of a run."""
        if self.design == "one-at-a-time":
            return self._one_at_a_time(run % self.block)
        unit = np.clip(self._unit(run), _EDGE, 1.0 - 2.0**-53)
        unit = correlated(unit, self.factor)
        point = {
            one: one.distribution.quantile(float(u))
            for one, u in zip(self.inputs, unit, strict=True)
        }
        return point | self._cell(run % self.block) if self.design == "grid" else point

    def seed(self, run: int) -> int:
        """Return the scenario's seed of a run: its noise, and what it draws at power-up."""
        block, at = divmod(run, self.block)
        other = self.design == "saltelli" and at >= self.block - 2
        return self._seed_of(block, other)

    def _seed_of(self, block: int, other: bool) -> int:
        sequence = np.random.SeedSequence(self.root, spawn_key=(block, _NOISE, int(other)))
        return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(64 - _SEED_BITS))

    def _unit(self, run: int) -> Floats:
        """Return the run's point of the unit cube, shape (inputs,)."""
        count = len(self.inputs)
        if not count:
            return np.zeros(0)
        if self.design == "lhs":
            return _hypercube(self.runs, count, self.root)[run]
        if self.design == "sobol":
            return _sobol(run, count, self.root)
        if self.design == "saltelli":
            return self._radial(*divmod(run, self.block))
        key = (run // self.block, _POINTS)
        return np.random.default_rng(np.random.SeedSequence(self.root, spawn_key=key)).random(count)

    def _radial(self, block: int, at: int) -> Floats:
        """Return a point of Saltelli's design: A, A with one input of B for each, …, B.

        The noise is the last input: A with the noise of B is the last but one. Saltelli et al.,
        "Variance based sensitivity analysis of model output", Computer Physics Communications 181
        (2010).
        """
        count = len(self.inputs)
        both = _sobol(block, 2 * count, self.root)
        a, b = both[:count], both[count:]
        if at == self.block - 1:
            return b
        point = a.copy()
        if 1 <= at <= count:
            point[at - 1] = b[at - 1]
        return point

    def _cell(self, at: int) -> dict[Input, Value]:
        """Return the values of a cell of the grid; the last key changes fastest."""
        cell: dict[Input, Value] = {}
        for one in reversed(self._swept):
            at, level = divmod(at, len(one.distribution.values))
            cell[one] = one.distribution.values[level]
        return cell

    @cached_property
    def _alone(self) -> list[tuple[Input, list[Value]]]:
        """Each input with its levels other than the nominal value, which has a run of its own."""
        return [
            (one, [level for level in one.distribution.levels if level != one.distribution.nominal])
            for one in self.inputs
        ]

    def _one_at_a_time(self, at: int) -> dict[Input, Value]:
        point = {one: one.distribution.nominal for one in self.inputs}
        at -= 1  # the first of a block is nominal
        for one, levels in self._alone:
            if 0 <= at < len(levels):
                point[one] = levels[at]
            at -= len(levels)
        return point


def check(design: str, inputs: Sequence[Input], factor: Floats, runs: int) -> None:
    """Refuse what a design cannot do.

    Raises
    ------
    CampaignError
    """
    if design not in DESIGNS:
        raise CampaignError(f"design {design!r}: there are {', '.join(DESIGNS)}")
    if not inputs and design not in ("random", "sobol"):
        raise CampaignError(f"design {design}: nothing is varied")
    if design == "grid" and not any(one.distribution.kind == "list" for one in inputs):
        raise CampaignError("design grid: no key has a list(…) or steps(…)")
    is_correlated = not np.array_equal(factor, np.eye(len(factor)))
    if design in ("saltelli", "one-at-a-time") and is_correlated:
        raise CampaignError(f"design {design}: is for inputs that are not correlated")
    if design == "saltelli" and 2 * len(inputs) > _MOST_SOBOL:
        raise CampaignError(f"design saltelli: {len(inputs)} inputs, {_MOST_SOBOL // 2} at most")
    block = Plan(design, tuple(inputs), factor, runs, 0).block
    if design in ("saltelli", "grid", "one-at-a-time") and runs % block:
        raise CampaignError(
            f"runs: {runs}; design {design} takes a multiple of {block} here, "
            f"such as {max(1, round(runs / block)) * block}"
        )


_MOST_SOBOL = 21_201  # of SciPy


@lru_cache(maxsize=2)
def _hypercube(runs: int, count: int, root: int) -> Floats:
    from scipy.stats import qmc

    generator = np.random.default_rng(np.random.SeedSequence(root, spawn_key=(_SEQUENCE,)))
    cube: Floats = qmc.LatinHypercube(count, rng=generator).random(runs)
    return cube


_BATCH = 256


def _sobol(index: int, count: int, root: int) -> Floats:
    """Return a point of a scrambled Sobol sequence."""
    return _sobol_batch(index // _BATCH, count, root)[index % _BATCH]


@lru_cache(maxsize=8)
def _sobol_batch(batch: int, count: int, root: int) -> Floats:
    from scipy.stats import qmc

    generator = np.random.default_rng(np.random.SeedSequence(root, spawn_key=(_SEQUENCE,)))
    sequence = qmc.Sobol(count, scramble=True, rng=generator)
    if batch:
        sequence.fast_forward(batch * _BATCH)
    points: Floats = sequence.random(_BATCH)
    return points
