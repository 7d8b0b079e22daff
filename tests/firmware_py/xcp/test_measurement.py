"""Lists of measured data: their values, times, shares of the bus, and masters that misbehave."""

from __future__ import annotations

import itertools
import random
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.firmware_py.core.modes.modes import Mode, ModeRequest
from rrins.firmware_py.core.settings import XcpSettings
from rrins.firmware_py.xcp.layout import by_path
from tests.firmware_py.conftest import Bench
from tests.firmware_py.xcp.conftest import Master

OK = "ff" + "00" * 7
STEPS, EPOCH = by_path()["steps"].address, by_path()["epoch"].address
START, STOP = bytes.fromhex("de010000"), bytes.fromhex("de000000")
OVERLOAD = bytes.fromhex("fd06") + bytes(6)


def started(master: Master, *ranges: tuple[int, int], **how: int) -> Master:
    master.measure(*ranges, **how)
    assert master.step([START])[0].hex() == OK
    return master


def test_values_are_of_the_epoch_in_which_they_are_sent(connected):
    started(connected, (STEPS, 7), (EPOCH, 7))
    for _ in range(20):
        first, *packets = connected.step()
        epoch = connected.bench.epoch - 1
        assert first == bytes([0]) + (5000 * epoch).to_bytes(4, "little") + bytes(3)
        numbers = [int.from_bytes(packet[1:], "little") for packet in packets]
        assert [packet[0] for packet in packets] == [1, 2]
        assert numbers == [connected.bench.state["steps"], epoch]


def test_mode_of_a_list_can_be_read_back(connected):
    connected.measure((STEPS, 4), event=1, prescaler=3, priority=9)
    assert connected.ask("df000000") == "ff10000001000309"
    assert connected.ask("de020000") == OK
    assert connected.ask("df000000") == "ff11000001000309"
    assert connected.step([b"\xdd\x01"])[0].hex() == OK
    assert connected.step([bytes.fromhex("df000000")])[0].hex() == "ff50000001000309"
    assert connected.step([b"\xfd"])[0].hex() == "ff40090000000000"
    assert connected.step([bytes.fromhex("e010000000000100")])[0].hex() == "fe11" + "00" * 6
    assert connected.step([b"\xdd\x00"])[0].hex() == OK
    assert connected.ask("d8000000") == "ff0c020100000000"
    assert connected.ask("f2fe0000") == "ff010000d8070000"


def test_entries_can_be_read_back(connected):
    connected.measure((STEPS, 4))
    connected.ask("e20000000100")
    assert connected.ask("db") == "ffff0400" + STEPS.to_bytes(4, "little").hex()
    assert connected.ask("db") == "fe29" + "00" * 6


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("d5000100", 0x29),  # before FREE_DAQ
        ("d4000000c1", 0x29),  # after ALLOC_ODT_ENTRY
        ("d30000000108", 0x29),  # again
        ("d30000000001", None),  # the first ODT is empty
        ("d30000000901", 0x22),
        ("e20000000900", 0x22),
        ("e2000000010100"[:12], 0x22),
        ("e001000000000100", 0x27),  # alternating
        ("e020000000000100", 0x27),  # without numbers
        ("e010000002000100", 0x22),  # no such event
        ("e010000000000000", 0x22),  # prescaler 0
        ("e012000000000100", 0x25),  # stimulation without the key
        ("e010010000000100", 0x22),  # no such list
        ("de030000", 0x27),
    ],
)
def test_set_up_is_refused(connected, command, code):
    connected.measure((STEPS, 4))
    answer = connected.ask(command)
    assert answer == (OK if code is None else f"fe{code:02x}" + "00" * 6)


@pytest.mark.parametrize(("entry", "code"), [("ff0800", 0x22), ("ff0000", 0x22), ("010100", 0x22)])
def test_an_entry_is_a_range_of_up_to_seven_bytes(connected, entry, code):
    connected.measure((STEPS, 4))
    connected.ask("e20000000100")
    answer = connected.ask("e1" + entry + STEPS.to_bytes(4, "little").hex())
    assert answer == f"fe{code:02x}" + "00" * 6


def test_an_entry_outside_the_memory_is_refused(connected):
    connected.measure((STEPS, 4))
    connected.ask("e20000000100")
    end = connected.bench.ram.nbytes
    assert connected.ask("e1ff0200" + (end - 1).to_bytes(4, "little").hex()) == "fe24" + "00" * 6
    assert connected.ask("e1ff0100" + (end - 1).to_bytes(4, "little").hex()) == OK


def test_a_list_that_is_not_whole_does_not_start(connected):
    connected.measure((STEPS, 4))
    connected.ask("e3000000")
    assert connected.ask("de010000") == "fe2a" + "00" * 6
    assert connected.ask("de020000") == "fe2a" + "00" * 6


def test_prescaler_and_event_of_the_second(connected):
    started(connected, (EPOCH, 4), mode=0, event=1, prescaler=2)
    epochs = []
    for _ in range(1000):
        packets = connected.step()
        epochs += [int.from_bytes(p[1:5], "little") for p in packets if p[0] == 1]
    assert [b - a for a, b in itertools.pairwise(epochs)] == [400] * (len(epochs) - 1)
    assert len(epochs) >= 2
    assert {epoch % 200 for epoch in epochs} == {0}


def test_overload_leaves_whole_samples_out_and_is_told():
    master = Master(Bench(xcp=XcpSettings(frames_hz=400)))  # two in an epoch
    master.step()
    master.connect()
    started(master, (EPOCH, 4), (STEPS, 4), (STEPS, 7))
    packets = [packet for _ in range(400) for packet in master.step()]
    told = [packet for packet in packets if packet == OVERLOAD]
    data = [packet for packet in packets if packet[0] < 0xC0]
    assert 1 <= len(told) <= 3
    data = data[[packet[0] for packet in data].index(0) :]
    assert [packet[0] for packet in data[:40]] == [0, 1, 2, 3] * 10
    pairs = zip(data[1::4], data[2::4], strict=False)
    assert all(
        int.from_bytes(a[1:5], "little") + 1 == int.from_bytes(b[1:5], "little") for a, b in pairs
    )
    assert master.xcp.summary()["overloads"] > 100


def test_lists_of_higher_priority_leave_first():
    master = Master(Bench(xcp=XcpSettings(frames_hz=400)))
    master.step()
    master.connect()
    for command in ("d6", "d5000200", "d400000002", "d400010002", "d30000000001", "d30000000101",
                    "d30001000001", "d30001000101"):  # fmt: skip
        assert master.ask(command) == OK
    for number in (0, 1):
        for odt in (0, 1):
            master.ask(f"e200{number:02x}00{odt:02x}00")
            master.ask("e1ff0100" + EPOCH.to_bytes(4, "little").hex())
        assert master.ask(f"e000{number:02x}00000001{number:02x}") == OK
        master.ask(f"de02{number:02x}00")
    master.step([b"\xdd\x01"])
    numbers = [p[0] for _ in range(20) for p in master.step() if p[0] < 0xC0]
    assert set(numbers[2:]) == {2, 3}


def test_a_master_that_vanishes_is_replaced_by_the_next(connected):
    started(connected, (STEPS, 4))
    connected.bench.run(400)
    answer, *data = connected.step([b"\xff\x00"])
    assert answer.hex() == "ff0dc00808000101"
    assert len(data) == 2
    assert connected.step([b"\xd6"])[0].hex() == OK
    assert connected.step() == []
    assert not connected.bench.firmware.is_awake


def test_two_masters_are_both_answered_in_order(connected):
    steps = STEPS.to_bytes(4, "little").hex()
    answers = connected.ask("f4080000" + steps, "fd", "f4040000" + steps, "ff00").split()
    assert [answer[:4] for answer in answers] == ["fe22", "ff00", "ff" + answers[2][2:4], "ff0d"]


def test_nothing_is_awake_once_nobody_measures(connected):
    assert not connected.bench.firmware.is_awake
    started(connected, (STEPS, 4))
    assert connected.bench.firmware.is_awake
    connected.step([STOP])
    assert not connected.bench.firmware.is_awake


def test_without_the_table_xcp_is_somebody_elses():
    bench = Bench()
    assert bench.firmware.xcp is None
    from tests.firmware_py.xcp.conftest import xcp_frame

    out = bench.step([xcp_frame(b"\xff\x00"), *bench.frames()])
    assert not [frame for frame in out if frame["can_id"] == 0x7D8]
    assert bench.state["diagnostics"]["attention"] == 0


def output_of(bench: Bench, change=lambda frames: frames, epochs: int = 300) -> bytes:
    bench.run(210)
    bench.step(change(bench.frames(request=int(ModeRequest.NAVIGATE_STRAPDOWN))))
    bench.run(epochs, change)
    assert bench.mode == Mode.NAVIGATION_STRAPDOWN
    return bench.ram["navigation"].tobytes()


def fuzzed(count: int, seed: int):
    from tests.firmware_py.xcp.conftest import xcp_frame

    random_bytes = random.Random(seed)
    codes = [0xFF, *range(0xC0, 0x100), *range(0, 16)]

    def change(frames):
        packets = [
            bytes([random_bytes.choice(codes)]) + random_bytes.randbytes(random_bytes.randrange(8))
            for _ in range(count)
        ]
        return [*map(xcp_frame, packets), *frames]

    return change


def test_nonsense_has_no_effect_on_the_navigation():
    plain = output_of(Bench())
    assert output_of(Bench(xcp=XcpSettings()), fuzzed(20, seed=1)) == plain


@pytest.mark.soak
def test_a_hundred_thousand_commands_of_nonsense_have_no_effect_on_the_navigation():
    plain = output_of(Bench(), epochs=1700)
    bench = Bench(xcp=XcpSettings())
    assert output_of(bench, fuzzed(60, seed=2), epochs=1700) == plain
    assert bench.firmware.xcp is not None


@settings(max_examples=50, deadline=None)
@given(st.lists(st.binary(min_size=1, max_size=8), max_size=40))
def test_any_packets_are_answered_or_dropped(packets):
    bench = Bench(xcp=XcpSettings())
    master = Master(bench)
    for packet in (b"\xff\x00", *packets):
        for answer in master.step([packet]):
            assert len(answer) == 8


def test_stimulation_replaces_one_gyro_for_the_epoch_it_comes_in(unlocked):
    address = by_path()["assembly.gyro_dtheta"].address + 2 * 8
    unlocked.measure((address, 7), (address + 7, 1), mode=0x02)
    assert unlocked.step([START])[0].hex() == OK
    increments = unlocked.bench.state["assembly"]["gyro_dtheta"]
    own = float(increments[2])
    data = struct.pack("<d", 1e-5)
    packets = [b"\0", b"\1" + data[:7], b"\2" + data[7:]]
    for _ in range(3):
        assert unlocked.step(packets) == []
        assert increments[2] == 1e-5
    others = np.delete(increments[:4], 2)
    assert not np.any(others == 1e-5)
    assert unlocked.step()[0].hex() == "fd09" + "00" * 6
    assert unlocked.lengths == [6]  # with the number of the event channel
    assert increments[2] == pytest.approx(own, abs=1e-6)
    assert unlocked.step(packets[:2]) == []
    assert increments[2] != 1e-5
    assert unlocked.step(packets[2:]) == []
    assert increments[2] == 1e-5
    assert unlocked.xcp.summary()["stimulated_epochs"] == 4


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1.0])
def test_an_increment_that_no_sensor_could_have_sent_is_not_used(unlocked, value):
    address = by_path()["assembly.gyro_dtheta"].address
    unlocked.measure((address, 7), (address + 7, 1), mode=0x02)
    unlocked.step([START])
    data = struct.pack("<d", value)
    unlocked.step([b"\0", b"\1" + data[:7], b"\2" + data[7:]])
    assert unlocked.bench.state["assembly"]["gyro_dtheta"][0] != value
    assert unlocked.xcp.summary()["stimulations_refused"] == 1


@pytest.mark.parametrize("ranges", [[(STEPS, 4)], [(by_path()["assembly.gyro_dtheta"].address, 4)]])
def test_only_whole_increments_can_be_stimulated(unlocked, ranges):
    unlocked.measure(*ranges, mode=0x02)
    assert unlocked.ask("de010000") == "fe24" + "00" * 6
