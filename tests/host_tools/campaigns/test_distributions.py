from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from rrins.host_tools.campaigns.distributions import parse, with_values
from rrins.host_tools.campaigns.errors import CampaignError

LAWS = {
    "normal(2, 0.5)": stats.norm(2, 0.5),
    "uniform(-1, 3)": stats.uniform(-1, 4),
    "loguniform(2, 50)": stats.loguniform(2, 50),
    "lognormal(0.5, 0.7)": stats.lognorm(0.7, scale=0.5),
    "truncated(1, 2, 0, 4)": stats.truncnorm(-0.5, 1.5, loc=1, scale=2),
}


@pytest.mark.parametrize("text", LAWS)
def test_quantiles_and_moments_are_those_of_the_law(text):
    found, law = parse("key", text), LAWS[text]
    at = np.linspace(0.01, 0.99, 33)
    assert [found.quantile(p) for p in at] == pytest.approx(list(law.ppf(at)), abs=1e-9)
    assert found.moments == pytest.approx((law.mean(), law.std()))


def test_a_list_is_equally_likely_and_keeps_its_kinds():
    found = parse("key", "list(16-position, 8-position, 3, 2.5, true)")
    assert [found.quantile((k + 0.5) / 5) for k in range(5)] == list(found.values)
    assert found.values == ("16-position", "8-position", 3, 2.5, True)
    assert parse("key", "steps(0, 10, 5)").values == (0, 2.5, 5, 7.5, 10)


def test_measured_values_come_of_a_column(tmp_path):
    sheet = tmp_path / "batch.csv"
    values = np.random.default_rng(1).normal(3, 2, 200)
    lines = [f"{k},{value!r}" for k, value in enumerate(values.tolist())]
    sheet.write_text("\n".join(["serial, bias_dph", *lines, "201,"]))
    text = with_values("key", "empirical(batch.csv, bias_dph) correlated 0.5", tmp_path)
    found = parse("key", text)
    assert found.correlation == 0.5
    assert found.quantile(0.3) == pytest.approx(np.quantile(values, 0.3))
    assert found.moments == pytest.approx((values.mean(), values.std(ddof=1)))
    assert found.levels == pytest.approx(np.quantile(values, stats.norm.cdf([-1, 1])))
    assert parse("key", found.text()) == found
    for wrong, why in (("batch.csv", "serial, bias"), ("none.csv, x", "cannot be read")):
        with pytest.raises(CampaignError, match=why):
            with_values("key", f"empirical({wrong})", tmp_path)
    sheet.write_text("bias\n1\nx\n")
    with pytest.raises(CampaignError, match="'x' in empirical"):
        with_values("key", "empirical(batch.csv)", tmp_path)


@pytest.mark.parametrize(
    "text", ["normal(0, 0.1)", "uniform(1, 2) common", "list(1, a) correlated 0.5"]
)
def test_its_text_says_the_same(text):
    assert parse("key", parse("key", text).text()) == parse("key", text)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("gauss(0, 1)", "not a distribution"),
        ("0.5", "not a distribution"),
        ("normal(0)", "takes 2"),
        ("normal(0, -1)", "above 0"),
        ("normal(0, x)", "not a number"),
        ("uniform(2, 1)", "below"),
        ("truncated(0, 1, 50, 60)", "nothing"),
        ("loguniform(0, 1)", "above 0"),
        ("lognormal(0, 1)", "above 0"),
        ("lognormal(1, 0)", "above 0"),
        ("empirical(1)", "2 to"),
        ("empirical(1, x)", "not a number"),
        ("list()", "empty"),
        ("steps(0, 1, 1)", "whole number"),
        ("normal(0, 1) correlated 1.5", "-1 < ρ < 1"),
    ],
)
def test_what_is_none_is_refused(text, why):
    with pytest.raises(CampaignError, match=why) as refused:
        parse("gyros.bias_dph", text)
    assert "gyros.bias_dph" in str(refused.value)
