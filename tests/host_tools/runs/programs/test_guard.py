"""Nothing of a user's program is left, also when the rehearsal is killed and the program hangs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from rrins.host_tools.bus.port import EMBEDDED, Address
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.runs.programs import guard
from rrins.host_tools.runs.programs.program import Program, ProgramProcess
from rrins.host_tools.scenario.scenario import load
from tests.host_tools.runs.programs.test_own_programs import STRANGE, processes_of
from tests.processes import Fork

SOME = STRANGE.with_name("some_hardware.py")


def comes_true(what: Callable[[], bool], within_s: float) -> bool:
    """Wait until something is true; return whether it is in time."""
    deadline = time.monotonic() + within_s
    while not what():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True


def started(words: str, folder: Path) -> ProgramProcess:
    address = Address(EMBEDDED, "nowhere")
    return Program.parse(words).start(load("ideal"), address, "max", 1.0, folder)


def guards_of(process: ProgramProcess) -> list[int]:
    return processes_of(f"{guard.__file__}\0{process.pid}\0")


def guard_of(process: ProgramProcess) -> int:
    """Return the guard of a program that has just been started; its words come a little later."""
    assert comes_true(lambda: bool(guards_of(process)), 120)
    (own,) = guards_of(process)
    return own


@pytest.mark.parametrize(
    ("side", "script", "patience"),
    [
        ("firmware", STRANGE, "0"),
        ("hardware", SOME, "1000"),
        pytest.param("firmware", STRANGE, "1000", marks=pytest.mark.soak),
        pytest.param("hardware", SOME, "0", marks=pytest.mark.soak),
    ],
)
def test_a_program_that_hangs_does_not_outlive_a_rehearsal_that_is_killed(
    side: str, script: Path, patience: str, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    words = [
        *("rrins", "rehearse", "ideal", "--duration", "100"),
        *(f"--{side}", f"{sys.executable} -S {script} hangs {tmp_path}"),
        *("--patience", patience, "--out", str(out)),
    ]
    with Fork(words, stderr=subprocess.DEVNULL) as rehearsal:
        said = out / f"{side}.txt"
        assert comes_true(lambda: said.exists() and "no pulse" in said.read_text(), 120)
        rehearsal.kill()
    try:
        assert comes_true(lambda: not processes_of(str(tmp_path)), 120)
    finally:
        for pid in processes_of(str(tmp_path)):
            os.kill(pid, signal.SIGKILL)


def test_a_guard_goes_with_the_program_it_guards(tmp_path: Path) -> None:
    process = started("sh -c 'sleep 1000'", tmp_path)
    guard_of(process)
    process.end_session()
    assert process.wait() == -signal.SIGKILL
    assert guards_of(process) == []
    process.end_session()


def test_ctrl_c_in_a_terminal_does_not_take_the_guard(tmp_path: Path) -> None:
    process = started("sh -c 'sleep 1000'", tmp_path)
    try:
        own = guard_of(process)
        assert os.getsid(own) == own
    finally:
        process.end_session()
        process.wait()


def test_a_program_that_obeys_sigterm_may_end_in_order() -> None:
    script = "trap 'echo in order; exit' TERM; echo begun; while :; do sleep 0.01; done"
    with subprocess.Popen(
        ["sh", "-c", script], stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == "begun\n"
        with subprocess.Popen(
            [sys.executable, "-I", "-S", guard.__file__, str(program.pid), "30"],
            stdin=subprocess.PIPE,
        ) as watching:
            assert program.poll() is None
            assert watching.stdin is not None
            watching.stdin.close()
            assert program.stdout.read() == "in order\n"
            program.wait()
        assert watching.returncode == 0


def test_without_a_guard_the_program_is_not_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", str(tmp_path / "none"))
    with pytest.raises(RehearsalError, match="sh: cannot be started: No such file"):
        started(f"sh -c 'sleep 1000' {tmp_path}", tmp_path)
    assert comes_true(lambda: not processes_of(str(tmp_path)), 120)
