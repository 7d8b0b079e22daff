"""Benches with processes, buses and sides: they work, they end, and what dies is named."""

from __future__ import annotations

import os
import signal

import can
import pytest

from rrins.dbc.codec import load
from rrins.host_tools.testing.errors import BenchError

QUICK = {"duration_s": 60, "firmware": {"alignment_s": 0.5}}


def test_a_bus_of_its_own(rrins_bus, rrins_channel):
    with can.Bus(interface="rrins", channel=rrins_channel, host="never") as other:
        other.send(can.Message(arbitration_id=0x123, is_extended_id=False, data=b"hello"))
        assert rrins_bus.recv(5).data == b"hello"


@pytest.mark.rrins_scenario(QUICK, seed=2)
def test_a_firmware_whose_hardware_is_the_test(rrins_firmware):
    assert rrins_firmware.scenario.seed == 2
    bus = rrins_firmware.bus
    rrins_firmware.advance(0.5)
    seen = [message.arbitration_id for message in iter(lambda: bus.recv(0), None)]
    assert seen.count(load().frame_id("SYNC")) == 100
    assert seen.count(load().frame_id("AXIS_OUTER_COMMAND")) == 100
    command = can.Message(arbitration_id=0x7A2, is_extended_id=False, data=b"x")
    bus.send(command)  # by somebody else on the bus: recorded, and in a log
    rrins_firmware.advance(0.1)
    assert rrins_firmware.process.poll() is None
    assert rrins_firmware.mode == "STANDBY"
    bus.recv(0)


def test_the_test_keeps_its_processors(rrins_bench):
    before = os.sched_getaffinity(0)
    bench = rrins_bench(QUICK, way="lockstep")
    bench.advance(0.1)
    bench.close()
    assert os.sched_getaffinity(0) == before
    assert bench.process.poll() is not None
    bench.close()


def test_a_firmware_that_died_is_named(rrins_bench):
    bench = rrins_bench(QUICK, way="lockstep")
    bench.advance(0.1)
    bench.process.kill()
    with pytest.raises(
        BenchError, match=rf"firmware process {bench.process.pid} was killed by SIGKILL"
    ):
        bench.advance(1)
    with pytest.raises(BenchError, match="SIGKILL"):
        bench.advance(1)


def test_a_firmware_that_died_unnoticed_is_an_error_at_the_end(rrins_bench):
    bench = rrins_bench(QUICK, way="lockstep")
    bench.process.kill()
    with pytest.raises(BenchError, match=r"SIGKILL \(status -9\)"):
        bench.close()


def test_a_firmware_that_is_stopped_is_not_waited_for_for_ever(rrins_bench, pytestconfig):
    patience = pytestconfig.option.rrins_patience
    pytestconfig.option.rrins_patience = 0.5
    try:
        bench = rrins_bench(QUICK, way="lockstep")
    finally:
        pytestconfig.option.rrins_patience = patience
    bench.process.send_signal(signal.SIGSTOP)
    with pytest.raises(BenchError, match=r"has been silent for 0\.5 s"):
        bench.advance(1)


def test_real_time_is_the_clock_on_the_wall(rrins_bench):
    bench = rrins_bench(QUICK, way="realtime", navigate_at_s=0.5)
    bench.expect("FIRMWARE_STATUS", within=30, where={"mode": "NAVIGATION_ROTATING"})
    start_s = bench.time_s
    bench.advance(0.3)
    assert bench.time_s >= round(start_s + 0.3, 6)
    bench.inject("drop", message="SENSOR_4")
    bench.expect("FIRMWARE_STATUS", within=30, where={"usable_sensors": 3})
    bench.inject("gyro_absent", sensor=2)
    values = bench.expect("HARDWARE_FAULT_ACTIVE", within=30, where={"kind": "GYRO_ABSENT"})
    assert values["target"] == 2
    bench.expect("SENSOR_2", within=30, where={"status": "GYRO_ABSENT"})
    bench.remove_fault("gyro_absent", sensor=2)
    bench.expect("SENSOR_2", within=30, where={"status": "OK"})
    bench.inject("encoder_stuck", axis="outer")
    bench.expect("HARDWARE_FAULT_ACTIVE", within=30, where={"kind": "ENCODER_STUCK"})
    bench.clear_faults()
    bench.expect("HARDWARE_FAULT_STATUS", within=30, where={"active_faults": 0})
    bench.expect("FIRMWARE_STATUS", within=30, where={"usable_sensors": 4})
    assert bench.messages("SYNC")[0]["epoch"] == 0
    with pytest.raises(BenchError, match="only the hardware process"):
        _ = bench.truth
    bench.process.kill()
    with pytest.raises(BenchError, match=r"firmware process \d+ was killed by SIGKILL"):
        bench.advance(20)


@pytest.mark.rrins_scenario(QUICK)
def test_a_hardware_whose_firmware_is_the_test(rrins_hardware):
    sync = load().database.get_message_by_name("SYNC")
    rrins_hardware.bus.set_filters([{"can_id": sync.frame_id, "can_mask": 0x7FF}])
    epochs = [sync.decode(rrins_hardware.bus.recv(10).data)["epoch"] for _ in range(20)]
    assert epochs == list(range(20))
    assert rrins_hardware.process.poll() is None
