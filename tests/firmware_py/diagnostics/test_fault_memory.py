"""Trouble codes over their life: status byte, debouncing, aging, freeze frames, resets."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.modes.modes import Mode, ModeRequest
from rrins.firmware_py.core.records.troubles import AGING_CYCLES, CLEARED_STATUS, Status
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.fault_memory import FaultMemory
from rrins.firmware_py.loop import open_memories

HEALING = 403  # epochs from 127 over 0 to -128, a second each


def faults_of(bench) -> FaultMemory:
    return bench.firmware.diagnostics.faults


def without(index):
    return lambda frames: [*frames[:index], *frames[index + 1 :]]


def status(bench, name):
    faults = faults_of(bench)
    return faults.status(faults.index_of(table.trouble(name).number))


def test_the_status_byte_over_the_life_of_a_fault(at):
    bench = at()
    name = "sensor_2_silent"
    bench.run(250)
    assert status(bench, name) == 0
    bench.run(19, without(2))
    assert status(bench, name) == 0
    bench.run(1, without(2))
    assert status(bench, name) == 0x2F  # failed, this cycle, pending, confirmed, since clear
    bench.run(HEALING)
    assert status(bench, name) == 0x2E  # healed
    faults_of(bench).begin_cycle()
    assert status(bench, name) == 0x6C  # not tested yet in this cycle
    bench.run(1)
    faults = faults_of(bench)
    faults.clear(table.trouble(name).number)
    assert status(bench, name) == CLEARED_STATUS == 0x50
    bench.run(203)
    assert status(bench, name) == 0


def test_the_fault_detection_counter(at):
    bench = at()
    bench.run(250)
    faults = faults_of(bench)
    index = faults.index_of(table.trouble("sensor_2_silent").number)
    counters = [faults.detection_counter(index)]
    for epoch in range(60):
        bench.run(1, without(2) if epoch < 30 else lambda frames: frames)
        counters.append(faults.detection_counter(index))
    assert counters[0] == -128
    assert counters[1] == 6  # from 0, an epoch of twenty
    assert counters[20] == counters[30] == 127
    assert counters[31] < 127
    assert counters[60] > 100  # back to 0 in a second


def test_now_and_then_a_lost_frame_is_no_trouble(at):
    bench = at(bridge_s=10.0)
    for k in range(600):
        bench.run(1, without(2) if k % 20 == 0 else lambda frames: frames)
    assert bench.failed() == set()
    for k in range(600):
        bench.run(1, without(2) if k % 4 == 0 else lambda frames: frames)
    assert bench.failed() == {"sensor_2_silent"}


def test_freeze_frames_of_the_first_and_the_latest_occurrence(at):
    bench = at(heading_deg=77.0)
    faults = faults_of(bench)
    index = faults.index_of(table.trouble("sensor_2_silent").number)
    assert faults.snapshot(index, 1) is None
    epochs = []
    for angle in (10.0, 20.0, 30.0):
        bench.axes_deg = [angle, -angle]
        epochs.append(bench.epoch + 19)
        bench.run(20, without(2))
        bench.run(HEALING)
    first, latest = (faults.snapshot(index, number)[0] for number in (1, 2))
    assert (first["epoch"], latest["epoch"]) == (epochs[0], epochs[2])
    assert first["assembly"]["encoder_angle_deg"] == pytest.approx([10, -10], abs=1e-5)
    assert latest["assembly"]["encoder_angle_deg"] == pytest.approx([30, -30], abs=1e-5)
    assert first["modes"]["mode"] == Mode.NAVIGATION_STRAPDOWN
    assert np.degrees(first["navigation"]["latitude"]) == pytest.approx(40.0)
    assert faults.extended(index)[1]["occurrences"] == 3


def test_a_trouble_code_is_forgotten_after_forty_cycles_without_the_fault(at):
    bench = at()
    name = "sensor_2_silent"
    faults = faults_of(bench)
    index = faults.index_of(table.trouble(name).number)
    bench.run(20, without(2))
    faults.begin_cycle()
    bench.run(HEALING)
    for cycle in range(AGING_CYCLES):
        assert status(bench, name) & Status.CONFIRMED
        assert faults.extended(index)[1]["aging"] == cycle
        faults.begin_cycle()
        bench.state["diagnostics"]["troubles"]["status"][index] &= 0xBF  # the test was completed
    assert not status(bench, name) & (Status.CONFIRMED | Status.PENDING)
    assert status(bench, name) & Status.TEST_FAILED_SINCE_LAST_CLEAR
    assert faults.snapshot(index, 1) is None


def test_a_cycle_in_which_the_test_was_not_completed_does_not_count(at):
    bench = at()
    faults = faults_of(bench)
    index = faults.index_of(table.trouble("sensor_2_silent").number)
    bench.run(20, without(2))
    faults.begin_cycle()
    for _ in range(100):
        faults.begin_cycle()
    assert faults.extended(index)[1]["aging"] == 0
    assert status(bench, "sensor_2_silent") & Status.PENDING


def test_trouble_codes_outlive_a_reset_of_the_computer(tool_at):
    tool = tool_at(Mode.NAVIGATION_STRAPDOWN)
    bench = tool.bench
    bench.run(20, without(2))
    for request in ("1101", "1103"):
        tool.unlock()
        tool.ask(request)
        bench.firmware.diagnostics.restart()
        bench.run_to(Mode.STANDBY)
        assert bench.failed(Status.CONFIRMED) == {"sensor_2_silent"}
    assert faults_of(bench).operation_cycles == 2


def test_a_reset_lets_every_test_find_anew_whether_it_fails(tool_at):
    tool = tool_at(Mode.NAVIGATION_STRAPDOWN)
    bench = tool.bench
    for request in ("1101", "1103"):
        bench.run(20, without(2))
        assert bench.failed() == {"sensor_2_silent"}
        tool.unlock()
        tool.ask(request)
        bench.firmware.diagnostics.restart()
        assert bench.failed() == set()
        bench.run_to(Mode.NAVIGATION_STRAPDOWN, ModeRequest.NAVIGATE_STRAPDOWN)


@pytest.fixture
def cycles(at, tmp_path):
    """Return what powers a computer on, lets it run, and cuts its power; it says what it keeps."""

    def cycle(seconds, change=lambda frames: frames):
        stores = open_memories(tmp_path / "parameters.bin")
        bench = at(stores=stores)
        bench.run(round(seconds * 200), change)
        stores.parameters.close()
        stores.faults.close()
        faults = faults_of(bench)
        index = faults.index_of(table.trouble("sensor_2_silent").number)
        return faults.operation_cycles, status(bench, "sensor_2_silent"), faults.extended(index)[1]

    return cycle


@pytest.mark.slow
def test_an_operation_cycle_ends_when_the_power_fails(cycles):
    assert cycles(1, without(2))[:2] == (1, 0x2F)
    for number in range(2, 6):
        count, now, counters = cycles(3)
        assert count == number
        assert now == 0x28 | (Status.PENDING if number == 2 else 0)  # it passed in the second
        assert counters["aging"] == number - 2


def test_a_cycle_too_short_for_a_test_is_counted_and_ages_nothing(cycles):
    cycles(1, without(2))
    for number in range(2, 6):
        count, now, counters = cycles(0.1)
        assert count == number
        assert now & Status.PENDING
        assert counters["aging"] == 0
