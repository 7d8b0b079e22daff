"""A rehearsal in lockstep that goes on by itself, for clients of its bus."""

from __future__ import annotations

import contextlib
import tempfile
import threading

import pytest

from rrins.host_tools.bus.address import EMBEDDED, Address
from rrins.host_tools.hardware.fault_kinds import AIDS
from rrins.host_tools.injection.client import FaultClient
from rrins.host_tools.testing.bench import Bench
from rrins.host_tools.testing.scenarios import prepare_scenario

QUICK = {
    "duration_s": 1000,
    "firmware": {"alignment_s": 0.5, "height_channel": "damped"},
    **{aid: {} for aid in AIDS},
}


class World:
    """A bench in lockstep; `going` lets its time pass in a thread."""

    def __init__(self, bench, channel):
        self.bench = bench
        self.address = Address(EMBEDDED, channel)

    @contextlib.contextmanager
    def going(self):
        stop = threading.Event()

        def go():
            while not stop.is_set():
                self.bench.advance(0.005)
                stop.wait(0.0005)

        thread = threading.Thread(target=go)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()

    @contextlib.contextmanager
    def client(self):
        """A client on the bus, while time passes."""
        with self.going(), FaultClient(self.address) as client:
            yield client


@pytest.fixture(scope="module")
def rehearsal(tmp_path_factory):
    """A rehearsal that navigates; the tests of a file share it, and its process ends with them."""
    folder = tmp_path_factory.mktemp("world")
    file = folder / "scenario.toml"
    scenario = prepare_scenario(QUICK, {}, file, folder)
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory() as runtime:
        patch.setenv("XDG_RUNTIME_DIR", runtime)
        bench = Bench(scenario, file, "lockstep")
        try:
            bench.expect("FIRMWARE_STATUS", within=3, where={"mode": "NAVIGATION_ROTATING"})
            yield World(bench, f"{runtime}/rrins/{bench.channel}.sock")
        finally:
            bench.close()


@pytest.fixture
def world(rehearsal):
    """The rehearsal without any fault."""
    rehearsal.bench.clear_faults()
    rehearsal.bench.advance(0.1)
    return rehearsal
