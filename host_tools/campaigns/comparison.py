"""Two campaigns side by side, and whether their difference is more than chance.

Runs of one number and one seed have the same noise in both: then their differences are tested, by
Wilcoxon's signed ranks; else the two samples, by Mann and Whitney. Of designs by blocks the tests
see the mean of each block.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.row import OK
from rrins.host_tools.campaigns.statistics import Estimate, Integers, resampled
from rrins.host_tools.campaigns.store import Store
from rrins.host_tools.campaigns.summary import Outcomes
from rrins.host_tools.files import JsonObject

_FEWEST = 8


@dataclass(frozen=True)
class Comparison:
    """An output of two campaigns.

    Attributes
    ----------
    first, second : dict of str to Estimate
        Median and 95th percentile (``p50``, ``p95``) of each.
    """

    output: str
    first: dict[str, Estimate]
    second: dict[str, Estimate]
    ratio: dict[str, Estimate]  #: second over first
    p_value: float  #: of the test that both come of one distribution
    is_paired: bool
    runs: tuple[int, int]

    def values(self) -> JsonObject:
        """Return it as plain values."""
        return asdict(self)


def compare(first: Store, second: Store, output: str) -> Comparison:
    """Return how an output differs from one campaign to the other.

    Raises
    ------
    CampaignError
        When one has too few runs.
    """
    from scipy.stats import mannwhitneyu, wilcoxon

    ours, theirs = _by_run(first, output), _by_run(second, output)
    for store, values in ((first, ours), (second, theirs)):
        if len(values) < _FEWEST:
            raise CampaignError(f"{store.folder}: {len(values)} runs with {output} are too few")
    common = [run for run in ours if run in theirs and ours[run][0] == theirs[run][0]]
    is_paired = len(common) == len(ours) == len(theirs)
    if is_paired:
        ours, theirs = ({run: one[run] for run in common} for one in (ours, theirs))
    a, b = (np.array([value for _, value in one.values()]) for one in (ours, theirs))
    blocks = [
        np.array(list(one)) // store.definition.plan.block
        for store, one in ((first, ours), (second, theirs))
    ]
    x, y = (_means(values, of) for values, of in zip((a, b), blocks, strict=True))
    if is_paired:
        p_value = 1.0 if np.array_equal(x, y) else float(wilcoxon(x, y).pvalue)
    else:
        p_value = float(mannwhitneyu(x, y).pvalue)
    percents = {"p50": 50.0, "p95": 95.0}
    first_of, second_of = (Outcomes(one, [output]).sample(output) for one in (first, second))
    return Comparison(
        output,
        {name: first_of.percentile(percent) for name, percent in percents.items()},
        {name: second_of.percentile(percent) for name, percent in percents.items()},
        {name: _ratio(a, b, percent, blocks, is_paired) for name, percent in percents.items()},
        p_value,
        is_paired,
        (len(a), len(b)),
    )


def _means(values: Floats, blocks: Integers) -> Floats:
    """Return the mean of each block."""
    at = np.unique(blocks, return_inverse=True)[1]
    return np.asarray(np.bincount(at, values) / np.bincount(at))


def _by_run(store: Store, output: str) -> dict[int, tuple[int, float]]:
    """Return seed and value of the runs that came to their end, by number."""
    table = store.table(["seed", "status", output]).to_pylist()
    return {
        row["run"]: (row["seed"], row[output])
        for row in table
        if row["status"] == OK and row[output] is not None
    }


def _ratio(
    a: Floats, b: Floats, percent: float, blocks: list[Integers], is_paired: bool
) -> Estimate:
    """Return the ratio of a percentile, second over first."""

    def ratio(a: Floats, b: Floats) -> float:
        first, second = (np.percentile(one, percent, method="inverted_cdf") for one in (a, b))
        return float(np.divide(second, first))

    return resampled(ratio, a, b, blocks=blocks, is_paired=is_paired)
