"""The parameter memory of a computer: over power-offs, against its limits, damaged."""

from __future__ import annotations

import datetime
import zlib

import pytest

from rrins.firmware_py.core.records.troubles import Status
from rrins.firmware_py.core.sensors.calibration import (
    AccelerometerCalibration,
    Calibration,
    GyroCalibration,
    GyroSigmas,
    Origin,
)
from rrins.firmware_py.core.settings import power_on
from rrins.firmware_py.diagnostics import calibration_image as image
from rrins.firmware_py.diagnostics import parameter_settings as set_up
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.access import Session
from rrins.firmware_py.diagnostics.calibration_image import ImageError
from rrins.firmware_py.diagnostics.parameters import PARAMETERS
from rrins.firmware_py.loop import Firmware, open_memories

BRIDGE = table.identifier("bridge").number
GYRO = table.identifier("gyro_1_calibration").number
SIGMA = table.identifier("gyro_1_calibration_sigma").number
CALIBRATED = table.identifier("calibrated").number
WHEN = {"date_utc_s": 1_795_421_100, "temperature_known": 1, "temperature_c": 22.5}
ORIGIN = Origin(
    date_utc=datetime.datetime(2026, 11, 23, 8, 5, tzinfo=datetime.UTC), temperature_c=22.5
)
START = table.identifier("start_position").number


@pytest.fixture
def computer(tools, tmp_path):
    """Return what switches a computer with a parameter memory on."""

    def switch_on(**settings):
        stores = open_memories(tmp_path / "parameters.bin")
        return Firmware(tools.settings(**settings), stores=stores)

    return switch_on


def write(firmware, number, **values):
    memory = firmware.diagnostics.parameters
    assert memory.finish(memory.change({number: values}))


def troubles(firmware):
    for epoch in range(3):
        firmware.step(firmware.inbox, 0, 0, epoch)
    return {t.name for t, _ in firmware.diagnostics.faults.by_mask(Status.TEST_FAILED)}


def state_of(firmware):
    return table.identifier("parameter_memory").decode(
        firmware.diagnostics.server.handle(bytes.fromhex("220109"), False, 0)[3:]
    )


def test_what_is_written_is_there_after_a_power_off(computer):
    firmware = computer()
    assert state_of(firmware) == {"state": 0, "sequence": 0, "parameters": 0}
    write(firmware, BRIDGE, bridge_s=0.5)
    write(firmware, START, latitude_deg=1.0, longitude_deg=2.0, height_m=3.0)
    assert firmware.ram[0]["parameters"]["bridge_epochs"] == 4
    firmware.close()
    firmware = computer()
    parameters = firmware.ram[0]["parameters"]
    assert parameters["bridge_epochs"] == 100
    assert parameters["height"] == 3.0
    assert state_of(firmware)["state"] == 1
    assert state_of(firmware)["parameters"] == 2
    assert troubles(firmware) == set()
    firmware.close()


def test_the_parameters_go_before_the_scenario_and_the_rest_stays(computer, tools):
    firmware = computer(height_m=500.0, alignment_s=7.0)
    write(firmware, BRIDGE, bridge_s=0.5)
    firmware.close()
    firmware = computer(height_m=700.0, alignment_s=7.0)
    assert firmware.ram[0]["parameters"]["height"] == 700.0
    assert firmware.ram[0]["parameters"]["alignment_epochs"] == 1400
    assert firmware.ram[0]["parameters"]["bridge_epochs"] == 100
    firmware.close()


def damage(path, slots):
    data = bytearray(path.read_bytes())
    for slot in slots:
        data[slot * len(data) // 2 + 40] ^= 0xFF
    path.write_bytes(bytes(data))


@pytest.mark.parametrize("slot", [0, 1])
def test_a_damaged_copy_falls_back_to_the_other_and_sets_a_trouble_code(computer, tmp_path, slot):
    firmware = computer()
    for _ in range(2):
        write(firmware, BRIDGE, bridge_s=0.5)
    firmware.close()
    damage(tmp_path / "parameters.bin", [slot])
    firmware = computer()
    assert firmware.ram[0]["parameters"]["bridge_epochs"] == 100
    assert troubles(firmware) == {"parameter_copy_damaged"}
    assert state_of(firmware)["state"] == 2
    write(firmware, BRIDGE, bridge_s=0.25)
    firmware.close()
    firmware = computer()
    assert troubles(firmware) == set()
    firmware.close()


def test_when_both_are_damaged_the_set_up_is_in_force(computer, tmp_path):
    firmware = computer()
    write(firmware, BRIDGE, bridge_s=0.5)
    firmware.close()
    damage(tmp_path / "parameters.bin", [0, 1])
    firmware = computer()
    assert firmware.ram[0]["parameters"]["bridge_epochs"] == 4
    assert troubles(firmware) == {"parameters_lost"}
    firmware.close()


def test_a_value_beyond_its_limits_is_left_out(computer, tmp_path):
    firmware = computer()
    memory = firmware.diagnostics.parameters
    memory._store.write(
        image.encode(
            {
                BRIDGE: {"bridge_s": 99.0},
                START: {"latitude_deg": 1.0, "longitude_deg": 2.0, "height_m": 3.0},
            }
        )
    )
    firmware.close()
    firmware = computer()
    assert firmware.ram[0]["parameters"]["bridge_epochs"] == 4
    assert firmware.ram[0]["parameters"]["height"] == 3.0
    assert troubles(firmware) == {"parameter_out_of_limits"}
    firmware.close()


FLAT = ((90.0, 0.0), (90.0, 120.0), (89.99, 240.0), (0.0, 0.0))
"""Three axes close to one plane, and one across."""

WEIGHTS = table.identifier("gyro_weights")
UNUSABLE = {"weights": (1e9, 1e9, 1e9, 1e-9) + (1.0,) * 12}


def test_weights_that_cannot_be_fused_with_are_left_out(computer):
    firmware = computer(gyro_axes_deg=FLAT)
    memory = firmware.diagnostics.parameters
    assert not memory.can_use({WEIGHTS.number: UNUSABLE})
    assert memory.can_use({WEIGHTS.number: {"weights": (2.0,) * 16}})
    memory._store.write(image.encode({WEIGHTS.number: UNUSABLE, BRIDGE: {"bridge_s": 0.5}}))
    firmware.close()
    firmware = computer(gyro_axes_deg=FLAT)
    assert set(firmware.ram[0]["gyros"]["weight"][:4]) == {1.0}
    assert firmware.ram[0]["parameters"]["bridge_epochs"] == 100
    assert troubles(firmware) == {"parameter_out_of_limits"}
    firmware.close()


def test_weights_that_cannot_be_fused_with_are_refused_when_written(computer):
    firmware = computer(gyro_axes_deg=FLAT)
    server = firmware.diagnostics.server
    server.enter_session(Session.EXTENDED)
    server.is_unlocked = True
    request = b"\x2e" + WEIGHTS.number.to_bytes(2, "big") + WEIGHTS.encode(UNUSABLE)
    assert server.handle(request, False, 0) == bytes.fromhex("7f2e31")
    firmware.close()


def test_trouble_codes_outlive_a_power_off_and_a_cycle_is_counted(computer):
    firmware = computer()
    faults = firmware.diagnostics.faults
    index = faults.index_of(table.trouble("overrun").number)
    firmware.ram[0]["clock"]["synchronised"] = True
    for epoch in range(3):
        firmware.ram[0]["faults"]["overruns"] += 1
        firmware.step(firmware.inbox, 0, 0, epoch)
    assert faults.status(index) & Status.CONFIRMED
    firmware.close()
    firmware = computer()
    faults = firmware.diagnostics.faults
    assert faults.status(index) == Status.CONFIRMED | Status.PENDING | 0x60
    assert faults.operation_cycles == 2
    assert faults.snapshot(index, 1)["epoch"][0] == 2
    firmware.close()


def test_every_setting_goes_through_the_parameters_and_back(tools, contract):
    settings = tools.settings(
        initial_attitude="self-aligned",
        height_channel="damped",
        gyro_weights=(1.0, 2.0, 3.0, 4.0),
        latitude_deg=-12.0,
        heading_deg=33.0,
        alignment_s=12.5,
        calibration=Calibration(
            calibrated=ORIGIN,
            gyros=GyroCalibration(
                bias_dph=(0.1, 0.2, 0.3, 0.4),
                scale_error_ppm=5.0,
                sigma=GyroSigmas(bias_dph=0.01, scale_error_ppm=(1.0, 2.0, 3.0, 4.0)),
            ),
            accelerometers=AccelerometerCalibration(bias_ug=50.0, installation_u_arcsec=7.0),
        ),
    )
    parameters = set_up.parameters_of(settings)
    again = set_up.changed(tools.settings(), parameters)
    assert set_up.parameters_of(again) == parameters
    assert again.calibration.calibrated == ORIGIN
    assert power_on(again, contract).tobytes() == power_on(settings, contract).tobytes()
    assert image.decode(image.encode(parameters)) == parameters


def test_what_is_written_by_hand_is_of_unknown_origin(computer):
    """A scale factor is not what was calibrated any more; a bias changes with each power-up."""
    firmware = computer()
    memory = firmware.diagnostics.parameters
    sigma = {field.name: 2.0 for field in table.identifier(SIGMA).fields}
    constants = memory.value(GYRO) | {"scale_error_ppm": 5.0}
    assert memory.finish(memory.change({GYRO: constants, SIGMA: sigma, CALIBRATED: WHEN}))
    write(firmware, GYRO, **(constants | {"bias_dph": 9.0}))
    assert memory.stored[CALIBRATED] == WHEN
    assert memory.stored[SIGMA] == sigma
    write(firmware, GYRO, **(constants | {"scale_error_ppm": 6.0}))
    assert memory.stored[CALIBRATED]["date_utc_s"] == 0
    assert memory.stored[CALIBRATED]["temperature_known"] == 0
    assert not any(memory.stored[SIGMA].values())
    firmware.close()


def test_every_parameter_at_its_limits_gives_a_computer_that_starts(tools, contract):
    names = ("minimum", "maximum")
    for limit in names:
        parameters = {}
        for did in PARAMETERS:
            values = {}
            for field in did.fields:
                value = getattr(field, limit)
                value = 0 if value is None else value
                values[field.name] = (value,) * field.count if field.count > 1 else value
            parameters[did.number] = values
        settings = set_up.changed(tools.settings(), parameters)
        power_on(settings, contract)


FILE = image.encode({BRIDGE: {"bridge_s": 0.5}})


def test_the_calibration_file_byte_for_byte():
    assert FILE.hex() == "5252434100010001" + "10040008" + "3fe0000000000000" + "8c09ed99"


@pytest.mark.parametrize(
    ("file", "why"),
    [
        (b"", "not a calibration file"),
        (b"RRCA", "not a calibration file"),
        (b"x" * 40, "not a calibration file"),
        (FILE[:-1], "CRC mismatch"),
        (FILE[:9] + b"\x05" + FILE[10:], "CRC mismatch"),
    ],
)
def test_what_is_no_calibration_file(file, why):
    with pytest.raises(ImageError, match=why):
        image.decode(file)


def with_crc(body):
    return body + zlib.crc32(body).to_bytes(4, "big")


@pytest.mark.parametrize(
    ("body", "why"),
    [
        (b"RRCA\0\2\0\0", "version 2"),
        (b"RRCA\0\1\0\1", "0 entries"),
        (b"RRCA\0\1\0\1\x10\x04\0\x09" + bytes(8), "cut off"),
        (b"RRCA\0\1\0\1\x10\x04", "cut off"),
        (b"RRCA\0\1\0\1\x10\x04\0\4" + bytes(4), "bridge: 4 bytes, not 8"),
        (b"RRCA\0\1\0\1\x01\x01\0\0", "0x0101 is not a parameter"),
        (b"RRCA\0\1\0\2" + 2 * (b"\x10\x04\0\x08" + bytes(8)), "duplicates"),
    ],
)
def test_a_file_whose_crc_holds_but_that_makes_no_sense(body, why):
    with pytest.raises(ImageError, match=why):
        image.decode(with_crc(body))


def test_a_calibration_that_is_written_is_taken_out_of_the_increments(computer):
    firmware = computer()
    write(
        firmware,
        table.identifier("gyro_2_calibration").number,
        bias_dph=36.0,
        scale_error_ppm=100.0,
        asymmetric_scale_error_ppm=0.0,
        installation_u_arcsec=0.0,
        installation_v_arcsec=0.0,
    )
    firmware.close()
    firmware = computer()
    gyros = firmware.ram[0]["gyros"]
    assert gyros["calibrated"]
    per_epoch = 36.0 * 4.84813681109536e-6 * 0.005
    assert gyros["bias_increment"][:4] == pytest.approx([0.0, per_epoch, 0.0, 0.0])
    assert gyros["scale_error"][:4] == pytest.approx([0.0, 1e-4, 0.0, 0.0])
    firmware.close()
