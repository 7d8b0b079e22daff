"""Faults put into hardware that runs, by frames: obeyed, reported, refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.dbc.frame import Frame, frame_array
from rrins.dbc.values import FaultRefusal
from rrins.host_tools.hardware.fault_kinds import HardwareFault
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.memory import FAULT_CAPACITY
from rrins.host_tools.hardware.settings import PlannedFault

NO_ONE, INJECT, REMOVE, CLEAR, REPORT, CYCLE = 15, 1, 2, 3, 4, 6


class Live:
    """Hardware that gets frames epoch by epoch; its reports of faults, decoded."""

    def __init__(self, tools, **changes):
        self.tools = tools
        self.hardware = Hardware(tools.settings(**changes))
        self.epoch = 0
        self.sent = {}

    def step(self, *frames):
        """Run an epoch on frames; return the messages of the report as (name, values)."""
        inbox = np.array(list(frames), dtype=Frame.dtype) if frames else frame_array(1)
        out, count = self.hardware.open_epoch(self.epoch, inbox, len(frames))
        self.epoch += 1
        decoded = [self.tools.decode(frame) for frame in out[:count]]
        self.sent = dict(decoded)
        return [(name, values) for name, values in decoded if "FAULT" in name]

    def command(self, counter=3, **raws):
        return self.tools.frame("HARDWARE_FAULT_COMMAND", counter, **raws)

    def ask(self, counter=3, **raws):
        """Send a command; return the status that answers, and the faults."""
        report = self.step(self.command(counter, **raws))
        assert report[-1][0] == "HARDWARE_FAULT_STATUS"
        assert report[-1][1]["answers"] == counter
        return report[-1][1], report[:-1]


@pytest.fixture
def live(tools):
    return Live(tools)


def test_a_fault_acts_in_the_next_epoch_and_is_reported(live):
    live.step()
    status, faults = live.ask(action=INJECT, kind=6, target=2, value=36, exponent=2)
    assert status["active_faults"] == 1
    assert status["refusal"] == FaultRefusal.NONE
    assert (status["epoch"], status["rate"]) == (1, 200)
    (active, what), (times, when) = faults
    assert (active, times) == ("HARDWARE_FAULT_ACTIVE", "HARDWARE_FAULT_TIMES")
    assert (what["number"], what["kind"], what["target"]) == (0, HardwareFault.GYRO_BIAS, 2)
    assert what["value"] * 10 ** what["exponent"] == 3600
    assert (when["number"], when["first_epoch"], when["duration_ms"]) == (0, 1, 0)
    before = live.hardware.plant[0]["gyros"]["counts"].copy()
    live.step()
    after = live.hardware.plant[0]["gyros"]["counts"]
    degrees = (after - before)[1] * 4e-9 * 180 / np.pi
    assert abs(degrees) < 1e-6  # the bias was there before already
    assert live.hardware.plant[0]["gyros"]["fault_bias_increment"][1] == pytest.approx(
        np.radians(1) / 200, rel=1e-12
    )


def test_reports_come_every_second_and_when_a_fault_ends(live):
    live.ask(action=INJECT, kind=1, target=1, duration_ms=1500)
    reports = {}
    for _ in range(500):
        report = live.step()
        if report:
            reports[live.epoch - 1] = report[-1][1]
    assert {epoch: r["active_faults"] for epoch, r in reports.items()} == {200: 1, 300: 0}
    assert {r["answers"] for r in reports.values()} == {NO_ONE}


def test_a_fault_of_the_scenario_is_reported_when_it_begins(tools):
    planned = PlannedFault(HardwareFault.ENCODER_OFFSET, 1, 5, 9, -1.25)
    live = Live(tools, faults=(planned,))
    reports = [live.step() for _ in range(12)]
    assert [k for k, report in enumerate(reports) if report] == [5, 10]
    (_, what), (_, when), _ = reports[5]
    assert what["value"] * 10.0 ** what["exponent"] == -1.25
    assert (what["target"], when["first_epoch"], when["duration_ms"]) == (2, 5, 25)


def test_an_intermittent_fault_comes_and_goes_and_is_reported_throughout(live):
    gyro_2 = {"kind": 5, "target": 2}
    live.ask(action=CYCLE, value=25, exponent=-2, duration_ms=40, **gyro_2)
    status, faults = live.ask(action=INJECT, **gyro_2)
    assert status["active_faults"] == 1
    assert [name for name, _ in faults][2] == "HARDWARE_FAULT_CYCLE"
    assert faults[0][1]["intermittent"] == 1
    assert (faults[2][1]["period_ms"], faults[2][1]["on_ms"]) == (40, 10)
    seen = []
    for _ in range(16):
        live.step()
        seen.append(int(live.hardware.plant[0]["gyros"]["stuck"]))
    assert seen == [2, 0, 0, 0, 0, 0, 0, 2, 2, 0, 0, 0, 0, 0, 0, 2]
    again, faults = live.ask(action=INJECT, **gyro_2)  # the cycle was of the first alone
    assert (again["active_faults"], len(faults)) == (1, 2)


def test_a_fault_is_taken_out_and_what_is_not_there_is_said_so(live):
    live.ask(action=INJECT, kind=5, target=1)
    live.ask(action=INJECT, kind=5, target=2)
    status, _ = live.ask(action=REMOVE, kind=5, target=3)
    assert (status["refusal"], status["active_faults"]) == (FaultRefusal.NOT_ACTIVE, 2)
    status, faults = live.ask(action=REMOVE, kind=5, target=1)
    assert (status["refusal"], status["active_faults"]) == (FaultRefusal.NONE, 1)
    assert faults[0][1]["target"] == 2
    assert live.hardware.plant[0]["gyros"]["stuck"] == 2
    status, _ = live.ask(action=CLEAR)
    assert status["active_faults"] == 0
    assert live.hardware.plant[0]["gyros"]["stuck"] == 0
    assert live.step() == []


def test_the_same_fault_again_takes_the_place_of_the_first(live):
    live.ask(action=INJECT, kind=10, target=0, value=5)
    live.step()
    status, faults = live.ask(action=INJECT, kind=10, target=0, value=7, duration_ms=20)
    assert status["active_faults"] == 1
    assert (faults[0][1]["value"], faults[1][1]["first_epoch"]) == (7, 2)
    assert faults[1][1]["duration_ms"] == 20


def test_there_is_room_for_so_many_and_no_more(tools):
    planned = tuple(PlannedFault(HardwareFault.GYRO_BIAS, 0, 10**6) for _ in range(FAULT_CAPACITY))
    live = Live(tools, faults=planned[1:])
    assert live.ask(action=INJECT, kind=1, target=1)[0]["refusal"] == FaultRefusal.NONE
    status, _ = live.ask(action=INJECT, kind=1, target=2)
    assert (status["refusal"], status["active_faults"]) == (FaultRefusal.NO_ROOM, 1)
    assert live.ask(action=INJECT, kind=1, target=1)[0]["refusal"] == FaultRefusal.NONE  # anew
    live.ask(action=REMOVE, kind=1, target=1)
    assert live.ask(action=INJECT, kind=1, target=2)[0]["refusal"] == FaultRefusal.NONE


@pytest.mark.parametrize(
    ("raws", "refusal"),
    [
        ({"action": 0}, FaultRefusal.UNKNOWN),
        ({"action": 7, "kind": 1}, FaultRefusal.UNKNOWN),
        ({"action": INJECT, "kind": 0, "target": 1}, FaultRefusal.UNKNOWN),
        ({"action": INJECT, "kind": 31, "target": 0}, FaultRefusal.NO_SUCH_TARGET),  # no receiver
        ({"action": INJECT, "kind": 1, "target": 0}, FaultRefusal.NO_SUCH_TARGET),
        ({"action": INJECT, "kind": 1, "target": 3}, FaultRefusal.NO_SUCH_TARGET),
        ({"action": INJECT, "kind": 5, "target": 5}, FaultRefusal.NO_SUCH_TARGET),
        ({"action": CYCLE, "kind": 5, "target": 5, "duration_ms": 10}, FaultRefusal.NO_SUCH_TARGET),
        ({"action": CYCLE, "kind": 5, "target": 1, "duration_ms": 10}, FaultRefusal.OUT_OF_RANGE),
        ({"action": INJECT, "kind": 2, "target": 1, "value": 61}, FaultRefusal.OUT_OF_RANGE),
        (
            {"action": INJECT, "kind": 7, "target": 1, "value": -1, "exponent": -8},
            FaultRefusal.OUT_OF_RANGE,
        ),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(live, raws, refusal):
    status, faults = live.ask(**raws)
    assert status["refusal"] == refusal
    assert (status["active_faults"], faults) == (0, [])


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(st.lists(st.integers(0, 2**52 - 1), min_size=1, max_size=40))
def test_random_commands_never_raise(tools, payloads):
    live = Live(tools)
    signals = ("action", "kind", "target", "exponent", "value", "duration_ms")
    rows = [
        tools.codec.signals[tools.codec.signal_index("HARDWARE_FAULT_COMMAND", name)]
        for name in signals
    ]
    for bits in payloads:
        word = bits << 12
        raws = {
            name: word >> int(row["shift"]) & ((1 << int(row["length"])) - 1)
            for name, row in zip(signals, rows, strict=True)
        }
        live.step(live.command(**raws))
    plant = live.hardware.plant[0]
    assert 0 <= plant["faults"]["count"] <= FAULT_CAPACITY
    assert np.isfinite(plant["axis"]["angle"]).all()
