"""Figures of runs and their intervals: ranks, and how often the truth lies inside."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom, binomtest

from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.statistics import (
    Sample,
    fewest_runs,
    figure_of,
    proportion,
    weighted_proportion,
)
from rrins.host_tools.campaigns.tail import far_percentile
from rrins.host_tools.campaigns.until import FEWEST, Until

RAYLEIGH = {
    "p50": np.sqrt(2 * np.log(2)),
    "p95": np.sqrt(2 * np.log(20)),
    "mean": np.sqrt(np.pi / 2),
    "sigma": np.sqrt(2 - np.pi / 2),
}
"""Truths of the horizontal error whose east and north are standard normal."""


def coverage(figure, truth, samples):
    """Return how often the intervals of a figure have the truth, of 1."""
    found = [figure_of(figure)(sample) for sample in samples]
    return np.mean([one.low <= truth <= one.high for one in found])


def rayleigh(runs, times, blocks=1, seed=1):
    """Samples of runs; those of a block have most of their error in common."""
    rng = np.random.default_rng(seed)
    numbers = np.arange(runs) // blocks
    for _ in range(times):
        common = rng.standard_normal((2, runs // blocks))[:, numbers] * np.sqrt(0.8)
        own = rng.standard_normal((2, runs)) * np.sqrt(0.2)
        yield Sample(np.hypot(*(common + own)), None if blocks == 1 else numbers)


def ended(text, seed, last=4000):
    """Return the values with which a criterion ends a campaign."""
    until = Until.parse(text)
    values = np.random.default_rng([7, seed]).rayleigh(size=last)
    looks = (n for n in range(FEWEST, last) if until.is_due(n))
    return until.estimate(values[: next(n for n in looks if until.holds(values[:n]))])


@pytest.mark.parametrize("percent", [5, 50, 95])
@pytest.mark.parametrize("runs", [72, 80, 100, 400, 2000])
def test_each_end_of_a_percentiles_interval_lies_between_two_ranks(runs, percent):
    """The binomial probability of either rank's miss is on either side of 2.5 %."""
    found = Sample(np.arange(1.0, runs + 1)).percentile(percent)
    low, high = found.low, runs + 1 - found.high
    for place, share in ((low, percent / 100), (high, 1 - percent / 100)):
        lower, upper = (binom.cdf(np.floor(place) + k - 1, runs, share) for k in (0, 1))
        assert lower <= 0.025 <= upper


def test_a_bound_is_wilks_smallest_rank():
    for runs, rank in ((59, 59), (92, 92), (93, 92), (100, 99), (1000, 962)):
        assert Sample(np.arange(1.0, runs + 1)).bound(95) == rank
    assert Sample(np.arange(58.0)).bound(95) == np.inf
    assert [fewest_runs(percent, 0.05) for percent in (95, 99)] == [59, 299]


def test_too_few_runs_have_no_upper_end_and_the_other_one_stands():
    found = Sample(np.arange(71.0)).percentile(95)
    assert np.isfinite(found.low)
    assert found.values()["high"] is None
    assert np.isfinite(Sample(np.arange(float(fewest_runs(95)))).percentile(95).half_width)
    assert np.isnan(Sample(np.zeros(0)).percentile(50).value)
    assert np.isnan(Sample(np.full(3, np.nan)).mean().value)


@pytest.mark.parametrize(("runs", "figure"), [(100, "p95"), (100, "p50"), (80, "p95")])
def test_intervals_have_the_truth_as_often_as_they_promise(runs, figure):
    assert 0.93 <= coverage(figure, RAYLEIGH[figure], rayleigh(runs, 1000)) <= 0.97


@pytest.mark.soak
@pytest.mark.parametrize("blocks", [1, 5, 10])
@pytest.mark.parametrize("figure", RAYLEIGH)
@pytest.mark.parametrize("units", [80, 100, 400, 2000])
def test_intervals_have_the_truth_in_95_percent(units, figure, blocks):
    samples = rayleigh(units * blocks, 4000 if units * blocks < 4000 else 1000, blocks)
    found = coverage(figure, RAYLEIGH[figure], samples)
    print(f"\n{figure} of {units} runs or blocks of {blocks}: {found:.1%}")
    assert found == pytest.approx(0.95, abs=0.0151)


@pytest.mark.parametrize("figure", ["p50", "p95", "mean", "sigma"])
def test_runs_of_a_block_count_as_less_than_as_many(figure):
    blocks, runs, truth = 10, 1000, RAYLEIGH[figure]
    assert coverage(figure, truth, rayleigh(runs, 200, blocks)) > 0.9
    blind = [Sample(one.values) for one in rayleigh(runs, 200, blocks)]
    assert coverage(figure, truth, blind) < 0.75


def test_few_blocks_have_no_upper_end():
    assert next(rayleigh(700, 1, 10)).percentile(95).high == np.inf
    assert next(rayleigh(700, 1, 10)).bound(95) < np.inf
    assert next(rayleigh(40, 1, 10)).mean().half_width == np.inf


@pytest.mark.parametrize(
    "words", ["p95 of horizontal_error_m within 20 %", "median of horizontal_error_m within 15 %"]
)
def test_a_campaign_that_a_criterion_ends_has_the_truth_as_often(words):
    truth = RAYLEIGH["p95" if "p95" in words else "p50"]
    found = [ended(words, seed) for seed in range(300)]
    assert np.mean([one.low <= truth <= one.high for one in found]) > 0.93


@pytest.mark.soak
@pytest.mark.parametrize("figure", RAYLEIGH)
@pytest.mark.parametrize("percent", [5, 10, 20])
def test_criteria_keep_95_percent(figure, percent):
    words = f"{figure} of horizontal_error_m within {percent} %"
    found = [ended(words, seed) for seed in range(500 if percent == 5 else 2000)]
    share = np.mean([one.low <= RAYLEIGH[figure] <= one.high for one in found])
    print(f"\n{words}: {share:.1%}")
    assert 0.93 <= share <= 0.98


def test_a_criterion_is_looked_at_with_whole_blocks():
    until = Until.parse("p95 of horizontal_error_m within 10 %")
    looks = [n for n in range(400) if until.is_due(n, 13)]
    assert looks[:4] == [52, 65, 78, 91]
    assert all(n % 13 == 0 for n in looks)
    singly = [n for n in range(400) if until.is_due(n)]
    assert len(singly) < 25
    one = np.random.default_rng(1).rayleigh(size=1000)
    assert until.holds(one)
    assert not until.holds(np.repeat(one[:100], 10), 10)


@pytest.mark.parametrize(("hits", "of"), [(0, 300), (3, 300), (7, 10), (10, 10)])
def test_the_interval_of_a_share_is_that_of_clopper_and_pearson(hits, of):
    found = proportion(hits, of)
    exact = binomtest(hits, of).proportion_ci(0.95, "exact")
    assert (found.value, found.low, found.high) == pytest.approx((hits / of, exact.low, exact.high))
    if not hits:
        assert found.high == pytest.approx(1 - 0.025 ** (1 / of))
    assert np.isnan(proportion(0, 0).value)


def test_a_share_over_strata_is_weighted():
    hits, of, weights = np.array([[2.0, 8.0, 0.0], [10.0, 10.0, 0.0], [1.0, 1.0, 5.0]])
    assert weighted_proportion(hits, of, weights) == proportion(10, 20)
    assert weighted_proportion(hits, of, np.array([3.0, 1.0, 1.0])).value == pytest.approx(0.35)
    few = weighted_proportion(hits, of, np.array([1.0, 1e-9, 0.0]))
    assert few.high == pytest.approx(proportion(2, 10).high)


@pytest.mark.parametrize("text", ["cep within 5 m%", "p95 of height within 3", "p0 of x within 1"])
def test_a_sentence_that_is_none_is_refused(text):
    with pytest.raises(CampaignError, match="until"):
        Until.parse(text)


def test_short_words():
    assert Until.parse("r95 within 5 %").column == "horizontal_error_m"
    assert Until.parse("median of height_error_m within 2.5").limit == 2.5


@pytest.mark.parametrize("scale", [1e-3, 1, 1e4])
def test_a_far_percentile_goes_on_as_the_tail_begins(scale):
    """Of exact quantiles of the exponential distribution: its tail has its own shape."""
    values = -scale * np.log(1 - (np.arange(2000) + 0.5) / 2000)
    found = far_percentile(values, 99.9)
    assert found.value == pytest.approx(scale * np.log(1000), rel=0.02)
    assert found.low < found.value < found.high < 1.5 * found.value
    assert found.high - found.value > found.value - found.low


@pytest.mark.parametrize("percent", [90.5, 95, 99.9, 99.999])
@pytest.mark.parametrize("shape", [-0.4, 0.5])
def test_a_far_percentile_is_found_near_and_far(shape, percent):
    """Of many exact quantiles of the distribution that is fitted."""
    values = ((1 - (np.arange(50_000) + 0.5) / 50_000) ** -shape - 1) / shape
    truth = ((1 - percent / 100) ** -shape - 1) / shape
    assert far_percentile(values, percent).value == pytest.approx(truth, rel=0.03)


def test_a_tail_has_percentiles_beyond_its_threshold():
    for percent in (50, 90, 100, np.nan):
        with pytest.raises(CampaignError, match="between 90 and 100"):
            far_percentile(np.arange(500.0), percent)


def test_a_tail_takes_400_runs_that_differ():
    assert np.isnan(far_percentile(np.arange(399.0), 99.9).value)
    assert np.isnan(far_percentile(np.ones(500), 99.9).value)
    assert far_percentile(np.r_[np.arange(400.0), np.nan], 99.9).value < 500


TAILS = {
    "rayleigh": lambda rng, runs: np.hypot(*rng.standard_normal((2, runs))),
    "ellipse": lambda rng, runs: np.hypot(*(rng.standard_normal((2, runs)).T * (1, 0.3)).T),
    "lognormal": lambda rng, runs: rng.lognormal(0, 0.5, runs),
}


@pytest.mark.soak
@pytest.mark.parametrize("name", TAILS)
@pytest.mark.parametrize("runs", [400, 4000])
def test_a_tail_has_the_truth_in_95_percent(name, runs):
    rng, draw = np.random.default_rng(2), TAILS[name]
    truth = np.quantile(draw(np.random.default_rng(3), 20_000_000), 0.999)
    found = [far_percentile(draw(rng, runs), 99.9) for _ in range(1000)]
    assert np.mean([one.low <= truth <= one.high for one in found]) > 0.945
