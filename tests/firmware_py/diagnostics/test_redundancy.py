"""Redundant sensors as a diagnostic tool sees them: parity, freeze frames, readmission."""

from __future__ import annotations

import numpy as np
import pytest
import udsoncan

from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.modes.modes import Mode, ModeRequest
from rrins.firmware_py.core.records.calibration_records import DriftState
from rrins.firmware_py.core.records.redundancy_records import (
    BEFORE_S,
    ReadmissionState,
    Refusal,
    SensorKind,
)
from rrins.firmware_py.core.records.troubles import Status
from rrins.firmware_py.core.redundancy.settings import DataSheet, RedundancySettings
from rrins.firmware_py.diagnostics import table

DPH = np.radians(1.0) / 3600
FAULT_DPH = 100.0
LEARNED_S, FAULTY_S = 20, 3


def sheet(white_noise: float, bias_limit: float) -> DataSheet:
    four = (0.0,) * 4
    return DataSheet(
        white_noise=(white_noise,) * 4,
        bias_instability=four,
        rate_random_walk=four,
        temperature_drift=four,
        bias_limit=bias_limit,
    )


SETTINGS = RedundancySettings(gyros=sheet(1e-6, 10 * DPH), accelerometers=sheet(1e-4, 0.01))


@pytest.fixture(scope="module")
def _faulty(tools):
    """A computer that navigates, whose gyro 2 has just been left out, and its RAM image."""
    bench = tools.Bench(redundancy=SETTINGS)
    bench.run_to(Mode.NAVIGATION_STRAPDOWN, ModeRequest.NAVIGATE_STRAPDOWN)
    for _ in range(LEARNED_S * 200):
        bench.step()
    counts = FAULT_DPH * DPH / 200 / tools.scale_of("SENSOR_1", "gyro_dtheta")
    bench._gyro[1] += counts
    for _ in range(FAULTY_S * 200):
        bench.step()
    bench._gyro[1] -= counts
    return bench, bench.ram.copy(), bench.epoch


@pytest.fixture
def faulty(_faulty, tool_of, connect):
    bench, ram, epoch = _faulty
    bench.firmware.diagnostics.restart()
    bench.ram[:] = ram
    bench.epoch = epoch
    tool = tool_of(bench)
    tool.client = connect(tool)
    return tool


def read(tool, name):
    did = table.identifier(name)
    answer = bytes.fromhex(tool.ask(b"\x22" + did.number.to_bytes(2, "big")))
    return did.layout.named(did.decode(answer[3:]))


def control(tool, what, **arguments):
    """Start (1), stop (2) or ask for (3) the routine; return the named results, or the refusal."""
    routine = table.routine("readmit_sensor")
    data = routine.argument_layout.encode(arguments) if arguments else None
    tool.unlock()
    try:
        answer = tool.client.routine_control(routine.number, what, data)
    except udsoncan.exceptions.NegativeResponseException as error:
        return error.response.code
    record = answer.service_data.routine_status_record
    return routine.result_layout.named(routine.result_layout.decode(record))


def order(tool, kind=SensorKind.GYRO, sensor=2, test_s=10, anew=0):
    return control(tool, 1, kind=int(kind), sensor=sensor, test_s=test_s, anew=anew)


def test_parity_alarm_and_exclusion_are_read(faulty):
    found = read(faulty, "gyro_parity")
    assert (found["isolated"], found["excluded"], found["how"]) == (2, 0b0010, "STANDING")
    assert (found["alarm"], found["redundancy_left"], found["readmitted"]) == (0, 0, 0)
    begun = faulty.bench.epoch - FAULTY_S * 200
    assert begun <= found["alarm_epoch"] < begun + 100
    assert found["alarm_epoch"] <= found["isolated_epoch"] <= begun + 400
    sound = read(faulty, "accelerometer_parity")
    assert (sound["isolated"], sound["excluded"], sound["alarm_epoch"]) == (0, 0, 0)
    assert sound["redundancy_left"]
    assert 0 <= sound["parity_ratio"] < 1
    thresholds = sound["parity_threshold_ug"]
    assert len(thresholds) == SENSOR_GROUPS
    assert all(
        abs(r) < t for r, t in zip(sound["parity_residual_ug"][:4], thresholds, strict=False)
    )
    assert thresholds[4:] == (0.0,) * 12


def test_the_freeze_frame_has_the_parity_from_before_the_alarm(faulty):
    number = table.trouble("gyro_2_left_out").number
    (dtc,) = faulty.client.get_dtc_snapshot_by_dtc_number(number).service_data.dtcs
    before = table.identifier("gyro_parity_before")
    first, latest = (s.data for s in dtc.snapshots if s.did == before.number)
    assert first == latest == read(faulty, "gyro_parity_before")
    assert first["alarm_epoch"] == read(faulty, "gyro_parity")["alarm_epoch"]
    residual = np.reshape(first["residual_dph"], (BEFORE_S, SENSOR_GROUPS))
    assert np.all(np.abs(residual) < 0.05 * FAULT_DPH)  # the fault leaves a quarter in each
    assert np.all(residual[:, :4] != 0)
    assert all(0 < ratio < 1 for ratio in first["parity_ratio"])


def test_codes_of_other_parts_have_no_parity(faulty):
    faulty.bench.state["sequencer"]["not_following"] = 1
    faulty.step()
    number = table.trouble("axis_inner_not_following").number
    (dtc,) = faulty.client.get_dtc_snapshot_by_dtc_number(number).service_data.dtcs
    assert {s.did for s in dtc.snapshots} == {did.number for did in table.SNAPSHOT}


def test_a_sound_sensor_is_readmitted_after_its_test(faulty):
    assert order(faulty)["state"] == "RUNNING"
    assert order(faulty) == 0x24  # one at a time
    faulty.run(5.0)
    running = control(faulty, 3)
    assert running["state"] == "RUNNING"
    assert 3 <= running["passed_s"] <= 5
    assert faulty.state.redundancy.gyros.excluded == 0b0010
    faulty.run(6.1)
    done = control(faulty, 3)
    assert (done["state"], done["refusal"], done["passed_s"]) == ("DONE", "NONE", 10)
    assert done["parity_ratio"] < 1
    found = read(faulty, "gyro_parity")
    assert (found["excluded"], found["readmitted"], found["redundancy_left"]) == (0, 2, 1)
    faulty.run(2.1)
    assert faulty.state.assembly.gyro_valid == 0b1111
    trouble = table.trouble("gyro_2_left_out").number.to_bytes(3, "big")
    status = bytes.fromhex(faulty.ask("19020f"))
    assert status[status.index(trouble) + 3] & 0x09 == 0x08  # confirmed, no longer failed


def test_one_in_use_is_refused_at_once(faulty):
    answer = order(faulty, sensor=3)
    assert (answer["state"], answer["refusal"]) == ("FAILED", "NOT_LEFT_OUT")
    assert read(faulty, "readmission")["state"] == "REFUSED"


def test_the_test_can_be_stopped(faulty):
    assert order(faulty)["state"] == "RUNNING"
    assert control(faulty, 2)["state"] == "STOPPED"
    faulty.run(11.0)
    assert faulty.state.redundancy.gyros.excluded == 0b0010
    assert read(faulty, "readmission")["state"] == "STOPPED"
    assert control(faulty, 2) == 0x24


def test_without_redundancy_there_is_nothing_to_readmit(tool, connect):
    tool.client = connect(tool)
    assert order(tool) == 0x22
    found = read(tool, "gyro_parity")
    assert (found["isolated"], found["suspect"], found["redundancy_left"]) == (0, 0, 0)


def test_the_same_by_a_message_on_the_bus(faulty, tools):
    state = faulty.state.redundancy.readmission
    command = {"order": 1, "kind": 0, "sensor": 2, "test_s": 10}
    frame = tools.frame("READMISSION_COMMAND", 0, **command)
    faulty.bench.step([frame, *faulty.bench.frames()])
    assert ReadmissionState(int(state.state)) == ReadmissionState.TESTING
    told = []
    for _ in range(2300):
        out = [tools.decode(frame) for frame in faulty.bench.step() if frame["can_id"] == 261]
        told += [values for _, values in out]
    assert told[0]["state"] == ReadmissionState.TESTING
    last = told[-1]
    assert (last["state"], last["refusal"]) == (ReadmissionState.READMITTED, Refusal.NONE)
    assert (last["kind"], last["sensor"], last["passed_s"], last["test_s"]) == (0, 2, 10, 10)
    assert 0 < last["parity_ratio"] < 1


def test_a_damaged_message_orders_nothing(faulty, tools):
    frame = tools.frame("READMISSION_COMMAND", 0, order=1, sensor=2, test_s=10)
    frame["data"] ^= np.uint64(1 << 20)
    before = int(faulty.state.faults.crc_errors)
    faulty.bench.step([frame, *faulty.bench.frames()])
    assert faulty.state.faults.crc_errors == before + 1
    assert faulty.state.redundancy.readmission.state == ReadmissionState.NONE


@pytest.mark.parametrize("kind", ["gyro", "accelerometer"])
def test_constants_that_drift_set_the_code_of_their_kind(faulty, kind):
    drift = faulty.bench.ram[0].calibration[f"{kind}s"]
    drift["state"], drift["distance"], drift["limit"], drift["change"] = (
        DriftState.DRIFTED,
        9,
        5,
        5e-5,
    )
    name = f"{kind}_calibration_drifted"

    def failed():
        faults = faulty.bench.firmware.diagnostics.faults
        return {trouble.name for trouble, _ in faults.by_mask(Status.TEST_FAILED)}

    assert name not in failed()
    faulty.bench.step()
    faulty.bench.step()
    assert name in failed()
    found = read(faulty, "calibration_status")
    assert (found[f"{kind}_drift"], found[f"{kind}_drift_sigma"]) == ("DRIFTED", 9.0)
    assert found[f"{kind}_drift_ppm"] == pytest.approx(50.0)
    drift["state"] = DriftState.KEPT
    for _ in range(3 * 200):
        faulty.bench.step()
    assert name not in failed()
