"""Two sides that exchange epochs in compiled code, and guests who come to them in the middle."""

from __future__ import annotations

import threading

import can
import pytest

from rrins.dbc import direct
from rrins.dbc.codec import load
from rrins.dbc.frame import frame_array
from rrins.firmware_py.loop import Firmware
from rrins.firmware_py.loop import run_lockstep as run_firmware
from rrins.host_tools.bus import datagram
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.port import BatchPort
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.loop import run_lockstep as run_hardware
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    hardware_settings,
    scenario_wire,
)

pytestmark = pytest.mark.skipif(not direct.AVAILABLE, reason="nothing is compiled")

EVERY, FIRST, LAST = 25, 200, 400


class CountingPort(BatchPort):
    """A port that counts the epochs that Python sends."""

    sent = 0

    def send(self, *arguments):
        self.sent += 1
        super().send(*arguments)


def rehearse(channel, scenario, guest=None, until=None):
    """Rehearse in two threads, and a guest in a third from `FIRST` on; return what took part.

    The run stands still at `FIRST` until the guest has come and set `until`, if there is one.
    """
    address = Address("rrins", channel)
    firmware = Firmware(firmware_settings(scenario))
    hardware = Hardware(hardware_settings(scenario), scenario_wire(scenario, is_live=True))
    port = CountingPort(address, "hardware")
    threads = []

    def begin(run):
        threads.append(threading.Thread(target=run))
        threads[-1].start()

    def navigate():
        own = BatchPort(address, "firmware")
        run_firmware(firmware, own, scenario.firmware.clock_error_ppm)
        own.close()

    def on_epoch(epoch):
        if epoch == FIRST and guest is not None:
            begin(lambda: guest(port))
            port.meet(("guest",))
            assert until is None or until.wait(60.0)

    begin(navigate)
    try:
        port.meet()
        run_hardware(hardware, port, scenario.epochs + 1, None, EVERY, on_epoch)
        port.dismiss()
    finally:
        port.close()
        for thread in threads:
            thread.join()
    return firmware, hardware, port


def test_undisturbed_sides_do_without_python(short):
    epochs = short().epochs + 1
    firmware, hardware, port = rehearse("alone", short())
    assert port.sent < epochs / 20
    assert firmware.is_shut_down
    assert firmware.epoch == hardware.epoch - 1 == epochs - 1
    assert hardware.frames_received == firmware.frames_sent
    assert firmware.frames_received == hardware.frames_sent


def test_a_guest_in_the_middle_sees_every_epoch_and_changes_nothing(short):
    seen = {"hardware": [], "firmware": []}

    def watch(port):
        frames = frame_array(64)
        with can.Bus("guest", interface="rrins", host="never", name="guest") as bus:
            while batch := bus.recv_batch(frames, 60.0):
                if batch.closes_epoch:
                    side = "hardware" if batch.sender == datagram.HOST else "firmware"
                    seen[side].append((batch.epoch, batch.time_ns))
                if batch.epoch >= LAST:
                    break

    firmware, _, port = rehearse("guest", short(), watch)
    assert [epoch for epoch, _ in seen["hardware"]] == list(range(FIRST + 1, LAST + 1))
    answered = [epoch for epoch, _ in seen["firmware"] if epoch > FIRST]  # that one may come before
    assert answered == list(range(FIRST + 1, LAST))
    assert all(time_ns == epoch * 5_000_000 for epoch, time_ns in seen["hardware"])
    assert port.sent < short().epochs / 20 + 50  # on its own, with a guest as well
    without, _, _ = rehearse("without", short())
    assert firmware.trace.sha256() == without.trace.sha256()
    assert firmware.trace.epochs > 0


def test_what_a_guest_sends_reaches_the_firmware_in_the_time_of_the_run(short):
    answers = []
    asked = threading.Event()

    def ask(port):
        tester = {"arbitration_id": load().frame_id("DIAG_REQUEST"), "is_extended_id": False}
        with can.Bus("asks", interface="rrins", host="never", name="guest") as bus:
            bus.send(can.Message(data=bytes([2, 0x3E, 0, 0, 0, 0, 0, 0]), **tester))
            asked.set()
            response = load().frame_id("DIAG_RESPONSE")
            while message := bus.recv(60.0):
                if message.arbitration_id == response:
                    answers.append(message)
                    return

    firmware, _, _ = rehearse("asks", short(), ask, asked)
    (answer,) = answers
    assert bytes(answer.data[:3]) == bytes([2, 0x7E, 0])
    asked_s = FIRST * 0.005
    assert asked_s < answer.timestamp < asked_s + EVERY * 0.005
    assert firmware.is_shut_down
