"""Sensitivity, comparison and report of campaigns whose rows come of known formulas."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest

from rrins.host_tools.campaigns import report
from rrins.host_tools.campaigns.comparison import compare
from rrins.host_tools.campaigns.definition import Wishes, load
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.pictures import draw_shares
from rrins.host_tools.campaigns.row import SERIES, TIMES
from rrins.host_tools.campaigns.sensitivity import NOISE, REST, Share, linear_shares, sobol_indices
from rrins.host_tools.campaigns.statistics import Estimate
from rrins.host_tools.campaigns.store import Store

VARY = {"gyros.bias_dph": "normal(0, 1)", "site.height_m": "uniform(0, 12)"}


def filled(folder, outputs, **wishes):
    """Return a campaign whose outputs are functions of a run's point and its noise."""
    definition = load(
        "rimu_rotating", Wishes(**{"runs": 400, "vary": VARY, "duration_s": 60, **wishes})
    )
    store = Store.create(folder, definition)
    rows = []
    for run in range(definition.runs):
        point = {one.column: value for one, value in definition.plan.point(run).items()}
        seed = definition.plan.seed(run)
        noise = np.random.default_rng(seed).standard_normal(2)
        row = {"run": run, "seed": seed, "status": "ok", "wall_s": 0.1, **point}
        row |= {name: float(value) for name, value in outputs(point, noise).items()}
        row |= {name: np.linspace(0, row.get("position_east_m", 0), TIMES) for name in SERIES}
        rows.append(row)
    store.write(rows)
    return store


def position(point, noise):
    """East: biases of sensors 1 and 2 have 4 + 4 of 12, the height 3, noise 1."""
    east = 2 * point["gyros.bias_dph.1"] + 2 * point["gyros.bias_dph.2"]
    east += 0.5 * point["site.height_m"] + noise[0]
    return {
        "position_east_m": east,
        "position_north_m": noise[1],
        "horizontal_error_m": np.hypot(east, noise[1]),
    }


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return filled(tmp_path_factory.mktemp("c"), position)


def test_linear_shares_are_those_of_the_formula(store):
    found = linear_shares(store, "position_east_m")
    truth = {"gyros.bias_dph": 8 / 12, "site.height_m": 3 / 12, REST: 1 / 12}
    assert [one.name for one in found] == list(truth)
    for one in found:
        assert one.share.low <= truth[one.name] <= one.share.high
        assert one.sigma == pytest.approx(np.sqrt(12 * truth[one.name]), rel=0.1)
    assert sum(one.share.value for one in found) == pytest.approx(1)
    assert linear_shares(store, "position_north_m")[-1].share.value > 0.95


def test_sobols_indices_are_those_of_the_formula_with_the_noise_as_an_input(tmp_path):
    """x y + n of standard normal x, y, n: first 0, 0, 1/2, total 1/2 each."""

    def product(point, noise):
        return {
            "horizontal_error_m": point["gyros.bias_dph.1"] * point["gyros.bias_dph.2"] + noise[0]
        }

    vary = {"gyros.bias_dph.1": "normal(0, 1)", "gyros.bias_dph.2": "normal(0, 1)"}
    store = filled(tmp_path, product, design="saltelli", runs=5 * 1024, vary=vary)
    found = {one.name: one for one in sobol_indices(store, "horizontal_error_m")}
    for name, first in (("gyros.bias_dph.1", 0), ("gyros.bias_dph.2", 0), (NOISE, 0.5)):
        assert found[name].first.value == pytest.approx(first, abs=0.08)
        assert found[name].total.value == pytest.approx(0.5, abs=0.08)


def test_sobols_indices_need_their_design(store):
    with pytest.raises(CampaignError, match="saltelli"):
        sobol_indices(store, "horizontal_error_m")


def test_campaigns_of_one_seed_are_compared_in_pairs(store, tmp_path):
    def larger(point, noise):
        return {name: 1.02 * value for name, value in position(point, noise).items()}

    other = filled(tmp_path / "larger", larger)
    found = compare(store, other, "horizontal_error_m")
    assert found.is_paired
    assert found.ratio["p95"].value == pytest.approx(1.02)
    assert found.p_value < 1e-6
    assert compare(store, store, "horizontal_error_m").p_value == 1
    apart = compare(store, filled(tmp_path / "apart", position, seed=2), "horizontal_error_m")
    assert not apart.is_paired
    assert apart.p_value > 0.01
    assert apart.ratio["p50"].low < 1 < apart.ratio["p50"].high


@pytest.mark.pictures
def test_the_report_is_one_page_with_its_pictures_inside(store):
    paths = report.write(store)
    text = paths[0].read_text()
    names = {path.stem for path in paths[1:]}
    assert names == {"over_time", "distribution", "ends", "shares", "covariance", "inputs"}
    assert text.count('src="data:image/png;base64,') == len(names)
    assert not re.search(r'(src|href)="(?!data:)', text)
    errors = store.values("horizontal_error_m")
    worst = max(errors, key=errors.get)
    assert f"rerun {worst}</code>" in text
    assert "normal(0, 1)" in text
    # Of runs that are a formula the analysis knows nothing; of height as an input neither.
    assert "the analysis does NOT lie in the intervals of the 400 runs" in text
    assert "not considered: site height (varied)" in text
    assert "<td>gyro bias / (°/h)<br><small><code>gyros.bias_dph</code></small></td>" in text
    assert "<td>position error, east / m<br>" in text


def test_names_and_intervals_of_what_matters_are_not_clipped():
    long = "accelerometers.random_walk_ug_per_sqrt_h"
    shares = [Share(name, Estimate(0.9, 0.7, 1.2), 1.0) for name in (long, "gyros.bias_dph", REST)]
    figure = draw_shares({"position_east_m": shares, "position_north_m": shares})
    figure.canvas.draw()
    for axes in figure.axes:
        low, high = axes.get_xlim()
        assert low <= 0.0
        assert high > 1.2
        boxes = [label.get_window_extent() for label in axes.get_yticklabels()]
        assert all(box.x0 >= 0 for box in boxes)
        assert all(above.y0 >= below.y1 for above, below in itertools.pairwise(boxes))
        assert "_" not in "".join(label.get_text() for label in axes.get_yticklabels())
