"""Faults of the hardware by epoch: planned, put in and taken out while it runs."""

from __future__ import annotations

from rrins.host_tools.hardware import faults
from rrins.host_tools.hardware.faults import HardwareFault
from rrins.host_tools.hardware.memory import FAULT_CAPACITY


def test_faults_put_in_and_taken_out_while_it_runs(plant):
    plant["period_ns"], plant["gyros"]["count"] = 5_000_000, 4
    bias, stall = HardwareFault.GYRO_BIAS, HardwareFault.AXIS_STALL
    assert faults.put(plant, bias, 2, 0, -1, 1.0)
    assert faults.put(plant, stall, 1, 3, 4, 0.0)
    seen = []
    for epoch in range(8):
        plant["epoch"] = epoch
        if epoch == 6:
            faults.remove(plant, bias, 2)
        faults.apply(plant)
        increments = plant["gyros"]["fault_bias_increment"][:4].tolist()
        seen.append((increments[2], bool(plant["axis"][1]["blocked"])))
        assert increments[:2] == [0, 0]
    on, off = 0.005, 0.0
    assert seen == [
        (on, False), (on, False), (on, False), (on, True), (on, True), (on, False),
        (off, False), (off, False),
    ]  # fmt: skip


def test_what_is_over_makes_room(plant):
    for _ in range(FAULT_CAPACITY):
        assert faults.put(plant, HardwareFault.AXIS_STALL, 0, 0, 5, 0.0)
    assert not faults.put(plant, HardwareFault.AXIS_STALL, 0, 0, 5, 0.0)
    plant["epoch"] = 6
    assert faults.put(plant, HardwareFault.AXIS_STALL, 0, 6, -1, 0.0)
    assert plant["faults"]["count"] == 1
