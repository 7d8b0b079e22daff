"""Faults put on the wire of a run by frames: obeyed, reported, refused."""

from __future__ import annotations

import cantools.database
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.dbc.codec import load, pack
from rrins.dbc.contract import load_contract
from rrins.dbc.e2e import fill
from rrins.dbc.frame import frame_array
from rrins.dbc.values import FaultAction, FaultRefusal
from rrins.host_tools.wire.fault_kinds import FaultKind
from rrins.host_tools.wire.faults import CAPACITY
from rrins.host_tools.wire.wire import Wire

PERIOD_NS = 5_000_000
ANY = 4095
DROP, DELAY, CORRUPT, BABBLE = (
    FaultKind.DROP,
    FaultKind.DELAY,
    FaultKind.CORRUPT,
    FaultKind.BABBLE,
)


def command(counter=3, **raws):
    layout = load_contract()[0]["fault_command"]
    word = np.uint64(0)
    for name, raw in raws.items():
        word = np.uint64(pack(word, layout[name], np.int64(raw)))
    frames = frame_array(1)
    fill(frames[0], layout["message"], word, counter)
    return frames[0]


class Live:
    """A wire with a frame of the hardware in each epoch."""

    def __init__(self, bitrate=None):
        self.wire = Wire(PERIOD_NS, (), 1, bitrate)
        self.epoch = 0
        self.others = 0

    def step(self, *commands):
        """Run an epoch on commands of the one before; return the report, decoded."""
        down = frame_array(max(1, len(commands)))
        for k, frame in enumerate(commands):
            down[k] = frame
        if self.epoch:
            self.wire.down(down, len(commands), self.epoch - 1)
        up = frame_array(1)
        up["can_id"], up["length"], up["data"] = 0x40, 8, self.epoch
        frames, count = self.wire.up(up, 1, self.epoch)
        self.epoch += 1
        report = []
        self.others = 0
        for frame in frames[:count]:
            if not 0x7F0 <= frame["can_id"] <= 0x7FF:  # also the controller's error frames
                self.others += int(frame["can_id"] == 0x40)
                continue
            message = load().database.get_message_by_frame_id(int(frame["can_id"]))
            assert isinstance(message, cantools.database.Message)
            payload = int(frame["data"]).to_bytes(8, "little")
            report.append((message.name, message.decode(payload, decode_choices=False)))
        return report

    def ask(self, counter=3, **raws):
        report = self.step(command(counter, **raws))
        assert (report[-1][0], report[-1][1]["answers"]) == ("FAULT_STATUS", counter)
        return report[-1][1], report[:-1]


@pytest.fixture
def live():
    live = Live()
    assert live.step() == []
    return live


def inject(kind, **raws):
    return {"action": FaultAction.INJECT, "kind": kind, "identifier": ANY} | raws


def test_a_fault_is_reported_with_all_that_it_is(live):
    status, faults = live.ask(**inject(DELAY, node=2, identifier=0x40, parameter=20))
    assert status["active_kinds"] == 1 << DELAY
    (_, what), (_, when) = faults
    assert (what["kind"], what["node"], what["identifier"]) == (DELAY, 2, 0x40)
    assert (what["parameter"], what["probability"]) == (20, 1.0)
    assert (when["first_epoch"], when["duration_ms"]) == (1, 0)
    assert live.others == 0
    live.step(), live.step(), live.step(), live.step()
    assert live.others == 1  # four epochs late


def test_a_share_is_said_before_and_holds_for_one_fault(live):
    meant = {"kind": DROP, "identifier": 0x40}
    live.step(
        command(1, action=FaultAction.SHARE, parameter=2500, **meant),
        command(2, action=FaultAction.INJECT, **meant),
    )
    passed = sum(live.step() is not None and live.others for _ in range(400))
    assert passed == pytest.approx(300, abs=40)
    _, faults = live.ask(action=FaultAction.REPORT)
    assert faults[0][1]["probability"] == 0.25
    live.ask(action=FaultAction.REMOVE, **meant)
    _, faults = live.ask(action=FaultAction.INJECT, **meant)
    assert faults[0][1]["probability"] == 1


def test_reports_come_every_second_and_when_a_fault_ends(live):
    live.ask(**inject(DROP, duration_ms=1500))
    reports = {}
    for _ in range(500):
        report = live.step()
        if report:
            reports[live.epoch - 1] = report[-1][1]["active_faults"]
    assert reports == {201: 1, 301: 0}


@pytest.mark.parametrize(
    ("raws", "refusal"),
    [
        ({"action": 0}, FaultRefusal.UNKNOWN),
        ({"action": 9, "kind": DROP}, FaultRefusal.UNKNOWN),
        (inject(0), FaultRefusal.UNKNOWN),
        (inject(14), FaultRefusal.UNKNOWN),
        (inject(DROP, node=3), FaultRefusal.NO_SUCH_TARGET),
        (inject(DROP, identifier=2048), FaultRefusal.NO_SUCH_TARGET),
        (inject(CORRUPT, parameter=65), FaultRefusal.OUT_OF_RANGE),
        (inject(BABBLE, parameter=201), FaultRefusal.OUT_OF_RANGE),
        ({"action": FaultAction.SHARE, "kind": DROP}, FaultRefusal.OUT_OF_RANGE),
        ({"action": FaultAction.REMOVE, "kind": DROP}, FaultRefusal.NOT_ACTIVE),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(live, raws, refusal):
    status, faults = live.ask(**raws)
    assert status["refusal"] == refusal
    assert (status["active_faults"], faults) == (0, [])


def test_there_is_room_for_so_many_and_no_more(live):
    live.step(*(command(**inject(DROP, identifier=0x100 + k)) for k in range(CAPACITY)))
    status, faults = live.ask(**inject(DROP, identifier=5))
    assert (status["refusal"], status["active_faults"]) == (FaultRefusal.NO_ROOM, CAPACITY)
    assert len(faults) == 2 * CAPACITY
    status, _ = live.ask(**inject(DROP, identifier=0x100, duration_ms=100))
    assert (status["refusal"], status["active_faults"]) == (FaultRefusal.NONE, CAPACITY)


@pytest.mark.slow
@pytest.mark.parametrize("bitrate", [None, 1_000_000])
def test_a_bus_that_is_cut_can_be_mended(bitrate):
    live = Live(bitrate)
    live.step()
    live.ask(**inject(FaultKind.CUT))
    assert live.others == 0
    status, _ = live.ask(action=FaultAction.CLEAR)
    assert status["active_faults"] == 0
    live.step()
    assert live.others


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.tuples(*(st.integers(0, 2**n - 1) for n in (4, 4, 2, 12, 16, 14))), max_size=30),
    st.sampled_from([None, 1_000_000]),
)
def test_random_commands_never_raise(commands, bitrate):
    live = Live(bitrate)
    live.step()
    names = ("action", "kind", "node", "identifier", "duration_ms", "parameter")
    for raws in commands:
        live.step(command(**dict(zip(names, raws, strict=True))))
    live.ask(action=FaultAction.CLEAR)
