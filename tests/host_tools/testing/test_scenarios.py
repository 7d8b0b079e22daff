"""Scenarios of benches: where they come from, and what a test changes."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.scenario import scenario as scenarios
from rrins.host_tools.testing.scenarios import merged, prepare_scenario, toml_text


def test_tables_are_merged_key_by_key():
    table = {"seed": 1, "firmware": {"stand_s": 1, "alignment_s": 2}, "faults": [1]}
    overrides = {"firmware": {"stand_s": 5}, "faults": [2], "body": {"roll_deg": 1}}
    assert merged(table, overrides) == {
        "seed": 1,
        "firmware": {"stand_s": 5, "alignment_s": 2},
        "faults": [2],
        "body": {"roll_deg": 1},
    }
    assert table["firmware"] == {"stand_s": 1, "alignment_s": 2}


@pytest.mark.parametrize("name", scenarios.names())
def test_what_is_written_is_what_is_read(name):
    table = tomllib.loads(scenarios.text_of(name))
    assert tomllib.loads(toml_text(table)) == table


def test_odd_values_are_written():
    table = {"a b": 'tab\t"quoted" ° \\', "flag": True, "small": 1e-9, "list": [{"x": (1, 2)}]}
    read = tomllib.loads(toml_text(table | {"left_out": None}))
    assert read == table | {"list": [{"x": [1, 2]}]}


def test_what_has_no_place_in_a_scenario():
    with pytest.raises(ScenarioError, match="cannot contain such a value"):
        toml_text({"seed": {1}})


def test_a_file_beside_the_test_comes_first(tmp_path):
    beside = tmp_path / "tests"
    beside.mkdir()
    (beside / "ideal").write_text("duration_s = 7", encoding="utf-8")
    file = tmp_path / "whole.toml"
    assert prepare_scenario("ideal", {}, file, beside).duration_s == 7
    assert prepare_scenario("ideal", {}, file, tmp_path).duration_s == 1600
    assert prepare_scenario(beside / "ideal", {"seed": 9}, file, tmp_path).seed == 9


@pytest.mark.parametrize(
    ("given", "overrides", "words"),
    [
        ("rimu_rotatin", {}, "did you mean rimu_rotating"),
        ({"seeds": 1}, {}, "did you mean seed"),
        ("ideal", {"firmware": {"alignment": 1}}, "did you mean alignment_s"),
    ],
)
def test_mistakes_are_told(tmp_path, given, overrides, words):
    with pytest.raises(ScenarioError, match=words):
        prepare_scenario(given, overrides, tmp_path / "whole.toml", Path(tmp_path))
