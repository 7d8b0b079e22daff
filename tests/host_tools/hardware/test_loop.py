"""The hardware's shell in real time, and how it parts from the firmware."""

from __future__ import annotations

import threading
import time

import pytest

from rrins.dbc.frame import frame_array
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.port import BatchPort
from rrins.host_tools.hardware.loop import Hardware, run_realtime
from rrins.host_tools.runs.set_up.settings import hardware_settings
from rrins.host_tools.runs.sides.job import prepare_hardware
from rrins.host_tools.runs.sides.realtime import LatenessHistogram
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.testing.processes import fresh_channel


@pytest.mark.parametrize("late_s", [0.0, 0.3])
def test_a_firmware_that_is_late_at_the_end_is_heard_out(late_s):
    scenario = Scenario(duration_s=1.0)
    prepare_hardware(scenario)
    hardware = Hardware(hardware_settings(scenario))
    address = Address("rrins", fresh_channel())
    port = BatchPort(address, "hardware")
    heard = []

    def navigate():
        own = BatchPort(address, "firmware", attach_wait_s=10.0)
        frames = frame_array(64)
        for epoch in range(20):
            while not own.receive(frames, 1_000_000_000):
                pass
            heard.append(epoch)
        end = time.monotonic() + late_s
        while time.monotonic() < end:
            pass
        own.send(frames, 3, 20, 100_000_000)
        own.close()

    firmware = threading.Thread(target=navigate)
    firmware.start()
    try:
        port.meet()
        run_realtime(hardware, port, LatenessHistogram(hardware.period_ns), 20)
    finally:
        port.close()
        firmware.join()
    assert heard == list(range(20))
    assert hardware.frames_received == 3
