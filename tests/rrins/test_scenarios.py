"""Scenarios by name, file and dict, changed by keyword."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import rrins
from rrins.host_tools.scenario.scenario import text_of
from rrins.host_tools.scenario.schema import json_schema


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


def test_a_wrong_key_of_a_scenario_is_one_line_without_pydantic():
    for call, words in (
        (lambda: rrins.Scenario(duration_s=-1), "duration_s: input should be greater than 0"),
        (lambda: rrins.load_scenario("ideal", gyro_bias_dph="x"), r"gyros\.bias_dph: input"),
    ):
        with pytest.raises(rrins.ScenarioError, match=words) as caught:
            call()
        assert caught.value.__cause__ is None
        assert caught.value.__suppress_context__
        assert "\n" not in str(caught.value)
    with pytest.raises(AttributeError, match="load_scenario"):
        rrins.load_scenario("ideal").duration_s = 5


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


SCHEMA = json_schema()


def test_the_schema_says_what_each_key_means_and_its_unit():
    tables = [SCHEMA, *SCHEMA["$defs"].values()]
    keys = [(key, of_key) for table in tables for key, of_key in table["properties"].items()]
    assert [key for key, of_key in keys if of_key["description"][:5] in ("", " Unit")] == []
    assert "Unit: °/h." in SCHEMA["$defs"]["Gyros"]["properties"]["bias_dph"]["description"]


@pytest.mark.parametrize("name", rrins.scenario_names())
def test_the_schema_accepts_what_is_built_in(name):
    jsonschema.Draft202012Validator(SCHEMA).validate(tomllib.loads(text_of(name)))


def test_the_schema_refuses_a_misspelt_key():
    table = {"duration_s": 1, "gyros": {"bias_dhp": 1}}
    with pytest.raises(jsonschema.ValidationError, match="bias_dhp"):
        jsonschema.Draft202012Validator(SCHEMA).validate(table)


SCRIPT = """\
import numpy as np
import rrins

rrins.simulate("ideal", duration_s=1, gyro_bias_dph=np.ones(4), turntable__wobble_arcsec=3)
rrins.simulate("ideal", faults=[{"kind": "gyro_bias", "sensor": 3, "at_s": 60}])
faults = rrins.open_faults()
faults.inject("gyro_bias", sensor=3, bias_dph=20)
faults.inject({"kind": "gyro_bias", "sensor": 3})
rrins.simulate("ideal", gyro_biass_dph=1)
rrins.rehearse("ideal", gyro_bias_dph="much")
rrins.load_scenario("ideal", mode="spinning")
rrins.simulate("ideal", faults=[{"kind": "gyro_bias", "bias": 20}])
faults.inject("gyro_bias", bias=20)
faults.inject("gyro_bais")
"""


@pytest.mark.typed
def test_type_checkers_know_the_keys_and_their_types(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--no-error-summary", "--hide-error-context", str(script)],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    said = [line for line in done.stdout.splitlines() if ": error: " in line]
    wrong = ["gyro_biass_dph", "much|str", "spinning", "bias", "bias", "gyro_bais"]
    assert len(said) == len(wrong), done.stdout
    for number, (line, word) in enumerate(zip(said, wrong, strict=True), 9):
        assert f"script.py:{number}:" in line
        assert any(one in line for one in word.split("|")), line
