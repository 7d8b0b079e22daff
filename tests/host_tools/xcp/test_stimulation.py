"""Stimulation over the bus: a gyro's increments replaced by those of a recording."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from rrins.compiled.record import Floats
from rrins.firmware_py.loop import Firmware
from rrins.firmware_py.xcp.layout import by_path
from rrins.firmware_py.xcp.protocol import Resource
from rrins.host_tools.scenario.scenario import Scenario, load
from tests.host_tools.xcp.conftest import Sides

GYRO = 2  # the third
DURATION_S = 60.0
BIAS_DPH = 100.0
SCENARIO = load("rimu_rotating").varied(duration_s=DURATION_S)
FAULT = {"kind": "gyro_bias", "sensor": GYRO + 1, "at_s": 20.0, "bias_dph": BIAS_DPH}


def recorded(scenario: Scenario) -> tuple[Firmware, Floats]:
    """Return the firmware after a run, and the gyro's increments in it, by epoch."""
    sides = Sides(scenario)
    increments = np.zeros(sides.epochs)
    for epoch in range(sides.epochs):
        sides.step([])
        increments[epoch] = sides.sent_by_gyro(GYRO)
    return sides.firmware, increments


def set_up() -> list[bytes]:
    """Return the commands that begin a list for the gyro's increments."""
    address = by_path()["assembly.gyro_dtheta"].address + 8 * GYRO
    places = [(address, 7), (address + 7, 1)]
    commands = ["d6", "d5000100", "d400000002", "d30000000001", "d30000000101"]
    for odt, (begin, size) in enumerate(places):
        commands.append(f"e2000000{odt:02x}00")
        commands.append(f"e1ff{size:02x}00" + begin.to_bytes(4, "little").hex())
    return [bytes.fromhex(one) for one in (*commands, "e002000000000100", "de010000")]


@pytest.fixture(scope="module")
def with_fault() -> tuple[Firmware, Floats]:
    return recorded(SCENARIO.varied(faults=[FAULT]))


def test_increments_of_a_recording_act_as_if_the_sensor_had_sent_them(with_fault):
    faulty, increments = with_fault
    sides = Sides(SCENARIO.varied(xcp={}))
    xcp = sides.firmware.xcp
    assert xcp is not None
    sides.step([b"\xff\0"])
    xcp.session.unlocked = int(Resource.STIM)
    for command in set_up():
        sides.step([command])
    begun = sides.hardware.epoch
    for epoch in range(begun, sides.epochs):
        data = struct.pack("<d", increments[epoch])
        sides.step([b"\0" + data[:7], b"\1" + data[7:]])
    assert xcp.summary()["stimulated_epochs"] == sides.epochs - begun
    found, expected = (one.ram[0].redundancy.gyros for one in (sides.firmware, faulty))
    assert int(found.excluded) == int(expected.excluded) == 1 << GYRO
    navigation = sides.firmware.ram["navigation"].tobytes()
    assert navigation == faulty.ram["navigation"].tobytes()
