"""Rehearsals as processes, watched by what they print."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import pytest

from host_tools.direct import run_without_frames
from host_tools.results import read_errors

COMMAND = (sys.executable, "-m", "host_tools")


@pytest.fixture(autouse=True)
def _own_channels(monkeypatch):
    """Give each test channels of its own: tests may run side by side. A socket's path is short."""
    folder = tempfile.mkdtemp(prefix="rrins-")
    monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
    yield
    shutil.rmtree(folder)


class Running:
    """A `rrins` command under way; its standard error is read line by line."""

    def __init__(self, arguments, folder):
        self.process = subprocess.Popen(
            [*COMMAND, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=folder,
            start_new_session=True,
        )
        self.said = []

    def wait_for_line(self, word):
        """Read until a line holds `word`."""
        for line in self.process.stderr:
            self.said.append(line.rstrip())
            if word in line:
                return
        raise AssertionError(f"{word!r} was never said: {self.said}")

    def children(self):
        """Return the process numbers of the two sides by name."""
        number = self.process.pid
        listed = Path(f"/proc/{number}/task/{number}/children").read_text().split()
        found = {}
        for child in listed:
            words = Path(f"/proc/{child}/cmdline").read_text().split("\0")
            found |= {side: int(child) for side in ("firmware", "hardware") if side in words}
        return found

    @contextmanager
    def paused(self):
        """Hold a rehearsal where it is, so that what starts beside it has all the time it needs."""
        firmware = self.children()["firmware"]
        os.kill(firmware, signal.SIGSTOP)
        try:
            yield
        finally:
            os.kill(firmware, signal.SIGCONT)

    def finish(self, timeout=60):
        """Wait for the end; return (exit status, standard output)."""
        out, err = self.process.communicate(timeout=timeout)
        self.said += err.splitlines()
        return self.process.returncode, out

    def kill(self):
        for number in [*self.children().values(), self.process.pid]:
            os.kill(number, signal.SIGKILL)
        self.process.communicate()


@pytest.fixture
def start(tmp_path):
    """Start a command; whatever is still running at the end is killed and fails the test."""
    running = []

    def starter(*arguments):
        running.append(Running([str(a) for a in arguments], tmp_path))
        return running[-1]

    yield starter
    left = [r for r in running if r.process.poll() is None]
    for one in left:
        one.kill()
    assert not left, "a command was still running"


@pytest.fixture
def run(start):
    """Run a command to its end; return its JSON object."""

    def runner(*arguments, status=0):
        command = start(*arguments, "--json")
        returned, out = command.finish(timeout=100)
        assert returned == status, command.said
        return json.loads(out)

    return runner


def is_alive(number):
    """Return whether a process is there and no zombie."""
    try:
        return Path(f"/proc/{number}/stat").read_text().split(") ")[1][0] != "Z"
    except FileNotFoundError:
        return False


@pytest.fixture
def assert_gone():
    def check(numbers):
        assert not [number for number in numbers if is_alive(number)]

    return check


@pytest.fixture
def fly(tmp_path_factory):
    """Run a scenario without frames; return the firmware's summary and the errors."""

    def flyer(scenario):
        folder = tmp_path_factory.mktemp("flown")
        firmware, _, _ = run_without_frames(scenario, folder)
        return firmware, read_errors(folder, scenario.rate_hz)

    return flyer
