"""A program of one's own as the firmware: each way in which it can fail is told in one line."""

from __future__ import annotations

import os
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from rrins.host_tools.bus import channel
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.errors import FirmwareFaultError, RehearsalError, SideLostError
from rrins.host_tools.runs import rehearsal, run
from rrins.host_tools.runs.display import RunDisplay
from rrins.host_tools.runs.programs.program import Program
from rrins.host_tools.runs.set_up.setup_file import setup_text
from rrins.host_tools.scenario.scenario import load
from rrins.host_tools.terminal import new_console

STRANGE = Path(__file__).with_name("strange_firmware.py")


def processes_of(text: str) -> list[int]:
    """Return the processes that have a word in their command line."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            try:
                if text in (entry / "cmdline").read_text(errors="replace"):
                    found.append(int(entry.name))
            except OSError:
                continue  # it has just ended
    return found


def rehearsed(kind: str, folder: Path, duration_s: float = 2.0, restarts: int = 0) -> run.RunResult:
    """Rehearse with a strange firmware, which has a word of its own in its command line."""
    scenario = load("ideal", duration_s=duration_s)
    program = Program.parse(f"{sys.executable} -S {STRANGE} {kind} {folder}")
    plan = run.Plan(
        "ideal",
        scenario,
        run.Overrides(duration_s),
        firmware=program,
        patience_s=1.0,
        restarts=restarts,
    )
    with RunDisplay(scenario, new_console(stderr=True), quiet=True) as display:
        return run.rehearse(plan, display, folder)


@pytest.fixture
def _impatient(monkeypatch):
    """Have a rehearsal that has failed not wait for what does not end by itself."""
    monkeypatch.setattr(rehearsal, "GRACE_S", 0.1)


@pytest.mark.usefixtures("_impatient")
@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("ends", "{} ended with status 1 before it was on the bus: no licence"),
        ("ends-well", "{} ended with status 0 before it was on the bus"),
        ("dies", "{} was killed by SIGSEGV after 0 s of simulated time"),
        ("leaves", "{} ended with status 0 after 0 s of simulated time"),
        ("hangs", "{} has not closed its epoch for 1 s, in epoch 100 (0.500 s): it hangs"),
        ("floods", "{} floods the bus: more than 25000 frames in a second, in epoch 100 (0.500 s)"),
        (
            "version",
            "{} does not follow the protocol of the bus: a datagram of version 2 of the protocol; "
            "this is 1",
        ),
        (
            "garbage",
            "{} does not follow the protocol of the bus: a datagram of 10 bytes, shorter or longer "
            "than any",
        ),
    ],
)
def test_how_it_failed_is_one_line_and_nothing_is_left(
    kind: str, words: str, tmp_path: Path
) -> None:
    result = rehearsed(kind, tmp_path)
    assert isinstance(result.failure, SideLostError)
    assert str(result.failure) == words.format(Path(sys.executable).name)
    assert not result.summary["completed"]
    for _ in range(100):  # a process that was killed is gone a little later
        if not processes_of(str(tmp_path)):
            break
        time.sleep(0.01)
    assert processes_of(str(tmp_path)) == []
    assert not any(name.startswith("rrins") for name in channel.detect())


def test_the_hardware_outlives_a_firmware_that_is_started_again(tmp_path: Path) -> None:
    result = rehearsed("dies-once", tmp_path, restarts=1)
    assert result.failure is None
    assert result.summary["hardware"]["epochs"] == load("ideal", duration_s=2.0).epochs + 1
    assert result.summary["firmware"]["restarts"] == 1


def test_a_channel_that_another_took_meanwhile_is_left_for_a_free_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The program is refused there, as another is the firmware: that is not its own failure."""
    planned, is_over, taken = run.Plan.rehearsal, threading.Event(), []

    def serve(hub: RrinsBus) -> None:
        while not is_over.is_set():
            hub.recv(0.05)

    def taken_once(plan: run.Plan, address: Address, *rest: Any) -> rehearsal.Rehearsal:
        if not taken:
            taken.append(address.channel)
            hub = others.enter_context(RrinsBus(address.channel, host="here", name="hardware"))
            served = pool.submit(serve, hub)
            others.callback(served.result)
            others.callback(is_over.set)
            options = {"name": "firmware", "exclusive": True}
            others.enter_context(RrinsBus(address.channel, host="never", **options))
        return planned(plan, address, *rest)

    monkeypatch.setattr(run.Plan, "rehearsal", taken_once)
    with ThreadPoolExecutor(1) as pool, ExitStack() as others:
        assert rehearsed("idle", tmp_path, 0.5).failure is None
    assert taken


@pytest.mark.usefixtures("_impatient")
def test_a_firmware_that_fails_more_often_than_it_may_is_told(tmp_path: Path) -> None:
    result = rehearsed("dies", tmp_path, restarts=2)
    name = Path(sys.executable).name
    assert str(result.failure) == f"{name} was killed by SIGSEGV after 0 s of simulated time"
    assert result.summary["firmware"]["restarts"] == 2


def test_one_that_answers_and_does_nothing_never_navigates(tmp_path: Path) -> None:
    result = rehearsed("idle", tmp_path, 0.5)
    assert result.failure is None
    assert result.summary["hardware"]["faults"]["crc_errors"] > 0
    with pytest.raises(FirmwareFaultError, match="never navigated"):
        result.check()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("./nothing", "./nothing: there is no such program"),
        (str(STRANGE), f"{STRANGE}: is not executable"),
        ("'", "': not a command line: No closing quotation"),
        ("", "no program is named"),
    ],
)
def test_a_program_that_is_none_is_told_before_anything_starts(text: str, words: str) -> None:
    with pytest.raises(RehearsalError) as caught:
        Program.parse(text)
    assert str(caught.value) == words


def test_the_set_up_says_what_the_scenario_says() -> None:
    lines = setup_text(load("rimu_rotating")).splitlines()
    assert lines[0] == "rrins-setup 1"
    keys = [line.split()[0] for line in lines]
    assert keys.count("gyro") == keys.count("accelerometer") == 4
    assert keys.count("turn") == 16
    assert "latitude_deg 40.3554" in lines
    assert lines[-1].split()[0] == "turn"
