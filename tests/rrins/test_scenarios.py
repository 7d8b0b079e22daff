"""Scenarios by name, file and dict, changed by keyword."""

from __future__ import annotations

import numpy as np
import pytest

import rrins


def test_built_in_ones_by_name():
    assert "rimu_rotating" in rrins.scenario_names()
    assert rrins.load_scenario("rimu_rotating").duration_s == 6000


def test_a_file_a_dict_and_a_scenario(tmp_path):
    file = tmp_path / "own.toml"
    file.write_text("duration_s = 7\n[gyros]\nbias_dph = 3\n")
    by_file = rrins.load_scenario(file)
    assert by_file == rrins.load_scenario({"duration_s": 7, "gyros": {"bias_dph": 3}})
    assert rrins.load_scenario(by_file, seed=4).gyros.bias_dph == 3


@pytest.mark.parametrize(
    ("change", "value", "path"),
    [
        ("duration_s", 12.0, "duration_s"),
        ("gyro_bias_dph", 0.5, "gyros.bias_dph"),
        ("accelerometer_bias_ug", 70.0, "accelerometers.bias_ug"),
        ("turn_rate_dps", 3.0, "firmware.turn_rate_dps"),
        ("gyro_consistency_dph", 9.0, "firmware.gyro_consistency_dph"),
        ("latitude_deg", -20.0, "site.latitude_deg"),
        ("turntable__inner__rate_limit_dps", 44.0, "turntable.inner.rate_limit_dps"),
        ("gyros__bias_dph", 0.5, "gyros.bias_dph"),
    ],
)
def test_a_key_by_its_name(change, value, path):
    found = rrins.load_scenario("rimu_rotating", **{change: value})
    for name in path.split("."):
        found = getattr(found, name)
    assert found == value


def test_a_value_for_each_sensor_as_list_or_array():
    biases = [0.1, 0.2, 0.3, 0.4]
    by_list = rrins.load_scenario("rimu_rotating", gyro_bias_dph=biases)
    by_array = rrins.load_scenario("rimu_rotating", gyro_bias_dph=np.array(biases))
    assert by_list == by_array
    assert by_list.gyros.bias_dph == tuple(biases)
    assert rrins.load_scenario("rimu_rotating", seed=np.int64(3)).seed == 3


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"gyro_biass_dph": 1}, "'gyro_biass_dph'; did you mean gyro_bias_dph?"),
        ({"rate_limit_dps": 1}, "turntable__inner__rate_limit_dps"),
        ({"gyro_bias_dph": [1, 2]}, "2 values for 4 sensors"),
        ({"duration_s": -1}, "duration_s"),
        ({"gyros__bias": 1}, "did you mean bias_dph?"),
    ],
)
def test_a_wrong_change_is_one_line(changes, words):
    with pytest.raises(rrins.ScenarioError) as caught:
        rrins.load_scenario("rimu_rotating", **changes)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", rrins.scenario_names())
def test_written_as_toml_it_is_the_same(name, tmp_path):
    scenario = rrins.load_scenario(name)
    (tmp_path / "again.toml").write_text(scenario.toml())
    assert rrins.load_scenario(tmp_path / "again.toml") == scenario


def test_a_file_that_it_names_is_found_from_elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scenario = rrins.load_scenario("rimu_rotating", firmware__calibration="cal.toml")
    assert str(tmp_path / "cal.toml") in scenario.toml()
    assert "cal.toml" in scenario._repr_html_()
