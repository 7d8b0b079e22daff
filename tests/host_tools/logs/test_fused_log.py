"""The fused increments of a log are those of its run."""

from __future__ import annotations

import pandas as pd
import pytest

from rrins.host_tools.logs.fused_log import FusedLog
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.vehicle.fused import fused_of_scenario
from rrins.host_tools.vehicle.navigator_files import write


def test_a_log_gives_the_same_files_as_its_scenario(recordings, tmp_path):
    recorded = recordings(".blf")
    period_ns = recorded.scenario.period_ns
    source = FusedLog(Log(recorded.path), recorded.scenario)
    log = write(source.tracks(), period_ns, tmp_path / "log")
    run = write(fused_of_scenario(recorded.scenario), period_ns, tmp_path / "run")
    assert source.why_no_truth is None
    assert log.rows == run.rows == 401
    for ours, theirs in zip(log.files, run.files, strict=True):
        assert ours.read_bytes() == theirs.read_bytes(), ours.name


@pytest.mark.slow
def test_the_command_takes_either_and_tells_what_a_log_lacks(run, start, copy, tmp_path):
    path = copy(".blf")
    summary = run("increments", path, tmp_path / "with", "--format", "kf-gins")
    assert summary["has_truth"]
    assert [name.rsplit("/", 1)[-1] for name in summary["files"]] == [
        "imu.txt",
        "truth.nav",
        "navigation.nav",
    ]
    path.with_name(f"{path.name}.json").unlink()
    running = start("increments", path, tmp_path / "none")
    status, _ = running.finish()
    assert status == 6
    assert "OUT_DIR --scenario SCENARIO" in running.said[-1]
    own = tmp_path / "own.toml"
    own.write_text("duration_s = 2\n[redundancy]\nenabled = false\n")  # for its noise is unknown
    running = start("increments", path, tmp_path / "bare", "--scenario", own, "--json")
    status, _ = running.finish()
    assert status == 0, running.said
    assert any("without truth" in line for line in running.said)
    assert {file.name for file in (tmp_path / "bare").iterdir()} == {
        "increments.csv",
        "navigation.csv",
    }


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("idael", "out"), "did you mean ideal?"),
        (("ideal", "out", "--log-channel", "can0"), "are for a log"),
        (("ideal", "out", "--format", "psins", "--frame", "s"), "knows no table"),
    ],
)
def test_wrong_use_is_told(start, arguments, words):
    running = start("increments", *arguments)
    status, out = running.finish()
    assert status != 0
    assert out == ""
    assert words in "\n".join(running.said)


def test_a_scenario_by_the_command(run, tmp_path):
    summary = run("increments", "ideal", tmp_path / "out", "--duration", 2)
    assert (summary["rows"], summary["bridged"]) == (401, 0)
    table = pd.read_csv(tmp_path / "out" / "increments.csv")
    assert len(table) == 401
