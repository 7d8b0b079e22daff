"""The calibration file: pulled, changed, pushed; refused where it is damaged."""

from __future__ import annotations

import datetime
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.firmware_py.diagnostics import calibration_image as image
from rrins.firmware_py.diagnostics.codecs import Values
from rrins.firmware_py.diagnostics.parameters import (
    ACCELEROMETER_CALIBRATIONS,
    CALIBRATED,
    GYRO_CALIBRATIONS,
    GYRO_SIGMAS,
    SETTINGS,
)
from rrins.host_tools.diag import calibration_file


@pytest.mark.parametrize("options", [(), ("--settings",)])
def test_what_is_pulled_and_pushed_is_the_same(computer, tmp_path, options):
    file = tmp_path / "box7.toml"
    before = computer.firmware.diagnostics.parameters.effective()
    assert computer.type("calibration", "pull", str(file), *options).status == 0
    pushed = computer.type("calibration", "push", str(file), "--security", "--json").json
    assert pushed["parameters"] == len(before)
    assert computer.stored == before
    again = tmp_path / "again.toml"
    computer.type("calibration", "pull", str(again), *options)
    assert again.read_bytes() == file.read_bytes()


def test_the_computers_own_bytes(computer, tmp_path):
    file = tmp_path / "box7.rrca"
    computer.type("calibration", "pull", str(file))
    parameters = image.decode(file.read_bytes())
    parameters[0x1102]["bias_dph"] = 0.25
    file.write_bytes(image.encode(parameters))
    assert computer.type("calibration", "push", str(file), "--security").status == 0
    assert computer.stored == parameters


def test_a_table_of_sensors_is_whole_and_others_stay(computer, tmp_path):
    computer.type("did", "write", "gyro_1_calibration", "bias_dph=9", "--security")
    computer.type("did", "write", "accelerometer_1_calibration", "bias_ug=9", "--security")
    file = tmp_path / "gyros.toml"
    file.write_text("[gyros]\nscale_error_ppm = [1, 2, 3, 4.5]\n[settings.bridge]\nbridge_s = 1\n")
    assert computer.type("calibration", "push", str(file), "--security").status == 0
    stored = computer.stored
    assert [stored[0x1101 + k]["scale_error_ppm"] for k in range(4)] == [1.0, 2.0, 3.0, 4.5]
    assert stored[0x1101]["bias_dph"] == 0.0
    assert stored[0x1201]["bias_ug"] == 9.0
    assert stored[0x1004] == {"bridge_s": 1.0}


def test_when_how_warm_and_how_well_go_with_the_constants(computer, tmp_path):
    file = tmp_path / "box7.toml"
    known = "[calibrated]\ndate_utc = 2026-11-23T09:05:00+01:00\ntemperature_c = 22.5\n"
    file.write_text(f"{known}[gyros]\nscale_error_ppm = 5\n[gyros.sigma]\nbias_dph = [1,2,3,4]\n")
    assert computer.type("calibration", "push", str(file), "--security").status == 0
    when = {"date_utc_s": 1_795_421_100, "temperature_known": 1, "temperature_c": 22.5}
    assert computer.stored[CALIBRATED.number] == when
    assert [computer.stored[did.number]["bias_dph"] for did in GYRO_SIGMAS[:4]] == [1, 2, 3, 4]
    pulled = tmp_path / "pulled.toml"
    computer.type("calibration", "pull", str(pulled))
    assert tomllib.loads(pulled.read_text())["calibrated"]["temperature_c"] == 22.5
    assert "date_utc = 2026-11-23T08:05:00Z" in pulled.read_text()
    # In use after a reset; the age is by this computer's clock.
    assert computer.type("calibration", "show").out.startswith("calibrated at an unknown date\n")
    assert computer.type("reset", "--security").status == 0
    shown = computer.type("calibration", "show", "--json").json
    assert (shown["date_utc"], shown["temperature_c"]) == ("2026-11-23T08:05:00Z", 22.5)
    age_s = datetime.datetime.now(datetime.UTC).timestamp() - 1_795_421_100
    assert shown["age_days"] == pytest.approx(age_s / 86_400, abs=0.06)
    assert shown["gyros"]["state"] == "not_compared"
    assert shown["gyros"]["drift_ppm"] is None
    said = computer.type("calibration", "show").out.splitlines()
    assert said[0].startswith("calibrated on 2026-11-23, ")
    assert said[0].endswith(" days ago, at 22.5 °C")
    assert said[1] == "gyros: not compared with their calibration"
    # Other constants without a date are not those of the former date.
    file.write_text("[gyros]\nscale_error_ppm = 5\n")
    assert computer.type("calibration", "push", str(file), "--security").status == 0
    assert computer.stored[CALIBRATED.number]["date_utc_s"] == 0
    assert not any(computer.stored[GYRO_SIGMAS[0].number].values())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[gyros", "not TOML"),
        ("", "empty; allowed: "),
        ("[gyro]\n", "unknown key gyro"),
        ("[gyros]\nbias = 3\n", "gyros: unknown key bias"),
        ("[gyros]\nbias_dph = [1, 2, 3]\n", "gyros.bias_dph: 3 values for 4 sensors"),
        ("[gyros]\nbias_dph = 20000\n", "allowed: -10000 … 10000 °/h"),
        ("[gyros]\nbias_dph = 'much'\n", "gyros.bias_dph: 'much' is invalid"),
        ("[gyros]\nbias_dph = nan\n", "gyros.bias_dph"),
        ("gyros = 3\n", "gyros is not a table"),
        ("[gyros.sigma]\nbias_dph = -1\n", "allowed: 0 … 100000 °/h"),
        ("[gyros]\nsigma = 1\n", "gyros.sigma is not a table"),
        ("[calibrated]\ndate = 1\n", "calibrated: unknown key date"),
        ("[calibrated]\ndate_utc = 2026-11-23\n", "is not a time with its zone"),
        ("[calibrated]\ndate_utc = 1969-11-23T08:05:00Z\n", "calibrated.date_utc"),
        ("[calibrated]\ntemperature_c = 300\n", "allowed: -100 … 200 °C"),
        ("[settings]\nbridge = 3\n", "settings.bridge is not a table"),
        ("[settings.bridges]\n", "settings: unknown key bridges"),
        ("[settings.alignment]\nmethod = 'SELF'\n", "allowed: GIVEN, SELF_ALIGNED"),
        ("[settings.gyro_weights]\nweights = [1, 2]\n", "needs 16 values"),
        ("[settings.height_channel]\nheight_channel = true\n", "True is invalid"),
    ],
)
def test_a_file_that_is_wrong_changes_nothing(computer, tmp_path, text, said):
    file = tmp_path / "wrong.toml"
    file.write_text(text)
    ended = computer.type("calibration", "push", str(file), "--security")
    assert ended.status == 23
    assert ended.error.startswith(f"{file}: ")
    assert said in ended.error
    assert computer.stored == {}


@pytest.mark.parametrize("damage", ["cut", "bit", "other", "sensor"])
def test_damaged_bytes_change_nothing(computer, tmp_path, damage):
    file = tmp_path / "box7.rrca"
    computer.type("calibration", "pull", str(file))
    data = file.read_bytes()
    if damage == "sensor":  # a fifth gyro's
        parameters = image.decode(data)
        parameters[0x1105] = parameters[0x1101]
        data = image.encode(parameters)
    file.write_bytes(
        {
            "cut": data[:-9],
            "bit": data[:40] + bytes([data[40] ^ 1]) + data[41:],
            "other": b"PK\3",
        }.get(damage, data)
    )
    ended = computer.type("calibration", "push", str(file), "--security")
    assert ended.status == 23
    assert ended.error.startswith(f"{file}: ")
    assert computer.stored == {}


def test_locked_nothing_is_pushed(computer, tmp_path):
    file = tmp_path / "box7.toml"
    computer.type("calibration", "pull", str(file))
    ended = computer.type("calibration", "push", str(file))
    assert (ended.status, "unlock with --security" in ended.error) == (22, True)
    assert computer.stored == {}


def test_a_file_that_is_there_is_not_replaced_by_mistake(computer, tmp_path):
    file = tmp_path / "box7.toml"
    file.write_text("mine")
    ended = computer.type("calibration", "pull", str(file))
    assert (ended.status, file.read_text()) == (23, "mine")
    assert computer.type("calibration", "pull", str(file), "--force").status == 0
    assert tomllib.loads(file.read_text())["gyros"]["bias_dph"] == [0.0] * 4
    assert [path.name for path in tmp_path.iterdir() if path.suffix not in (".toml", ".log")] == []
    nowhere = computer.type("calibration", "pull", str(tmp_path / "no" / "x.toml"))
    assert (nowhere.status, "cannot be written" in nowhere.error) == (23, True)
    assert computer.type("calibration", "pull", str(tmp_path / "x.txt")).status == 2


def value_of(field):
    if field.choices is not None:
        return st.sampled_from([int(choice) for choice in field.choices])
    number = st.floats(field.minimum, field.maximum)
    return number if field.count == 1 else st.tuples(*[number] * field.count)


def values_of(did) -> st.SearchStrategy[Values]:
    return st.fixed_dictionaries({field.name: value_of(field) for field in did.fields})


DIDS = (
    *SETTINGS,
    *GYRO_CALIBRATIONS[:5],
    *GYRO_SIGMAS[:5],
    *ACCELEROMETER_CALIBRATIONS[:3],
)


@given(st.fixed_dictionaries({did.number: values_of(did) for did in DIDS}))
def test_toml_says_every_parameter_exactly(parameters):
    zeros = {did.number: did.decode(bytes(did.layout.size)) for did in DIDS}
    text = calibration_file.to_toml(parameters, with_settings=True)
    assert calibration_file.from_toml(text, zeros) == parameters
