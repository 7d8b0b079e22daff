"""Both sides over slcan: python-can's own interface at each end of two emulated adapters."""

from __future__ import annotations

import json
from pathlib import Path

import can
import pytest

from rrins.host_tools.bridges.slcan import baud_of, line_load, too_slow
from rrins.host_tools.bus.address import Address
from rrins.host_tools.errors import BusError
from rrins.host_tools.runs.direct import run_direct
from rrins.host_tools.scenario import scenario as scenarios
from rrins.host_tools.testing.slcan import SlcanPair


@pytest.fixture
def pair():
    with SlcanPair() as opened:
        yield opened


def open_bus(port, **arguments):
    return can.Bus(
        interface="slcan", channel=port, bitrate=1_000_000, sleep_after_open=0, **arguments
    )


def test_frames_pass_from_adapter_to_adapter(pair):
    sent = [
        can.Message(arbitration_id=0x123, data=b"\x01\xab", is_extended_id=False),
        can.Message(arbitration_id=0x1ABCDEF0, data=bytes(range(8)), is_extended_id=True),
        can.Message(arbitration_id=0x7FF, is_remote_frame=True, dlc=4, is_extended_id=False),
        can.Message(arbitration_id=0, is_extended_id=False),
    ]
    with open_bus(pair.ports[0]) as one, open_bus(pair.ports[1]) as other:
        assert other.get_serial_number(5) == "EMUL"
        for sender, receiver in ((one, other), (other, one)):
            for message in sent:
                sender.send(message)
                came = receiver.recv(5)
                assert came is not None
                assert came.equals(message, timestamp_delta=None)
    assert [adapter.frames for adapter in pair.adapters] == [4, 4]
    assert [adapter.bitrate for adapter in pair.adapters] == [b"8", b"8"]


def start_both(start, scenario, pair, *options):
    bus = ("--interface", "slcan", "--bitrate", 1_000_000, *options)
    return [
        start(side, scenario, "--channel", f"{port}@2000000", *bus)
        for side, port in zip(("hardware", "firmware"), pair.ports, strict=True)
    ]


def test_lockstep_over_slcan_is_the_same_to_the_bit(start, scenario, pair):
    outcome = run_direct(scenarios.load(str(scenario), duration_s=0.5))
    plain, hardware = outcome.firmware, outcome.hardware
    both = start_both(start, scenario, pair, "--duration", 0.5, "--speed", "max", "--json")
    for side in both:
        status, out = side.finish()
        assert status == 0, side.said
    firmware = json.loads(out)
    assert firmware["navigation_sha256"] == plain["navigation_sha256"]
    assert firmware["frames_received"] == plain["frames_received"]
    hardware_adapter, firmware_adapter = pair.adapters
    assert hardware_adapter.frames == hardware["frames_sent"]
    announcements = firmware_adapter.frames - plain["frames_sent"]
    assert 1 <= announcements <= 300  # 5 a second until the hardware has started


def test_an_adapter_that_is_pulled_out_is_one_line(start, scenario):
    with SlcanPair() as pair:
        both = start_both(start, scenario, pair, "--duration", 600, "--speed", "max")
        for side in both:
            side.wait_for_line("Ctrl-C stops")
        for adapter in pair.adapters:
            adapter.wait_for_frames(500, 60)
    for side in both:
        status, _ = side.finish()
        assert status == 4, side.said
        assert [line for line in side.said if "cannot" in line] == side.said[-1:]
        assert not any("Traceback" in line for line in side.said)


def test_one_adapter_cannot_serve_both_sides(start, scenario):
    command = start("rehearse", scenario, "--interface", "slcan", "--channel", "/dev/ttyUSB0")
    assert command.finish()[0] == 4
    assert "each side needs its own adapter" in command.said[-1]


def test_a_line_too_slow_for_real_time_is_told(start, scenario, pair):
    command = start("firmware", scenario, "--interface", "slcan", "--channel", pair.ports[0])
    command.wait_for_line("200 Hz needs")
    assert command.said[-1].startswith(f"rrins: bus slcan:{pair.ports[0]}: 200 Hz needs 3")
    command.wait_for_line("Ctrl-C stops")
    command.process.terminate()
    assert command.finish()[0] == 130


def test_the_load_is_that_of_the_frames():
    scenario = scenarios.load("rimu_rotating")
    frame = 22  # t, three digits, length, sixteen digits, carriage return
    # SYNC, four groups, two axes; MODE_COMMAND, heartbeat, FAULT_COMMAND and FAULT_STATUS
    hardware_frames = 200 * 7 + 10 + 1 + 1 + 1
    # two commands; status and faults; five navigation frames; heartbeat, and others each second
    firmware_frames = 200 * 2 + 2 * 10 + 5 * 20 + 6
    hardware, firmware = line_load(scenario, "hardware"), line_load(scenario, "firmware")
    assert hardware.to_adapter == pytest.approx(hardware_frames * frame, rel=0.01)
    assert firmware.to_adapter == pytest.approx(firmware_frames * frame, rel=0.01)
    assert firmware.from_adapter == pytest.approx(
        hardware_frames * frame + 2 * firmware_frames, rel=0.01
    )
    assert hardware.baud == hardware.to_adapter * 10


@pytest.mark.parametrize(
    ("channel", "baud"),
    [
        ("/dev/ttyUSB0", 115200),
        ("/dev/ttyUSB0@921600", 921600),
        ("/dev/ttyACM0", None),
        ("/dev/ttyACM0@9600", None),
    ],
)
def test_baud_rates_of_channels(channel, baud):
    assert baud_of(channel) == baud


@pytest.mark.parametrize("baud", ["abc", "", "0", "9600x", "²"])
def test_a_baud_rate_that_is_none_is_refused(baud):
    with pytest.raises(BusError, match=f"bus slcan:X@{baud}: '{baud}' is not a baud rate; use X@"):
        baud_of(f"X@{baud}")


@pytest.mark.parametrize("speed", ["1", "max"])
def test_a_baud_rate_that_is_none_is_one_line(start, scenario, speed):
    bus = ("--interface", "slcan", "--channel", "X@abc", "--speed", speed)
    side = start("firmware", scenario, *bus)
    assert side.finish()[0] == 4
    assert side.said == ["rrins: bus slcan:X@abc: 'abc' is not a baud rate; use X@BAUD"]


def test_only_a_slow_slcan_line_is_warned_of():
    scenario = scenarios.load("rimu_rotating")
    assert too_slow(Address("slcan", "/dev/ttyUSB0@921600"), scenario, "firmware") is None
    assert too_slow(Address("slcan", "/dev/ttyACM0"), scenario, "firmware") is None
    assert too_slow(Address("socketcan", "vcan0"), scenario, "firmware") is None
    slow = scenario.model_copy(update={"rate_hz": 50})
    assert too_slow(Address("slcan", "/dev/ttyUSB0"), slow, "firmware") is None
    assert "@BAUD" in (too_slow(Address("slcan", "/dev/ttyUSB0"), scenario, "hardware") or "")


def test_no_descriptor_is_left():
    before = len(list(Path("/proc/self/fd").iterdir()))
    with SlcanPair():
        pass
    assert len(list(Path("/proc/self/fd").iterdir())) == before
