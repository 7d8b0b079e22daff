"""Sides as forks of a command: what they get, how they end, and that they leave nothing behind."""

from __future__ import annotations

import json
import signal
import subprocess
import tempfile
import threading

from click.testing import CliRunner

from rrins.host_tools.cli.main import rrins
from rrins.host_tools.runs.sides import starting
from rrins.host_tools.runs.sides.starting import Forks
from tests.processes import Fork

# What is forked has one thread, so a program does it, and tests what follows.
_PROGRAM = """
import os, signal, subprocess, sys, time
from rrins.host_tools.runs.sides import starting

def command(words):
    fd = int(words[-1])
    if words[0] == "wait":
        os.write(fd, b"waiting ")
        time.sleep(60)
    os.write(fd, repr((words[:-1], os.getsid(0) == os.getpid(), os.read(0, 1))).encode())
    sys.exit(7)
"""


def in_a_program(lines: str) -> str:
    """Run lines in a program with the command above; return what they print."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with tempfile.NamedTemporaryFile("w", suffix=".py") as script:
        script.write(_PROGRAM + lines)
        script.flush()
        with Fork([script.name], text=True, **pipes) as process:
            out, complaints = process.communicate(timeout=60)
    assert (process.returncode, complaints) == (0, "")
    return out


def test_a_fork_runs_its_words_in_a_session_of_its_own_without_input():
    out = in_a_program("""
with starting.Forks(command) as forks:
    for side in ("hardware", "firmware"):
        read, write = os.pipe()
        fork = forks.start([side, "--speed", "max"], write)
        os.close(write)
        print(type(fork).__name__, fork.wait(), fork.returncode)
        # It ends: neither fork holds the other's pipe.
        print(os.fdopen(read).read())
""")
    words = [
        str((["hardware", "--speed", "max", "--report-fd"], True, b"")),
        str((["firmware", "--speed", "max", "--report-fd"], True, b"")),
    ]
    assert out.splitlines() == ["Fork 7 7", words[0], "Fork 7 7", words[1]]


def test_a_process_with_threads_is_not_forked():
    end = threading.Event()
    thread = threading.Thread(target=end.wait)
    thread.start()
    try:
        with Forks(lambda words: None) as forks:
            program = forks.start(["firmware", "--help"], 2)
    finally:
        end.set()
        thread.join()
    assert isinstance(program, subprocess.Popen)
    assert program.wait() == 0


def test_a_process_that_is_no_command_is_not_forked(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(starting, "Fork", None)
    done = CliRunner().invoke(rrins, ["rehearse", "ideal", "--duration", "1", "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["completed"]


def test_a_fork_that_is_killed_says_by_what_and_one_that_runs_is_not_waited_for():
    out = in_a_program("""
from rrins.host_tools import interruption

interruption.heed_sigterm()  # as the command does, but it is not the side's own way to end
for end in ("terminate", "kill"):
    fork = starting.Fork(command)
    read, write = os.pipe()
    fork.begin(["wait"], write)
    os.read(read, 1)
    try:
        fork.wait(0.01)
    except subprocess.TimeoutExpired:
        print(fork.poll())
    getattr(fork, end)()
    print(fork.wait())
    fork.kill()  # nobody else has its number now
""")
    assert out.split() == ["None", str(-signal.SIGTERM), "None", str(-signal.SIGKILL)]


def test_forks_that_are_not_needed_end():
    out = in_a_program("""
with starting.Forks(command) as forks:
    numbers = [fork.pid for fork in forks._waiting]
for number in numbers:
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        print("gone")
""")
    assert out.split() == ["gone", "gone"]


def test_forks_end_with_a_command_that_is_killed():
    out = in_a_program("""
forker = os.fork()
if not forker:
    forks = starting.Forks(command)
    os.kill(os.getpid(), signal.SIGKILL)
os.waitpid(forker, 0)
""")
    assert out == ""  # the forks held standard output: it was read to its end
