from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest

from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.statistics import (
    mean,
    percentile,
    proportion,
    sigma,
    weighted_proportion,
)
from rrins.host_tools.campaigns.until import Until


def test_the_interval_of_a_percentile_is_that_of_resampling():
    values = np.random.default_rng(1).rayleigh(size=300)
    found = percentile(values, 95)
    resamples = np.random.default_rng(2).choice(values, (20_000, 300))
    order = np.sort(resamples, axis=1)[:, 284]
    low, high = np.percentile(order, (2.5, 97.5), method="inverted_cdf")
    assert (found.low, found.high) == pytest.approx((low, high), rel=0.02)
    assert found.value == np.sort(values)[284]


@pytest.mark.parametrize(
    ("figure", "truth"),
    [
        (lambda v: percentile(v, 50), np.sqrt(2 * np.log(2))),
        (lambda v: percentile(v, 95), np.sqrt(2 * np.log(20))),
        (mean, np.sqrt(np.pi / 2)),
        (sigma, np.sqrt(2 - np.pi / 2)),
    ],
)
def test_intervals_have_the_truth_as_often_as_they_promise(figure, truth):
    found = [figure(np.random.default_rng(k).rayleigh(size=200)) for k in range(60)]
    inside = sum(one.low <= truth <= one.high for one in found)
    assert 51 <= inside <= 60


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


def test_too_few_runs_have_no_interval():
    assert percentile(np.arange(20.0), 95).half_width == np.inf
    assert np.isnan(percentile(np.zeros(0), 50).value)
    assert percentile(np.arange(20.0), 95).values()["high"] is None


@pytest.mark.parametrize(
    ("words", "factor"),
    [
        ("p95 of horizontal_error_m within 10 %", 1.0),
        ("median of horizontal_error_m within 8 %", 1.0),
        ("mean of horizontal_error_m within 7 %", 1.2),
        ("sigma of horizontal_error_m within 8 %", 1.2),
    ],
)
def test_it_stops_with_little_more_than_the_fewest_runs(words, factor):
    criterion = Until.parse(words)
    for seed in range(3):
        values = np.random.default_rng(seed).rayleigh(size=2000)
        fewest = next(n for n in range(50, 2000) if criterion.holds(values[:n]))
        stopped = next(
            n for n in range(50, 2000) if criterion.is_due(n) and criterion.holds(values[:n])
        )
        assert fewest <= stopped <= factor * fewest


@pytest.mark.parametrize("text", ["cep within 5 m%", "p95 of height within 3", "p0 of x within 1"])
def test_a_sentence_that_is_none_is_refused(text):
    with pytest.raises(CampaignError, match="until"):
        Until.parse(text)


def test_short_words():
    assert Until.parse("r95 within 5 %").column == "horizontal_error_m"
    assert Until.parse("median of height_error_m within 2.5").limit == 2.5
