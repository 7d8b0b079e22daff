"""udsoncan's client, an independent implementation, against the firmware; frames, virtual time."""

from __future__ import annotations

import zlib

import pytest
import udsoncan
from udsoncan import DataFormatIdentifier, MemoryLocation
from udsoncan.exceptions import NegativeResponseException

from rrins.firmware_py.core.modes.modes import FirmwareFault, Mode
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.troubles import CLEARED_STATUS
from rrins.firmware_py.diagnostics import calibration_image as image
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.regions import CALIBRATION_ADDRESS, CALIBRATION_CAPACITY
from rrins.firmware_py.diagnostics.routines import RoutineState

FILE = MemoryLocation(CALIBRATION_ADDRESS, CALIBRATION_CAPACITY, 32, 32)


@pytest.fixture
def client(tool, connect):
    return connect(tool)


@pytest.fixture
def navigating(tool_at, connect):
    tool = tool_at(Mode.NAVIGATION_STRAPDOWN, heading_deg=30.0)
    return tool, connect(tool)


def values(client, name):
    did = table.identifier(name)
    return client.read_data_by_identifier(did.number).service_data.values[did.number]


def unlock(client, session="extendedDiagnosticSession"):
    client.change_session(3)
    if session == "programmingSession":
        client.change_session(2)
    client.unlock_security_access(1)


def routine(client, name, control="start", **arguments):
    described = table.routine(name)
    call = {
        "start": client.start_routine,
        "stop": client.stop_routine,
        "result": client.get_routine_result,
    }[control]
    data = described.argument_layout.encode(arguments) if arguments else None
    response = call(described.number, data)
    return described.result_layout.decode(response.service_data.routine_status_record)


def refusal(call, *arguments, **named):
    with pytest.raises(NegativeResponseException) as refused:
        call(*arguments, **named)
    return refused.value.response.code


def test_every_identifier_that_this_computer_has_is_read(navigating):
    _, client = navigating
    groups = {
        f"{kind}_{k}_calibration{of}"
        for kind in ("gyro", "accelerometer")
        for k in range(5, 17)
        for of in ("", "_sigma")
    }
    for did in table.IDENTIFIERS:
        if did.name in groups:
            assert refusal(client.read_data_by_identifier, did.number) == 0x31
        else:
            assert set(values(client, did.name)) == {field.name for field in did.fields}


def test_the_values_are_those_of_the_ram_image(navigating):
    tool, client = navigating
    client_attitude = values(client, "attitude")
    assert client_attitude["heading_deg"] == pytest.approx(30.0, abs=1e-4)
    assert values(client, "position")["latitude_deg"] == pytest.approx(40.0)
    assert values(client, "mode") == {"mode": 4, "fault": 0}
    assert values(client, "table_version")["table_crc32"] == table.crc32()
    assert values(client, "uptime")["uptime_s"] == pytest.approx(tool.bench.epoch * 0.005, abs=0.02)
    assert values(client, "clock")["synchronised"] == 1
    assert values(client, "sensors")["gyros"] == 4
    assert values(client, "load")["frames_per_epoch"] == pytest.approx(9.3, abs=0.5)


def test_the_whole_ram_image_is_read(navigating):
    tool, client = navigating
    client.change_session(3)
    step = 4000
    whole = b"".join(
        client.read_memory_by_address(
            MemoryLocation(start, min(step, Ram.dtype.itemsize - start), 24, 16)
        ).service_data.memory_block
        for start in range(0, 3 * step, step)
    )
    steady = Ram.dtype.fields["dispatch"][1]
    assert whole[:steady] == tool.bench.ram.tobytes()[:steady]
    end = MemoryLocation(Ram.dtype.itemsize - 8, 16, 24, 8)
    assert refusal(client.read_memory_by_address, end) == 0x31


def test_a_parameter_is_written_and_in_force_after_a_reset(client, tool):
    unlock(client)
    did = table.identifier("axis_watch")
    wanted = {"follow_tolerance_deg": 2.5, "axis_silence_s": 0.5}
    client.write_data_by_identifier(did.number, wanted)
    assert values(client, "axis_watch") == wanted
    assert tool.state["parameters"]["follow_tolerance_deg"] == 5.0
    client.ecu_reset(1)
    tool.run(1.0)
    assert tool.state["parameters"]["follow_tolerance_deg"] == 2.5
    assert tool.state["parameters"]["axis_silence_epochs"] == 100


def test_the_calibration_is_pulled_changed_and_pushed(client, tool):
    unlock(client, "programmingSession")
    pulled = pull(client)
    parameters = image.decode(pulled)
    assert {0x1001, 0x1101, 0x1104, 0x1204} <= set(parameters)
    assert 0x1105 not in parameters
    told = values(client, "calibration_file")
    assert told == {"length": len(pulled), "file_crc32": zlib.crc32(pulled)}
    parameters[0x1001]["latitude_deg"] = 52.5
    parameters[0x1102]["bias_dph"] = 0.25
    push(client, image.encode(parameters))
    assert image.decode(pull(client)) == parameters
    client.ecu_reset(1)
    tool.run(1.0)
    assert float(tool.state["parameters"]["latitude"]) == pytest.approx(0.9162978572970231)


def pull(client):
    client.request_upload(FILE, DataFormatIdentifier())
    size = values(client, "calibration_file")["length"]
    file = b""
    while len(file) < size:
        sequence = (len(file) // 1024 + 1) & 0xFF
        file += client.transfer_data(sequence).service_data.parameter_records
    end = client.request_transfer_exit().service_data.parameter_records
    assert int.from_bytes(end, "big") == zlib.crc32(file)
    return file


def push(client, file, crc=None):
    location = MemoryLocation(CALIBRATION_ADDRESS, len(file), 32, 32)
    largest = client.request_download(location).service_data.max_length - 2
    for k, start in enumerate(range(0, len(file), largest)):
        client.transfer_data((k + 1) & 0xFF, file[start : start + largest])
    crc = zlib.crc32(file) if crc is None else crc
    return client.request_transfer_exit(crc.to_bytes(4, "big"))


@pytest.mark.parametrize("damage", ["crc", "inside", "unknown", "limit"])
def test_a_damaged_calibration_is_refused_whole(client, tool, damage):
    unlock(client, "programmingSession")
    before = tool.node.parameters.effective()
    parameters = image.decode(pull(client))
    if damage == "limit":
        parameters[0x1001]["latitude_deg"] = 91.0
    if damage == "unknown":  # a fifth gyro's
        parameters[0x1105] = parameters[0x1101]
    file = image.encode(parameters)
    crc = 12345 if damage == "crc" else None
    if damage == "inside":
        file = file[:50] + b"\xff" + file[51:]
    with pytest.raises(NegativeResponseException) as refused:
        push(client, file, crc)
    assert refused.value.response.code == 0x72
    assert tool.node.parameters.effective() == before


def test_a_transfer_keeps_its_order(client, tool):
    unlock(client, "programmingSession")
    file = image.encode(tool.node.parameters.effective())
    client.request_download(MemoryLocation(CALIBRATION_ADDRESS, len(file), 32, 32))
    assert refusal(client.request_upload, FILE) == 0x22
    assert refusal(client.transfer_data, 2, file[:100]) == 0x73
    client.transfer_data(1, file[:300])
    client.transfer_data(1, file[:300])  # the response was lost: sent again
    assert refusal(client.transfer_data, 1, file[:299]) == 0x73
    assert refusal(client.request_transfer_exit, bytes(4)) == 0x24
    assert refusal(client.transfer_data, 2, file[300:] + b"more") == 0x71
    client.transfer_data(2, file[300:])
    assert refusal(client.transfer_data, 3, b"more") == 0x24
    client.request_transfer_exit(zlib.crc32(file).to_bytes(4, "big"))
    assert refusal(client.transfer_data, 1, b"more") == 0x24


def test_a_transfer_ends_with_the_session(client):
    client.change_session(3)
    client.request_upload(FILE)
    client.change_session(3)
    assert refusal(client.transfer_data, 1) == 0x24


def test_self_test(client, tool):
    unlock(client)
    assert routine(client, "self_test")["state"] == RoutineState.RUNNING
    assert tool.bench.mode == Mode.SELF_TEST
    tool.run(0.6)
    found = routine(client, "self_test", "result")
    assert found["state"] == RoutineState.DONE
    assert found["gyro_valid"] == found["accelerometer_valid"] == 0b1111
    assert tool.bench.mode == Mode.STANDBY


@pytest.mark.slow
def test_a_self_test_that_fails(client, tool, tools):
    unlock(client)
    routine(client, "self_test")
    bench = tool.bench
    for k in range(2100):  # a sensor is not there
        keep_alive = [[tools.frame("HEARTBEAT_HARDWARE", 0)]] if k == 0 else [[]]
        bench.step([*keep_alive[0], *bench.frames()[:2], *bench.frames()[3:]])
        tool.server._last_ns = tool.node.now_ns
    found = routine(client, "self_test", "result")
    assert (found["state"], found["fault"]) == (RoutineState.FAILED, FirmwareFault.SELF_TEST_FAILED)


def test_alignment(client, tool):
    unlock(client)
    assert routine(client, "alignment")["state"] == RoutineState.RUNNING
    assert tool.bench.mode == Mode.ALIGNMENT
    tool.run(0.2)
    found = routine(client, "alignment", "result")
    assert found == {"state": RoutineState.DONE, "epochs": 20, "wanted_epochs": 20}
    assert routine(client, "standby") == {"state": RoutineState.DONE, "mode": Mode.STANDBY}


def test_alignment_stopped(tool_at, connect):
    tool = tool_at(alignment_s=100.0)
    client = connect(tool)
    unlock(client)
    routine(client, "alignment")
    assert routine(client, "alignment", "stop")["state"] == RoutineState.STOPPED
    tool.step()
    assert tool.bench.mode == Mode.STANDBY
    assert refusal(client.stop_routine, 0x0202) == 0x24


def test_an_axis_is_turned_to_an_angle(client, tool):
    unlock(client)
    routine(client, "go_to_axis_angle", axis=1, angle_deg=90.0)
    command = tool.state["sequencer"]
    assert (command["command"][1], command["target_angle_deg"][1]) == (2, 90.0)
    tool.bench.axes_deg[1] = 40.0
    tool.run(0.1)
    assert routine(client, "go_to_axis_angle", "result")["state"] == RoutineState.RUNNING
    tool.bench.axes_deg[1] = 90.0
    tool.run(0.1)
    found = routine(client, "go_to_axis_angle", "result")
    assert found["state"] == RoutineState.DONE
    assert found["encoder_angle_deg"] == pytest.approx(90.0, abs=1e-5)


@pytest.mark.slow
def test_an_axis_that_does_not_come_there(client, tool):
    unlock(client)
    routine(client, "go_to_axis_angle", axis=0, angle_deg=60.0)
    for _ in range(4):
        tool.run(3.1)  # twice a second's turn at 60 °/s, and 10 s
        client.tester_present()
    assert routine(client, "go_to_axis_angle", "result")["state"] == RoutineState.FAILED
    assert tool.state["sequencer"]["command"][0] == 1  # holds


def test_the_rotation_is_started_and_stopped(navigating):
    tool, client = navigating
    unlock(client)
    started = routine(client, "rotation")
    assert (started["state"], started["mode"]) == (RoutineState.RUNNING, Mode.NAVIGATION_ROTATING)
    assert tool.state["sequencer"]["running"]
    routine(client, "rotation", "stop")
    tool.step()
    assert tool.bench.mode == Mode.NAVIGATION_STRAPDOWN


def test_calibration_finds_the_biases_of_a_standing_record(tool_at, connect, tools):
    tool = tool_at(heading_deg=40.0, pitch_deg=3.0)
    bench = tool.bench
    dph, ug = 4.84813681109536e-6, 9.80665e-6
    gyro_dph, accelerometer_ug = [30.0, -20.0, 10.0, 5.0], [900.0, -400.0, 0.0, 250.0]
    bench._gyro += [b * dph * 0.005 / 4e-9 for b in gyro_dph]
    bench._accelerometer += [b * ug * 0.005 / 1.25e-7 for b in accelerometer_ug]
    client = connect(tool)
    unlock(client)
    routine(client, "calibration", duration_s=4, store=1)
    assert refusal(client.start_routine, 0x0205, b"\0\1\0") == 0x24
    tool.run(4.1)
    found = routine(client, "calibration", "result")
    assert (found["state"], found["epochs"], found["stored"]) == (RoutineState.DONE, 800, 1)
    # A count over 800 epochs is 2e-4 °/h … 4e-9/0.005 rad/s = 0.165 °/h, over 800: 2e-4.
    assert found["gyro_bias_dph"][:4] == pytest.approx(gyro_dph, abs=1e-3)
    assert found["accelerometer_bias_ug"][:4] == pytest.approx(accelerometer_ug, abs=0.01)
    assert found["gyro_bias_dph"][4:] == (0.0,) * 12
    assert max(found["gyro_bias_sigma_dph"]) < 0.05
    kept = tool.node.parameters.stored
    assert kept[0x1101]["bias_dph"] == pytest.approx(30.0, abs=1e-3)
    assert kept[0x1204]["bias_ug"] == pytest.approx(250.0, abs=0.01)


def test_calibration_stores_no_bias_that_no_sensor_may_have(client, tool):
    tool.bench._gyro[1] += 20_000 * 4.84813681109536e-6 * 0.005 / 4e-9
    unlock(client)
    routine(client, "calibration", duration_s=4, store=1)
    tool.run(4.1)
    found = routine(client, "calibration", "result")
    assert (found["state"], found["stored"]) == (RoutineState.FAILED, 0)
    assert found["gyro_bias_dph"][1] == pytest.approx(20_000, rel=1e-4)
    assert tool.node.parameters.stored == {}


def test_calibration_fails_when_an_axis_moves(client, tool):
    unlock(client)
    routine(client, "calibration", duration_s=4, store=1)
    tool.run(0.5)
    tool.state["assembly"]["encoder_rate_dps"][0] = 1.0
    tool.server.poll(tool.node.now_ns)
    assert routine(client, "calibration", "result")["state"] == RoutineState.FAILED
    assert tool.node.parameters.stored == {}


def test_a_sensor_is_left_out_by_control(navigating):
    tool, client = navigating
    unlock(client)
    excluded = table.identifier("excluded_sensors").number
    client.io_control(excluded, 3, values={"gyros": 0b0010, "accelerometers": 0})
    tool.step()
    assert tool.state["gyros"]["used"] == 0b1101
    assert values(client, "excluded_sensors") == {"gyros": 2, "accelerometers": 0}
    client.io_control(excluded, 0)
    tool.step()
    assert tool.state["gyros"]["used"] == 0b1111
    assert tool.bench.mode == Mode.NAVIGATION_STRAPDOWN


def test_trouble_codes_are_read_and_cleared(navigating):
    tool, client = navigating
    number = table.trouble("sensor_2_silent").number
    begin = tool.bench.epoch
    for _ in range(60):
        frames = tool.bench.frames()
        tool.bench.step([*frames[:2], *frames[3:]])
    begun = client.get_dtc_by_status_mask(0x08).service_data.dtcs
    assert [dtc.id for dtc in begun] == [number]
    status = begun[0].status
    assert (status.test_failed, status.confirmed, status.pending) == (True, True, True)
    assert client.get_number_of_dtc_by_status_mask(0x01).service_data.dtc_count == 1

    (dtc,) = client.get_dtc_snapshot_by_dtc_number(number).service_data.dtcs
    assert [snapshot.record_number for snapshot in dtc.snapshots[:6]] == [1] * 6
    frozen = {s.did: s.data for s in dtc.snapshots[:6]}
    assert list(frozen) == [did.number for did in table.SNAPSHOT]
    assert frozen[0x0102]["mode"] == Mode.NAVIGATION_STRAPDOWN
    assert frozen[0x0101]["epoch"] == begin + 19  # 0.1 s: 20 epochs
    assert frozen[0x0401]["latitude_deg"] == pytest.approx(40.0)

    (dtc,) = client.get_dtc_extended_data_by_dtc_number(number).service_data.dtcs
    (identified,) = {d.id for d in client.get_dtc_snapshot_identification().service_data.dtcs}
    assert identified == number

    supported = client.get_supported_dtc().service_data.dtcs
    expected = {
        t.number
        for t in table.TROUBLES
        if t.group < 4 and t.needs not in ("altimeter", "gnss", "odometer", "estimator")
    }
    assert {d.id for d in supported} == expected

    client.clear_dtc(number)
    tool.run(2.1)
    (dtc,) = [d for d in client.get_supported_dtc().service_data.dtcs if d.id == number]
    assert dtc.status.get_byte_as_int() == 0
    client.clear_dtc()
    assert {d.status.get_byte_as_int() for d in client.get_supported_dtc().service_data.dtcs} <= {
        CLEARED_STATUS,
        0,
        0x10,
    }


def test_trouble_codes_are_not_set_while_their_setting_is_off(navigating):
    tool, client = navigating
    client.change_session(3)
    client.control_dtc_setting(udsoncan.services.ControlDTCSetting.SettingType.off)
    for _ in range(100):
        frames = tool.bench.frames()
        tool.bench.step([*frames[:2], *frames[3:]])
    assert client.get_dtc_by_status_mask(0x08).service_data.dtcs == []
    client.control_dtc_setting(udsoncan.services.ControlDTCSetting.SettingType.on)
    for _ in range(100):
        frames = tool.bench.frames()
        tool.bench.step([*frames[:2], *frames[3:]])
    assert len(client.get_dtc_by_status_mask(0x08).service_data.dtcs) == 1


def test_long_responses_come_within_the_timing_that_the_server_announces(client):
    """udsoncan counts P2, 50 ms, to the last frame of a response."""
    client.config |= {"use_server_timing": True, "p2_timeout": 1, "p2_star_timeout": 5}
    client.change_session(3)
    supported = client.get_supported_dtc()
    assert {code.id for code in supported.service_data.dtcs} < {t.number for t in table.TROUBLES}
    assert len(supported.data) > 300
    memory = client.read_memory_by_address(MemoryLocation(0, 2048, 32, 32))
    assert len(memory.service_data.memory_block) == 2048
