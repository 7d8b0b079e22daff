"""Rows, distributions and how numbers are shown."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.host_tools.experiments.constants import ConstantSet
from rrins.host_tools.experiments.figures import draw_bands
from rrins.host_tools.experiments.sections import BAND_SEEDS, Distribution, FigureRow
from rrins.host_tools.rounding import rounded
from rrins.host_tools.scenario.scenario import load


@pytest.mark.parametrize(
    ("paper", "ours", "ratio", "differs"),
    [
        (2.0, 4.0, 2.0, False),
        (2.0, 4.1, 2.05, True),
        (2.0, 1.0, 0.5, False),
        (2.0, 0.9, 0.45, True),
        (None, 1.0, None, False),
        (0.0, 1.0, None, False),
        (2.0, None, None, False),
    ],
)
def test_a_row_differs_beyond_a_factor_of_two(paper, ours, ratio, differs):
    row = FigureRow("static", "a", "b", "m", paper, ours)
    assert row.ratio == (None if ratio is None else pytest.approx(ratio))
    assert row.differs == differs


def test_percentiles_of_a_hundred_seeds():
    one = Distribution.of(np.arange(1, 102), 97.5)
    assert (one.median, one.quantile(5), one.quantile(95)) == (51, 6, 96)
    assert one.spread == (6, 96)
    assert one.below == 97
    assert not one.holds
    assert Distribution.of(np.arange(1, 102), 95.5).holds
    assert one.words() == (
        "median; the 5-95 % band of 101 seeds: 6.0 to 96.0; the paper's figure lies above, 1.02 "
        "times the upper limit; 97 of 101 below it"
    )


def test_few_seeds_have_a_range_and_no_percentiles():
    few = Distribution.of(np.arange(1, BAND_SEEDS), 1.0)
    assert few.spread == (1, BAND_SEEDS - 1)
    assert few.holds
    assert few.spread_words == f"the range of {BAND_SEEDS - 1} seeds"
    assert "%" not in few.words()
    enough = Distribution.of(np.arange(1, BAND_SEEDS + 1), 1.0)
    assert enough.spread == (pytest.approx(1.95), pytest.approx(19.05))
    assert not enough.holds
    assert f"the 5-95 % band of {BAND_SEEDS} seeds" in enough.words()
    assert "the range of 1 seed:" in Distribution.of([2.0], 3.0).words()


@given(st.lists(st.floats(1e-3, 1e6), min_size=1, max_size=30), st.floats(1e-3, 1e6))
def test_the_count_is_of_those_below(values, paper):
    one = Distribution.of(values, paper)
    assert one.below == sum(v < paper for v in values)
    assert one.quantile(0) == min(values)
    assert one.quantile(100) == max(values)


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (None, "–"), (0.0, "0"), (0.0051, "0.00510"), (8.1849, "8.18"), (999.4, "999"),
        (14618.2, "14,600"), (192000, "192,000"), (1.2345e-12, "1.23e-12"), (-287.4, "-287"),
        (3.21e8, "3.21e+08"),
    ],
)  # fmt: skip
def test_numbers_are_shown_with_three_digits(value, shown):
    assert rounded(value) == shown


# Sets of constants


def test_a_set_draws_each_sensors_constants_from_its_spread():
    scenario = load("experiment_strapdown")
    constants = ConstantSet(50.0, 10.0)
    drawn = [constants.drawn(scenario, seed) for seed in range(300)]
    for kind, share in (("gyros", 1.0), ("accelerometers", 0.6)):
        for key, spread in (
            ("scale_error_ppm", 50 * share),
            ("asymmetric_scale_error_ppm", 50 * share),
            ("installation_u_arcsec", 10),
            ("installation_v_arcsec", 10),
        ):
            values = np.array([getattr(getattr(one, kind), key) for one in drawn])
            assert values.shape == (300, 4)
            assert values.std(axis=0) == pytest.approx(spread, rel=0.2)
            assert np.abs(values.mean(axis=0)).max() < 4 * spread / np.sqrt(300)
    assert drawn[3].seed == 3
    assert drawn[3].gyros.bias_repeatability_dph == scenario.gyros.bias_repeatability_dph
    assert drawn[3].gyros.scale_repeatability_ppm == 0


def test_larger_biases_are_larger_by_their_factor():
    scenario = load("experiment_rotating")
    larger = ConstantSet(50.0, 10.0, biases=8.0).drawn(scenario, 1)
    for kind, unit in (("gyros", "dph"), ("accelerometers", "ug")):
        for what in ("repeatability", "instability"):
            before = getattr(getattr(scenario, kind), f"bias_{what}_{unit}")
            after = getattr(getattr(larger, kind), f"bias_{what}_{unit}")
            assert after == pytest.approx(tuple(8 * value for value in before))
    assert "biases × 8" in ConstantSet(50.0, 10.0, biases=8.0).words


@pytest.mark.parametrize("most", [1e3, 1e6])
def test_a_picture_of_spreads_says_what_it_shows_and_its_numbers_do_not_overlap(most):
    spread = Distribution.of([100.0, 300.0, most], 200.0)
    drawn = draw_bands({"a": (spread, spread)}, ("error east / m", "error north / m"), "Errors")
    drawn.draw_without_rendering()
    assert drawn.get_suptitle().startswith("Errors\nbar: ")
    for axes, side in zip(drawn.axes, ("east", "north"), strict=True):
        assert axes.get_xlabel() == f"error {side} / m"
        low, high = axes.get_xlim()
        texts = [text for text in axes.get_xticklabels(which="both") if text.get_text()]
        boxes = [t.get_window_extent() for t in texts if low <= t.get_position()[0] <= high]
        boxes.sort(key=lambda box: box.x0)
        assert len(boxes) >= 2
        assert all(left.x1 < right.x0 for left, right in pairwise(boxes))
        assert not [text for text in texts if "10^" in text.get_text()]
