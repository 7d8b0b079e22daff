"""`rrins redundancy` as a user meets it."""

from __future__ import annotations

import json
import threading
from contextlib import contextmanager

import pytest
from click.testing import CliRunner

from rrins.host_tools.cli import output
from rrins.host_tools.cli.main import rrins


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def runner(*arguments, status=0):
        result = CliRunner().invoke(rrins, ["redundancy", *arguments], prog_name="rrins")
        assert result.exit_code == status, result.output
        return result.stdout if status == 0 else result.stderr

    return runner


@pytest.mark.soak
def test_geometries_stand_side_by_side(run, tmp_path):
    steps = ("--gyro", "50", "--accelerometer", "5000")
    said = run("--rimu", "tetrahedron", "--rimu", "cone", "--runs", "1", *steps)
    for words in (
        "tetrahedron",
        "cone",
        "which, in motion, 600 s",
        "theory, half / 95 %; runs",
        "σ",
    ):
        assert words in said
    assert max(len(line) for line in said.splitlines() if "│" in line) <= 80
    assert (tmp_path / "out" / "redundancy" / "report.html").exists()
    assert (tmp_path / "out" / "redundancy" / "delays.png").exists()


@pytest.mark.soak
def test_runs_stand_beside_the_theory(run):
    options = ("--gyro", "50", "--accelerometer", "5000", "--runs", "1")
    result = json.loads(run("--rimu", "cone", *options, "--json"))
    (candidate,) = result["candidates"]
    (group,) = candidate["gyros"]["groups"]
    (delay,) = group["delays_s"]
    assert delay["monte_carlo"]["wrong"] == 0
    assert delay["monte_carlo"]["standing"]["half"] < 2.5
    assert candidate["sound"]["runs_with_an_alarm"] == 0


def test_ctrl_c_ends_it_in_one_line(run, tmp_path, monkeypatch):
    @contextmanager
    def pressed():
        stop = threading.Event()
        stop.set()
        yield stop

    monkeypatch.setattr(output, "as_event", pressed)
    message = run("--rimu", "cone", "--gyro", "50", "--runs", "3", status=130)
    assert message == "rrins: stopped by the user\n"
    assert not (tmp_path / "out" / "redundancy" / "report.html").exists()


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("rimu_rotatin",), 3, "did you mean rimu_rotating"),
        (("--rimu", "tetrahedrom"), 3, "did you mean tetrahedron"),
        (("--rimu", "none.toml"), 3, "none.toml"),
        (("--preset", "tactica"), 3, "did you mean tactical"),
        (("--runs", "0"), 2, "0"),
        (("--gyro", "nan"), 2, "nan"),
        (("--false-alarms", "0"), 2, "0"),
        (("--runs", "1", "--out", "file"), 1, "cannot be created"),
    ],
)
def test_what_is_wrong_is_told(run, tmp_path, arguments, status, words):
    if "file" in arguments:
        (tmp_path / "file").write_text("")
        result = CliRunner().invoke(rrins, ["redundancy", *arguments], prog_name="rrins")
        assert result.exit_code != 0
        return
    message = run(*arguments, status=status)
    assert words in message
    if status != 2:
        assert len(message.splitlines()) == 1
