from __future__ import annotations

import numpy as np
import pytest

from rrins.host_tools.campaigns import words
from rrins.host_tools.campaigns.definition import Definition, Wishes, load
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.errors import RehearsalError


def made(vary=None, **wishes):
    return load("rimu_rotating", Wishes(vary=vary or {}, **{"runs": 64, **wishes}))


def drawn(definition, column):
    names = [one.column for one in definition.plan.inputs]
    one = definition.plan.inputs[names.index(column)]
    return np.array([definition.plan.point(run)[one] for run in range(definition.runs)])


def test_each_sensor_draws_its_own_unless_all_have_one():
    each = made({"gyros.bias_dph": "normal(0, 1)"}).scenario_of(3).gyros.bias_dph
    assert len(set(each)) == 4
    common = made({"gyros.bias_dph": "normal(0, 1) common"}).scenario_of(3).gyros.bias_dph
    assert isinstance(common, float)
    second = made({"gyros.bias_dph.2": "normal(5, 1)"}).scenario_of(3).gyros.bias_dph
    assert (second[0], second[2], second[3]) == (0.1, 0.12, 0.13)
    assert second[1] > 1


def test_correlations_are_those_asked_for():
    vary = {
        "gyros.bias_dph": "normal(0, 1) correlated 0.8",
        "accelerometers.bias_ug": "uniform(0, 9)",
    }
    pair = ("gyros.bias_dph.1", "accelerometers.bias_ug.1", -0.5)
    definition = made(vary, runs=2000, correlate=[pair])
    first, second = (drawn(definition, f"gyros.bias_dph.{k}") for k in (1, 2))
    other = drawn(definition, "accelerometers.bias_ug.1")
    assert np.corrcoef(first, second)[0, 1] == pytest.approx(0.8, abs=0.03)
    assert np.corrcoef(first, other)[0, 1] == pytest.approx(-0.48, abs=0.05)
    wrong = [("gyros.bias_dph.1", "accelerometers.bias_ug.1", 0.99)]
    wrong += [("gyros.bias_dph.2", "accelerometers.bias_ug.1", -0.99)]
    with pytest.raises(CampaignError, match="contradict"):
        made(vary, correlate=wrong)


def test_faults_vary_in_kind_time_and_size():
    text = "kind=list(gyro_bias, gyro_scale), sensor=list(1, 3)"
    text += ", at_s=uniform(10, 20), size=uniform(5, 6)"
    definition = made(faults=[words.fault_of(text)])
    seen = [definition.scenario_of(run).faults[0] for run in range(16)]
    assert {one.kind for one in seen} == {"gyro_bias", "gyro_scale"}
    assert {one.sensor for one in seen} == {1, 3}
    assert all(10 <= one.at_s <= 20 and 5 <= one.value <= 6 for one in seen)


def test_a_run_follows_from_root_and_number_alone():
    vary = {"gyros.bias_dph": "normal(0, 1)", "accelerometers.bias_ug": "uniform(0, 9)"}
    for design in ("random", "sobol"):
        small, large = (made(vary, design=design, runs=runs).scenario_of(7) for runs in (8, 4000))
        assert small == large
    turned = dict(reversed(vary.items()))
    assert made(turned).scenario_of(7) == made(vary).scenario_of(7)
    assert made(vary, seed=2).scenario_of(7) != made(vary).scenario_of(7)
    assert len({made(vary).plan.seed(run) for run in range(1000)}) == 1000


def test_a_latin_hypercube_has_one_point_in_each_slice():
    column = drawn(made({"gyros.bias_dph": "uniform(0, 1)"}, design="lhs"), "gyros.bias_dph.3")
    assert sorted((column * 64).astype(int)) == list(range(64))


def test_a_grid_has_all_combinations_with_the_same_noise():
    vary = {
        "firmware.turn_rate_dps": "list(1, 2, 4)",
        "firmware.scheme": "list(16-position, 8-position)",
    }
    definition = made(vary, design="grid", runs=None)
    assert definition.runs == 6
    cells = [definition.scenario_of(run) for run in range(6)]
    assert len({(one.firmware.turn_rate_dps, one.firmware.scheme) for one in cells}) == 6
    assert len({one.seed for one in cells}) == 1
    assert made(vary, design="grid", runs=12).plan.seed(6) != definition.plan.seed(0)
    with pytest.raises(CampaignError, match="multiple of 6"):
        made(vary, design="grid", runs=7)


def test_one_at_a_time_changes_one_input_of_each_run():
    vary = {"site.height_m": "uniform(0, 100)", "gyros.bias_dph.1": "normal(0, 2)"}
    definition = made(vary, design="one-at-a-time", runs=None)
    points = [tuple(definition.plan.point(run).values()) for run in range(definition.runs)]
    assert points == [(0, 50), (pytest.approx(-2), 50), (pytest.approx(2), 50), (0, 0), (0, 100)]
    rates = {"firmware.turn_rate_dps": "list(2, 1, 4)", "site.height_m": "list(7)"}
    definition = made(rates, design="one-at-a-time", runs=None)
    points = [tuple(definition.plan.point(run).values()) for run in range(definition.runs)]
    assert points == [(2, 7), (1, 7), (4, 7)]


def test_saltelli_changes_one_input_or_the_noise():
    vary = {"site.height_m": "uniform(0, 100)", "site.latitude_deg": "uniform(0, 80)"}
    definition = made(vary, design="saltelli", runs=10)
    points = [tuple(definition.plan.point(run).values()) for run in range(5)]
    seeds = [definition.plan.seed(run) for run in range(5)]
    a, b = points[0], points[4]
    assert points == [a, (b[0], a[1]), (a[0], b[1]), a, b]
    assert seeds == [seeds[0]] * 3 + [seeds[4]] * 2
    assert seeds[0] != seeds[4]


def test_plain_values_give_the_same_campaign(tmp_path):
    file = tmp_path / "c.toml"
    file.write_text(
        'scenario = "rimu_rotating"\nruns = 9\nduration_s = 60\n[set]\nsensors = "prototype"\n'
        '[vary]\n"gyros.scale_error_ppm" = "normal(0, 50)"\n'
        '[[faults]]\nkind = "gyro_bias"\nat_s = "uniform(1, 2)"\n'
    )
    definition = load(str(file))
    assert (definition.runs, definition.scenario.duration_s) == (9, 60)
    again = Definition.of(definition.values())
    assert again.scenario_of(4) == definition.scenario_of(4)


@pytest.mark.parametrize(
    ("vary", "why"),
    [
        ({"gyros.bias_dhp": "normal(0, 1)"}, "did you mean bias_dph"),
        ({"gyros.bias_dph.5": "normal(0, 1)"}, "sensor 5 of 4"),
        ({"seed": "list(1, 2)"}, "cannot be varied"),
        ({"faults.1.at_s": "uniform(0, 1)"}, "there is no 1 of 0"),
        ({"gyros.bias_dph": "normal(0, 1)", "gyros.bias_dph.1": "normal(0, 1)"}, "twice"),
        ({"site.latitude_deg": "uniform(200, 300)"}, "latitude_deg"),
    ],
)
def test_what_cannot_be_is_refused_before_it_begins(vary, why):
    with pytest.raises(RehearsalError, match=why):
        made(vary)
