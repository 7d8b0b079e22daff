"""Two campaigns side by side, and whether their difference is more than chance.

Runs of one number and one seed have the same noise in both: then their differences are tested, by
Wilcoxon's signed ranks; else the two samples, by Mann and Whitney.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.row import OK
from rrins.host_tools.campaigns.statistics import Estimate, percentile, resampled
from rrins.host_tools.campaigns.store import Store
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
    a, b = (np.array([value for _, value in one.values()]) for one in (ours, theirs))
    for store, values in ((first, a), (second, b)):
        if len(values) < _FEWEST:
            raise CampaignError(f"{store.folder}: {len(values)} runs with {output} are too few")
    common = [run for run in ours if run in theirs and ours[run][0] == theirs[run][0]]
    is_paired = len(common) == len(a) == len(b)
    if is_paired:
        a, b = (np.array([one[run][1] for run in common]) for one in (ours, theirs))
        p_value = 1.0 if np.array_equal(a, b) else float(wilcoxon(a, b).pvalue)
    else:
        p_value = float(mannwhitneyu(a, b).pvalue)
    percents = {"p50": 50.0, "p95": 95.0}
    return Comparison(
        output,
        {name: percentile(a, percent) for name, percent in percents.items()},
        {name: percentile(b, percent) for name, percent in percents.items()},
        {name: _ratio(a, b, percent, is_paired) for name, percent in percents.items()},
        p_value,
        is_paired,
        (len(a), len(b)),
    )


def _by_run(store: Store, output: str) -> dict[int, tuple[int, float]]:
    """Return seed and value of the runs that came to their end, by number."""
    table = store.table(["seed", "status", output]).to_pylist()
    return {
        row["run"]: (row["seed"], row[output])
        for row in table
        if row["status"] == OK and row[output] is not None
    }


def _ratio(a: Floats, b: Floats, percent: float, is_paired: bool) -> Estimate:
    """Return the ratio of a percentile, second over first."""

    def ratio(a: Floats, b: Floats, axis: int) -> Floats:
        first, second = (
            np.percentile(one, percent, method="inverted_cdf", axis=axis) for one in (a, b)
        )
        return np.divide(second, first)

    return resampled(ratio, a, b, is_paired=is_paired)
