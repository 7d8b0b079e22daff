"""Finished results are kept when another run writes into their folder."""

from __future__ import annotations

import json

import pytest

from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.runs.results.keeping import place_for


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "summary.json").write_text(json.dumps(summary()))
    for name in ("errors.csv", "estimator.png", "estimated_sensors.csv"):
        (tmp_path / name).write_text("the first")
    (tmp_path / "notes.txt").write_text("of a person")
    return tmp_path


def summary(completed=True, digest="a"):
    return {"scenario": "ideal", "completed": completed, "navigation_sha256": digest}


def test_an_empty_folder_gets_whatever_comes(tmp_path):
    assert place_for(tmp_path, summary(completed=False)) == (tmp_path, None)


def test_a_stopped_run_does_not_take_the_place_of_a_finished_one(folder):
    place, note = place_for(folder, summary(completed=False))
    assert place == folder / "stopped"
    assert note is not None
    assert (folder / "errors.csv").read_text() == "the first"


def test_another_finished_run_moves_the_first_aside_and_nothing_else(folder):
    place, note = place_for(folder, summary(digest="b"))
    assert place == folder
    assert note == f"the run that had finished in {folder} is kept in {folder / 'previous'}"
    kept = {path.name for path in (folder / "previous").iterdir()}
    assert kept == {"summary.json", "errors.csv", "estimator.png", "estimated_sensors.csv"}
    assert {path.name for path in folder.iterdir()} == {"notes.txt", "previous"}


def test_the_same_result_again_takes_the_place(folder):
    assert place_for(folder, summary()) == (folder, None)
    assert not (folder / "previous").exists()


@pytest.mark.parametrize("text", ["", "[]", "{", '{"completed": false}'])
def test_what_never_finished_is_not_kept(folder, text):
    (folder / "summary.json").write_text(text)
    assert place_for(folder, summary()) == (folder, None)


def test_what_stands_in_the_way_is_one_line(folder):
    (folder / "stopped").write_text("")
    with pytest.raises(RehearsalError, match="stopped: cannot be made: File exists"):
        place_for(folder, summary(completed=False))
