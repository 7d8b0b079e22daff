"""A disk that is full: one line, the right status, and what could be written stays."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import can
import pytest
from click.testing import CliRunner

from rrins.host_tools.cli import main as cli
from rrins.host_tools.runs.results.samples import NAVIGATION_SAMPLES, TRUTH_SAMPLES

SHORT = ("rimu_rotating", "--duration", "3", "--out", "out")


@pytest.fixture(autouse=True)
def _in_a_folder(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)


def run(*arguments, status):
    """Run a command; return its JSON object, if any, and the one line that it says."""
    ran = CliRunner().invoke(cli.rrins, [*arguments, "--json"])
    assert ran.exit_code == status, ran
    assert isinstance(ran.exception, SystemExit)
    (said,) = [line for line in ran.stderr.splitlines() if line.startswith("rrins: ")]
    assert ran.stderr.splitlines()[-1] == said
    return json.loads(ran.stdout or "null"), said


@pytest.mark.parametrize("rows", [NAVIGATION_SAMPLES, TRUTH_SAMPLES])
@pytest.mark.parametrize("way", [(), ("--frames",)])
def test_a_simulation_without_room_for_its_rows(rows, way):
    Path("out").mkdir()
    Path("out", rows).symlink_to("/dev/full")
    summary, said = run("simulate", *SHORT, *way, status=1)
    assert said == f"rrins: out/{rows}: cannot be written: No space left on device"
    assert not summary["completed"]
    assert summary["stopped"] == said.removeprefix("rrins: ")
    assert json.loads(Path("out/summary.json").read_text()) == summary
    assert [file.name for file in Path("out").iterdir()] == ["summary.json"]


@pytest.mark.parametrize("name", ["navigation_errors.png", "errors.csv", "summary.json"])
def test_a_simulation_without_room_for_a_result(name, no_room_for):
    no_room_for(name)
    summary, said = run("simulate", *SHORT, status=1)
    assert said == f"rrins: out/{name}: cannot be written: No space left on device"
    assert summary["completed"]
    there = {file.name for file in Path("out").iterdir()}
    order = (
        "summary.json",
        "navigation_errors.png",
        "horizontal_track.png",
        "parity.png",
        "errors.csv",
    )
    assert there == set(order[: order.index(name)])


def test_a_rehearsal_without_room_for_the_note_of_its_recording(no_room_for):
    no_room_for("bus.log.json")
    summary, said = run("rehearse", *SHORT, "--record", "bus.log", status=6)
    why = "its note: bus.log.json: cannot be written: No space left on device"
    assert said == f"rrins: recording bus.log: {why}"
    assert summary["completed"]
    assert Path("out/errors.csv").exists()
    with can.LogReader("bus.log") as log:
        received = summary["firmware"]["frames_received"]
        assert sum(1 for _ in log) == received + summary["firmware"]["frames_sent"]


def test_a_replay_without_room(no_room_for):
    run_rehearsal = CliRunner().invoke(cli.rrins, ["rehearse", *SHORT, "--record", "bus.log"])
    assert run_rehearsal.exit_code == 0
    for name in ("errors.csv", "horizontal_track.png"):
        no_room_for(name)
        _, said = run("replay", "bus.log", "--firmware", "--out", "again", status=1)
        assert said == f"rrins: again/{name}: cannot be written: No space left on device"
    Path("again", TRUTH_SAMPLES).symlink_to("/dev/full")
    _, said = run("replay", "bus.log", "--firmware", "--out", "again", status=1)
    assert said == f"rrins: again/{TRUTH_SAMPLES}: cannot be written: No space left on device"


@pytest.fixture
def no_room_for(monkeypatch):
    """Return a function after which no file of a name can be put in its place."""
    replace = Path.replace
    names = []

    def replaced(self, target):
        if Path(target).name in names:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", replaced)
    return names.append
