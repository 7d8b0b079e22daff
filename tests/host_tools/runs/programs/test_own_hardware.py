"""A program of one's own as the sensors and the table: same navigation, and each way to fail."""

from __future__ import annotations

import itertools
import sys
from pathlib import Path

import pytest

import rrins
from rrins.dbc.frame import frame_array
from rrins.host_tools.bus import channel
from rrins.host_tools.errors import RehearsalError, SideLostError
from rrins.host_tools.runs import run
from rrins.host_tools.runs.display import RunDisplay
from rrins.host_tools.runs.programs.own_hardware import ProgramLink
from rrins.host_tools.runs.programs.program import Program
from rrins.host_tools.runs.results.pipe import ReportPipe
from rrins.host_tools.scenario.scenario import load
from rrins.host_tools.terminal import new_console
from tests.host_tools.runs.programs.test_own_programs import processes_of

SOME = Path(__file__).with_name("some_hardware.py")
_DURATION_S = 2.0


def rehearsed(words: str, name: str, folder: Path, patience_s: float = 1.0) -> run.RunResult:
    """Rehearse with a program as the hardware."""
    scenario = load(name, duration_s=_DURATION_S)
    with RunDisplay(scenario, new_console(stderr=True), quiet=True) as display:
        return run.rehearse(
            run.Plan(
                name,
                scenario,
                run.Overrides(_DURATION_S),
                hardware=Program.parse(f"{sys.executable} {SOME} {words}"),
                patience_s=patience_s,
            ),
            display,
            folder,
        )


def exchange_with(program: Program, folder: Path) -> None:
    """Exchange epochs with a program until it fails."""
    nothing = frame_array(1)
    with ProgramLink(program, load("ideal"), folder, 0.5, ReportPipe(None)) as link:
        link.begin()
        for epoch in itertools.count():
            link.exchange(nothing, 0, epoch, epoch * 5_000_000)


def test_the_emulation_as_a_program_navigates_as_it_does_itself(tmp_path: Path) -> None:
    result = rehearsed(f"emulation rimu_rotating {_DURATION_S}", "rimu_rotating", tmp_path, 60.0)
    assert result.failure is None
    direct = rrins.simulate("rimu_rotating", duration_s=_DURATION_S)
    assert result.summary["navigation_sha256"] == direct.summary["navigation_sha256"]
    assert result.summary["frames_lost"] == 0
    assert result.summary["hardware"]["faults"]["missing_commands"] == 0


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("ends", "{} ended with status 1 before it was on the bus: no table is connected"),
        ("dies", "{} was killed by SIGSEGV after 0 s of simulated time"),
        ("leaves", "{} ended with status 0 after 0 s of simulated time"),
        ("hangs", "{} has not closed its epoch for 0.5 s, in epoch 100: it hangs"),
        ("floods", "{} floods the bus: more than 36 frames in epoch 0"),
        (
            "version",
            "{} does not follow the protocol of the bus: a datagram of version 2 of the protocol; "
            "this is 1",
        ),
    ],
)
def test_how_it_failed_is_one_line_and_nothing_is_left(
    kind: str, words: str, tmp_path: Path
) -> None:
    program = Program.parse(f"{sys.executable} -S {SOME} {kind} {tmp_path}")
    with pytest.raises(SideLostError) as caught:
        exchange_with(program, tmp_path)
    assert str(caught.value) == words.format(Path(sys.executable).name)
    assert processes_of(str(tmp_path)) == []


def test_a_rehearsal_says_how_the_program_failed(tmp_path: Path) -> None:
    result = rehearsed(f"leaves {tmp_path}", "ideal", tmp_path)
    name = Path(sys.executable).name
    assert str(result.failure) == f"{name} ended with status 0 after 0 s of simulated time"
    assert processes_of(str(tmp_path)) == []
    assert not any(name.startswith("rrins") for name in channel.detect())


def test_faults_of_what_the_program_replaces_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "faulty.toml"
    file.write_text('[[faults]]\nkind = "gyro_bias"\nsensor = 1\nat_s = 1.0\nbias_dph = 5.0\n')
    with pytest.raises(RehearsalError, match=r"faults\.1: gyro_bias is of the emulated hardware"):
        rehearsed("ends", str(file), tmp_path)
