"""Tolerances at least cost: against closed forms, the optimum's own condition, and runs."""

from __future__ import annotations

import csv
import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.least_cost import allocate
from rrins.host_tools.cli.main import rrins
from rrins.host_tools.covariance.radius import percentile_m

WALK, BIAS = "gyros.angle_random_walk_deg_per_sqrt_h", "accelerometers.bias_ug"
FILE = """
scenario = "ideal"
duration_s = 150
set = {{ rate_hz = 50 }}
[allocate]
require = "p95 of horizontal_error_m <= {limit}"
[[allocate.tolerances]]
key = "gyros.angle_random_walk_deg_per_sqrt_h"
at = 0.01
cost = 30
power = 2
least = 0.001
most = 0.1
[[allocate.tolerances]]
key = "accelerometers.bias_ug"
at = 100
cost = 10
least = 10
most = 1000
"""


CHOICE = """
[[allocate.choices]]
key = "seed"
values = [1, 2]
costs = [7, 2]
"""  # of which the analysis knows that they make no difference


@pytest.fixture
def write(tmp_path):
    def writer(limit, **replaced):
        path = tmp_path / "budget.toml"
        text = FILE.format(limit=limit)
        for old, new in replaced.items():
            text = text.replace(f'"{old}"', new)
        path.write_text(text)
        return str(path)

    return writer


@pytest.mark.parametrize("share", [0.05, 0.5, 0.95, 0.999])
def test_percentiles_of_a_distance(share):
    round_m = 3.0 * math.sqrt(-2.0 * math.log(1.0 - share))
    turned = np.array([[math.cos(0.7), -math.sin(0.7)], [math.sin(0.7), math.cos(0.7)]])
    assert percentile_m(share, np.zeros(2), 9.0 * np.eye(2)) == pytest.approx(round_m, rel=1e-9)
    line = turned @ np.diag([4.0, 0.0]) @ turned.T
    assert math.erf(percentile_m(share, np.zeros(2), line) / math.sqrt(8.0)) == pytest.approx(share)
    far, small = np.array([300.0, 400.0]), 1e-4 * np.eye(2)
    assert percentile_m(share, far, small) == pytest.approx(500.0, abs=0.1)
    assert percentile_m(share, far, np.zeros((2, 2))) == 500.0


def test_percentiles_of_an_ellipse_off_the_centre_are_those_of_draws():
    covariance, mean = np.array([[9.0, 3.0], [3.0, 2.0]]), np.array([2.0, -1.0])
    draws = np.random.default_rng(1).multivariate_normal(mean, covariance, 200_000)
    inside = np.hypot(*draws.T) <= percentile_m(0.95, mean, covariance)
    assert inside.mean() == pytest.approx(0.95, abs=3 * math.sqrt(0.95 * 0.05 / 200_000))


@pytest.mark.slow
def test_at_least_cost_a_little_more_of_anything_is_worth_the_same(write):
    """The variance that the last unit of cost takes away is alike (Boyd, 5.5.3)."""
    found = allocate(write(10))
    assert found.predicted_m == pytest.approx(10, rel=1e-4)
    worth = {one.key: one.share / one.cost for one in found.chosen}
    assert worth[WALK] / 2 == pytest.approx(worth[BIAS], rel=0.01)
    assert found.cost == pytest.approx(sum(one.cost for one in found.chosen))
    looser = allocate(write(20))
    assert looser.cost < found.cost
    cheap = allocate(write(1e6))
    assert {one.key: one.sigma for one in cheap.chosen} == {WALK: 0.1, BIAS: 1000}
    assert {one.limit for one in cheap.chosen} == {"most"}
    with pytest.raises(CampaignError, match=r"every tolerance at its least the p95 is .* above"):
        allocate(write(0.01))


@pytest.mark.pictures
@pytest.mark.slow
def test_of_choices_that_lead_to_the_same_the_cheaper_is_taken(write, tmp_path):
    alone, path = allocate(write(10)), write(10)
    Path(path).write_text(FILE.format(limit=10) + CHOICE)
    words = ["allocate", path, "--front", str(tmp_path / "front"), "--json"]
    done = CliRunner().invoke(rrins, words)
    told = json.loads(done.stdout)
    assert told["choices"] == {"seed": 2}
    assert told["cost"] == pytest.approx(alone.cost + 2)
    with (tmp_path / "front" / "front.csv").open() as file:
        rows = list(csv.DictReader(file))
    best = [row for row in rows if row["is_best"] == "1"]
    assert {row["seed"] for row in rows} == {"1", "2"}
    assert {row["seed"] for row in best} == {"2"}
    figures = [(float(row["cost"]), float(row["predicted_m"])) for row in best]
    assert figures == sorted(figures)
    assert len(figures) > 5
    for (cost, predicted_m), (dearer, better_m) in itertools.pairwise(figures):
        assert dearer > cost
        assert better_m < predicted_m
    assert [name.rpartition("/")[2] for name in told["files"]] == ["front.csv", "front.png"]


@pytest.mark.slow
def test_runs_confirm_it(write, tmp_path):
    words = ["allocate", write(10), "--confirm", "100", "--out", str(tmp_path / "c"), "--json"]
    done = CliRunner().invoke(rrins, words)
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert told["measured_m"]["low"] < told["predicted_m"] < told["measured_m"]["high"]


def test_choices_alone_will_do():
    table = {"scenario": "ideal", "duration_s": 20, "set": {"sensors": "prototype"}}
    choice = {"key": "firmware.scheme", "values": ["16-position", "8-position"]}
    wanted = {"require": "p95 of horizontal_error_m <= 1e3", "choices": [choice]}
    found = allocate(table | {"allocate": wanted})
    assert found.cost == 0.0
    assert found.choices == {"firmware.scheme": "16-position"}
    wanted["require"] = "p95 of horizontal_error_m <= 1e-6"
    with pytest.raises(CampaignError, match=r"with any choice the p95 is .* above"):
        allocate(table | {"allocate": wanted})
    choice["costs"] = [1]
    with pytest.raises(CampaignError, match=r"choices.1: costs: one for each of the values"):
        allocate(table | {"allocate": wanted})
    with pytest.raises(CampaignError, match="tolerances or choices: there are none"):
        allocate(table | {"allocate": {"require": wanted["require"]}})


@pytest.mark.parametrize(
    ("limit", "replaced", "message"),
    [
        ("ten", {}, "is not a requirement such as"),
        (10, {BIAS: '"gyros.range_dps"'}, "allocate: gyros.range_dps: there are gyros.bias_dph"),
        (10, {BIAS: f'"{WALK}"'}, "allocate: a key stands there twice"),
    ],
)
def test_what_cannot_be_allocated_is_said(write, limit, replaced, message):
    with pytest.raises(CampaignError, match=message):
        allocate(write(limit, **replaced))


def test_a_file_without_a_requirement_is_named():
    with pytest.raises(CampaignError, match=r"rimu_rotating: has no table \[allocate\]"):
        allocate("rimu_rotating")


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"scenario": "drive_aided"}, "without the estimator"),
        (
            {
                "vary": dict.fromkeys(("gyros.bias_dph", "accelerometers.bias_ug"), "normal(0, 1)"),
                "correlate": [
                    {"between": ["gyros.bias_dph", "accelerometers.bias_ug"], "value": 0.5}
                ],
            },
            "that are not correlated",
        ),
    ],
)
def test_what_would_not_grow_with_a_tolerance_is_refused(keys, message):
    tolerance = {"key": "gyros.scale_error_ppm", "at": 50, "cost": 1, "least": 1, "most": 99}
    wanted = {"require": "p95 of horizontal_error_m <= 100", "tolerances": [tolerance]}
    with pytest.raises(CampaignError, match=message):
        allocate({"scenario": "ideal", "duration_s": 10, "allocate": wanted} | keys)
