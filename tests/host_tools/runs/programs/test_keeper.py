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

from rrins.host_tools.bus.address import EMBEDDED, Address
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.runs.programs import program
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


def said(folder: Path, text: str) -> bool:
    return comes_true(lambda: text in (folder / "firmware.txt").read_text(), 120)


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


CHILDREN = """
import os, subprocess, sys, time
sleep = [sys.executable, "-S", "-c", "import time; time.sleep(1000)", sys.argv[1]]
subprocess.Popen(sleep)
subprocess.Popen(sleep, start_new_session=True)
if os.fork() == 0:  # an orphan, as a daemon is one
    os.setsid()
    subprocess.Popen(sleep)
    os._exit(0)
print("begun", flush=True)
"""


@pytest.mark.parametrize(
    ("end", "status"),
    [
        ("sys.exit(3)", 3),
        ("os.kill(os.getpid(), 11)", -signal.SIGSEGV),
        ("time.sleep(1000)", -signal.SIGKILL),
    ],
)
def test_no_descendant_outlives_a_program_in_whatever_session_it_is(
    end: str, status: int, tmp_path: Path
) -> None:
    script = tmp_path / "parent.py"
    script.write_text(f"{CHILDREN}\n{end}\n")
    process = started(f"{sys.executable} -S {script} {tmp_path}/sleeper", tmp_path)
    assert said(tmp_path, "begun")
    if status == -signal.SIGKILL:
        process.close()
    assert process.wait(120) == status
    assert processes_of(f"{tmp_path}/sleeper") == []
    process.close()


def test_ctrl_c_in_a_terminal_takes_neither_the_keeper_nor_the_program(tmp_path: Path) -> None:
    process = started("sh -c 'sleep 1000'", tmp_path)
    assert os.getsid(process.pid) == process.pid
    assert os.getsid(process.program_pid) == process.program_pid
    process.close()
    assert process.returncode == -signal.SIGKILL


def test_a_program_that_obeys_sigterm_may_end_in_order(tmp_path: Path) -> None:
    script = "trap 'echo in order; exit 0' TERM; echo begun; while :; do sleep 0.01; done"
    process = started(f'sh -c "{script}"', tmp_path)
    assert said(tmp_path, "begun")
    process.terminate()
    assert process.wait(120) == 0
    assert said(tmp_path, "in order")
    process.close()


def test_what_it_prints_is_limited_and_its_last_words_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program, "LOG_BYTES", 200_000)
    words = f"{sys.executable} -S -c \"for k in range(5000): print(f'{{k:099d}}')\""
    process = started(words, tmp_path)
    assert process.wait(120) == 0
    process.close()
    now, before = (tmp_path / name for name in ("firmware.txt", "firmware.before.txt"))
    assert max(now.stat().st_size, before.stat().st_size) <= 200_000
    assert program.last_words(tmp_path) == f"{4999:099d}"
    assert (before.read_bytes() + now.read_bytes()).splitlines()[-1500:] == [
        b"%099d" % k for k in range(3500, 5000)
    ]


def test_a_program_goes_on_where_its_output_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program, "LOG_BYTES", 1000)
    folder = tmp_path / "out"
    folder.mkdir()
    script = f"rm -r {folder}; for k in 1 2 3; do printf %0999d 1; sleep 0.01; done; exit 7"
    process = started(f'sh -c "{script}"', folder)
    assert process.wait(120) == 7
    process.close()


def test_without_a_keeper_the_program_is_not_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", str(tmp_path / "none"))
    with pytest.raises(RehearsalError, match="sh: cannot be started: No such file"):
        started(f"sh -c 'sleep 1000' {tmp_path}", tmp_path)
    assert processes_of(str(tmp_path)) == []


def test_a_program_that_cannot_be_executed_is_told(tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    broken.write_bytes(b"\x7fELF")
    broken.chmod(0o755)
    with pytest.raises(RehearsalError, match="broken: cannot be started: Exec format error"):
        started(str(broken), tmp_path)
