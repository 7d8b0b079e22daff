"""The thread on the bus: it takes all that comes, and says how the bus ended."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import can
import pytest

from rrins.dbc.direct import AVAILABLE
from rrins.dbc.frame import frame_array
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.errors import BusError
from rrins.host_tools.monitor import receiver as receiver_module
from rrins.host_tools.monitor.banner import notices
from rrins.host_tools.monitor.once import as_dict
from rrins.host_tools.monitor.receiver import NAME, Receiver
from rrins.host_tools.monitor.watch import Watch
from rrins.host_tools.testing.recording import Contract

CHANNEL = "watched"
ADDRESS = Address("rrins", CHANNEL)
SYNC = Contract().encode("SYNC", {}, 0)


class NotedWatch(Watch):
    """A watch that a test can wait for, and hold up."""

    def __init__(self, **options):
        super().__init__(**options)
        self.waiting = 0
        self.open = threading.Event()
        self.open.set()
        self._changed = threading.Condition()

    def add_frames(self, frames, count, time_ns):
        self.open.wait()
        super().add_frames(frames, count, time_ns)
        self._notify()

    def add_waiting(self, lent, words, frames):
        self.open.wait()
        batches = super().add_waiting(lent, words, frames)
        self.waiting += batches
        self._notify()
        return batches

    def end(self, reason):
        super().end(reason)
        self._notify()

    def count_gap(self):
        super().count_gap()
        self._notify()

    def note_refused(self, refused):
        super().note_refused(refused)
        self._notify()

    def _notify(self):
        with self._changed:
            self._changed.notify_all()

    def wait_for(self, what):
        """Wait until something holds of the state."""
        with self._changed:
            assert self._changed.wait_for(lambda: what(self.state()), 20.0)


@pytest.fixture
def watch():
    return NotedWatch()


@pytest.fixture
def host():
    with RrinsBus(CHANNEL, host="here", queue_limit=64 * 1024) as bus:
        yield bus


@pytest.fixture
def attach():
    """Attach a receiver to a host of this process, which has to answer meanwhile."""
    attached = []
    with ThreadPoolExecutor(1) as pool:

        def attach_to(host, watch):
            coming = pool.submit(Receiver, ADDRESS, watch)
            host.wait_for(NAME, 10.0)
            attached.append(coming.result())
            return attached[-1]

        yield attach_to
        for receiver in attached:
            receiver.close()


def batch(first, count):
    frames = frame_array(count)
    frames[:] = SYNC[0]
    return {"frames": frames, "count": count, "epoch": first, "time_ns": first * 5_000_000}


def test_it_takes_every_frame_with_its_bus_time(host, watch, attach):
    attach(host, watch)
    for epoch in range(500):
        host.send_batch(**batch(epoch, 1 + epoch % 3))
    watch.wait_for(lambda state: state.time_s == 499 * 0.005)
    assert watch.state().frames == sum(1 + epoch % 3 for epoch in range(500))
    assert watch.state().times.gaps == 0


def test_compiled_code_takes_the_same_as_python(host, attach, monkeypatch):
    watches = []
    for is_compiled in (True, False):
        monkeypatch.setattr(receiver_module, "AVAILABLE", is_compiled and AVAILABLE)
        watch = NotedWatch()
        receiver = attach(host, watch)
        for epoch in range(300):
            host.send_batch(**batch(epoch, epoch % 4))
        watch.wait_for(lambda state: state.time_s == 299 * 0.005)
        receiver.close()
        watches.append(watch)
    compiled, python = (watch.memory() for watch in watches)
    assert compiled.tobytes() == python.tobytes()
    assert watches[0].waiting > 0 or not AVAILABLE  # batches that no call of Python has taken
    assert watches[1].waiting == 0


def test_it_says_why_the_bus_ended(host, watch, attach, monkeypatch):
    monkeypatch.setattr(receiver_module, "_ASK_S", 0.0)  # of a bus that has ended by then, too
    receiver = attach(host, watch)
    watch.open.clear()
    host.send_batch(**batch(7, 1))
    host.send_batch(**batch(8, 2))
    host.shutdown()
    watch.open.set()
    watch.wait_for(lambda state: state.times.ended is not None)
    state = watch.state()
    assert state.frames == 3, "what came before the end is there"
    assert "has closed it" in state.times.ended
    receiver.close()


def test_it_attaches_again_when_it_was_cut_off(host, watch, attach):
    attach(host, watch)
    watch.open.clear()
    many = batch(1, 4000)
    for _ in range(400):  # 26 MB: more than the kernel and the queue take
        host.send_batch(**many)
    watch.open.set()
    deadline = time.monotonic() + 120.0
    while not watch.state().times.gaps:
        assert time.monotonic() < deadline
        host.send_batch(**batch(2, 1))  # a host answers while it sends
        host.recv(0.01)
    host.send_batch(**batch(1000, 1))
    watch.wait_for(lambda state: state.time_s == 5.0)
    assert watch.state().times.gaps == 1
    assert watch.state().times.ended is None
    assert watch.state().frames < 400 * 4000


def test_any_interface_of_python_can():
    watch = NotedWatch(is_wall_time=True)
    receiver = Receiver(Address("virtual", CHANNEL), watch)
    with can.Bus(interface="virtual", channel=CHANNEL) as bus:
        for counter in range(20):
            bus.send(can.Message(arbitration_id=0x555, is_extended_id=False, data=[counter]))
        bus.send(can.Message(arbitration_id=0x1, is_fd=True, data=bytes(12)))
        bus.send(can.Message(arbitration_id=0x556, is_extended_id=False, data=[1]))
        watch.wait_for(lambda state: len(state.messages) == 2)
    receiver.close()
    state = watch.state()
    assert [(m.identifier, m.count, m.data) for m in state.messages] == [
        (0x555, 20, b"\x13"),
        (0x556, 1, b"\x01"),
    ]
    assert abs(state.time_s - time.time()) < 60
    assert state.times.speed is None


def test_a_bus_that_is_not_there(watch):
    with pytest.raises(BusError, match="not running"):
        Receiver(ADDRESS, watch)


def test_it_shows_what_the_host_has_not_delivered(watch, attach):
    with RrinsBus(CHANNEL, host="here", name="hardware") as host:
        attach(host, watch)
        with ThreadPoolExecutor(1) as pool:
            coming = pool.submit(RrinsBus, CHANNEL, host="never", name="other")
            host.wait_for("other", 10.0)
            with coming.result() as other:
                other.send_batch(SYNC, 1)
                deadline = time.monotonic() + 120.0
                while not watch.state().times.refused.frames:
                    assert time.monotonic() < deadline
                    host.recv(0.05)
        (notice,) = (n for n in notices(watch.state(), False) if "NOT DELIVERED" in n)
        assert notice.startswith("1 FRAMES NOT DELIVERED: node 'other' (process ")
        assert as_dict(CHANNEL, watch.state())["refused_frames"] == 1
        assert watch.state().frames == 0
