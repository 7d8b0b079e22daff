"""Buses in virtual time: frames that a test makes, and frames of a rehearsal."""

from __future__ import annotations

from dataclasses import dataclass, field

import can
import pytest

from rrins.dbc.frame import frame_array
from rrins.host_tools.bus.port import frame_of_message
from rrins.host_tools.monitor.watch import Watch
from rrins.host_tools.testing.recording import Contract

CONTRACT = Contract()


@dataclass
class Clock:
    """A clock on the wall that a test sets."""

    now_ns: int = 0

    def __call__(self):
        return self.now_ns


@dataclass
class Played:
    """A watch, and the bus that a test plays to it; the wall's clock goes with bus time."""

    is_wall_time: bool = False
    bitrate: int | None = None
    clock: Clock = field(default_factory=Clock)

    def __post_init__(self):
        self.watch = Watch(self.bitrate, self.is_wall_time, clock=self.clock)

    def send(self, message, time_s, counter=0, **values):
        """Send a frame of a message of the DBC."""
        self.put(CONTRACT.encode(message, values, counter), time_s)

    def put(self, frames, time_s):
        self.clock.now_ns = round(time_s * 1e9)
        self.watch.add_frames(frames, len(frames), round(time_s * 1e9))

    def put_message(self, message, time_s=None):
        frames = frame_array(1)
        frame_of_message(frames[0], message)
        self.put(frames, message.timestamp if time_s is None else time_s)

    def replay(self, path, look_every_s=None):
        """Play a log; the state is looked at now and then, as by a screen."""
        next_s = look_every_s
        for message in can.LogReader(path):
            if next_s is not None and message.timestamp >= next_s:
                self.watch.state()
                next_s += look_every_s
            self.put_message(message)
        return self.watch.state()


@pytest.fixture(scope="session")
def play():
    """Make a bus that the test plays."""
    return Played


@pytest.fixture
def played():
    return Played()


@pytest.fixture
def rehearsed(rrins_bench, tmp_path):
    """Run a rehearsal by a function; return what a watch makes of its bus, as a `Played`."""

    def run(drive, scenario="rimu_rotating", **overrides):
        bench = rrins_bench(scenario, way="direct", **overrides)
        drive(bench)
        log = tmp_path / "bus.log"
        bench.write_log(log)
        bus = Played()
        bus.state = bus.replay(log, look_every_s=0.25)
        return bus

    return run
