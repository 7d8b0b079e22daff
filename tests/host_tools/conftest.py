"""Rehearsals as processes, watched by what they print; and recorded in this process."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from rrins.dbc.frame import FrameArray
from rrins.firmware_py.loop import Firmware
from rrins.firmware_py.loop import run_lockstep as run_firmware
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.port import BatchPort
from rrins.host_tools.cli.main import rrins
from rrins.host_tools.drawing import page, saving
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.loop import run_lockstep as run_hardware
from rrins.host_tools.logs.reader import Log, Piece
from rrins.host_tools.recording.note import Note, write_note
from rrins.host_tools.recording.recorder import NAME, Recorder, add_result
from rrins.host_tools.runs.direct import run_without_frames
from rrins.host_tools.runs.results import plots
from rrins.host_tools.runs.results.results import read_errors
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    hardware_settings,
    scenario_wire,
)
from rrins.host_tools.runs.sides import starting
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.testing import processes
from tests.processes import NO_PICTURE, Fork, Forking, write_no_pictures


@pytest.fixture(autouse=True)
def _own_channels(monkeypatch):
    """Give each test channels of its own: tests may run side by side. A socket's path is short."""
    folder = tempfile.mkdtemp(prefix="rrins-")
    monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
    yield
    while Path(folder).exists():
        with suppress(FileNotFoundError):  # a host that ends removes its own files meanwhile
            shutil.rmtree(folder)


@pytest.fixture(autouse=True)
def _no_pictures(request, monkeypatch):
    """Have pictures drawn only where a test looks at them."""
    if request.node.get_closest_marker("pictures") is None:
        monkeypatch.setattr(plots, "write_pictures", write_no_pictures)
        for module in (saving, page):
            monkeypatch.setattr(module, "png_of", lambda picture: NO_PICTURE)


@pytest.fixture(autouse=True)
def _forked(monkeypatch):
    """Have the sides of a rehearsal in this process start as forks of the server."""
    for module in (starting, processes):
        monkeypatch.setattr(module, "subprocess", Forking())


class Running:
    """A `rrins` command under way; its standard error is read line by line.

    It is a fork, or a program where its start is what a test is about, or a package is needed that
    is imported when it starts (asammdf).
    """

    def __init__(self, arguments, folder, is_program=False):
        is_program = is_program or any(".mf4" in word for word in arguments)
        command, *how = (subprocess.Popen, sys.executable, "-m") if is_program else (Fork,)
        self.process = command(
            [*how, "rrins", *arguments],
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
            name = Path(f"/proc/{child}/comm").read_text().split()[-1]
            found |= {name: int(child)} if name in ("firmware", "hardware") else {}
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

    def finish(self, timeout=150):
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

    def starter(*arguments, is_program=False):
        running.append(Running([str(a) for a in arguments], tmp_path, is_program))
        return running[-1]

    yield starter
    left = [r for r in running if r.process.poll() is None]
    for one in left:
        one.kill()
    assert not left, "a command was still running"


@pytest.fixture
def run(start, tmp_path, monkeypatch):
    """Run a command to its end; return its JSON object. Only a side needs a process of its own."""

    def runner(*arguments, status=0):
        words = [*map(str, arguments), "--json"]
        if words[0] in ("rehearse", "firmware", "hardware"):
            command = start(*words)
            returned, out = command.finish(timeout=100)
            assert returned == status, command.said
            return json.loads(out)
        with monkeypatch.context() as patch:
            patch.chdir(tmp_path)
            done = CliRunner().invoke(rrins, words, prog_name="rrins")
        assert done.exit_code == status, done.output
        return json.loads(done.stdout)

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
        firmware = run_without_frames(scenario, folder).firmware
        return firmware, read_errors(folder, scenario.rate_hz)

    return flyer


SHORT: dict[str, Any] = {
    "duration_s": 2,
    "seed": 3,
    "gyros": {"bias_dph": 0.1, "angle_random_walk_deg_per_sqrt_h": 0.001},
    "accelerometers": {"white_noise_ug_per_sqrt_hz": 20},
    "turntable": {
        "inner": {"acceleration_limit_dps2": 100},
        "outer": {"acceleration_limit_dps2": 100},
    },
    "firmware": {
        "alignment_s": 0.5,
        "clock_error_ppm": 50,
        "turn_rate_dps": 30,
        "stand_s": 0.3,
        "scheme": [
            {"axis": "inner", "angle_deg": 20},
            {"axis": "outer", "angle_deg": -20},
        ],
    },
}
"""The scenario of these tests: everything moves within three and a half seconds."""


def short_scenario(**changes: Any) -> Scenario:
    return Scenario.model_validate(SHORT | changes)


@pytest.fixture
def short():
    """Return a function that gives the short scenario, with changes at its top level."""
    return short_scenario


@dataclass(frozen=True)
class Recorded:
    """A recorded rehearsal."""

    path: Path
    scenario: Scenario
    firmware: Firmware
    recorder: Recorder

    @property
    def sha256(self) -> str:
        """Return the digest of its navigation."""
        return self.firmware.trace.sha256()


_channels = (f"logs{number}" for number in itertools.count())


def record_rehearsal(scenario: Scenario, path: Path, **recording: Any) -> Recorded:
    """Rehearse in lockstep on the embedded bus, and record it."""
    address = Address("rrins", next(_channels))
    note = Note(
        interface="rrins",
        channel=address.channel,
        scenario_name="short",
        scenario=scenario.model_dump(mode="json"),
        speed="max",
    )
    firmware = Firmware(firmware_settings(scenario))
    hardware = Hardware(hardware_settings(scenario), scenario_wire(scenario, is_live=True))
    port = BatchPort(address, "hardware")
    recorders: list[Recorder] = []

    def navigate() -> None:
        own = BatchPort(address, "firmware")
        run_firmware(firmware, own, scenario.firmware.clock_error_ppm)
        own.close()

    threads = [
        threading.Thread(target=navigate),
        threading.Thread(
            target=lambda: recorders.append(Recorder(path, address, True, note, **recording))
        ),
    ]
    for thread in threads:
        thread.start()
    port.meet((NAME,))
    run_hardware(hardware, port, scenario.epochs + 1)
    port.dismiss()
    port.close()
    for thread in threads:
        thread.join()
    (recorder,) = recorders
    recorder.close(60)
    add_result(path, recorder.note, firmware.trace.sha256())
    return Recorded(path, scenario, firmware, recorder)


@pytest.fixture
def rehearse():
    """Return a function that records a rehearsal of a scenario to a path."""
    return record_rehearsal


@pytest.fixture(scope="session")
def recordings(tmp_path_factory):
    """Return a function that gives the short rehearsal, recorded with an ending."""
    folder = tmp_path_factory.mktemp("recordings")
    done: dict[str, Recorded] = {}

    def recorded(ending: str = ".log") -> Recorded:
        if ending not in done:
            runtime = tempfile.mkdtemp(prefix="rrins-")  # a socket's path is short
            before = os.environ.get("XDG_RUNTIME_DIR")
            os.environ["XDG_RUNTIME_DIR"] = runtime
            try:
                done[ending] = record_rehearsal(short_scenario(), folder / f"bus{ending}")
            finally:
                shutil.rmtree(runtime)
                if before is None:
                    del os.environ["XDG_RUNTIME_DIR"]
                else:
                    os.environ["XDG_RUNTIME_DIR"] = before
        return done[ending]

    return recorded


@pytest.fixture
def copy(recordings, tmp_path):
    """Return a function that gives a copy of a recording and its note, to be spoilt."""

    def copied(ending: str = ".log", name: str = "copy") -> Path:
        recorded = recordings(ending)
        path = tmp_path / f"{name}{ending}"
        shutil.copyfile(recorded.path, path)
        write_note(path, recorded.recorder.note.model_copy(update={"parts": ()}))
        return path

    return copied


@pytest.fixture
def read():
    """Return a function that gives all of a log."""

    def reader(path: Path) -> Piece:
        pieces = list(Log(path).pieces())
        return Piece(
            np.concatenate([piece.frames for piece in pieces]),
            np.concatenate([piece.time_s for piece in pieces]),
        )

    return reader


@pytest.fixture
def write_candump():
    """Return a function that writes frames as candump does."""

    def writer(path: Path, frames: FrameArray, time_s: Any) -> None:
        rows = zip(
            np.asarray(time_s).tolist(),
            frames["can_id"].tolist(),
            frames["length"].tolist(),
            frames["data"].tolist(),
            strict=True,
        )
        path.write_text(
            "".join(
                f"({time:.6f}) vcan0 {identifier:03X}#"
                f"{word.to_bytes(8, 'little')[:length].hex().upper()}\n"
                for time, identifier, length, word in rows
            )
        )

    return writer
