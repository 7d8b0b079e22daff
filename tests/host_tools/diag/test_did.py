"""Data identifiers: list, read, write, control."""

from __future__ import annotations

import itertools

import pytest

from rrins.firmware_py.diagnostics import table


def test_reading_gives_the_values_of_the_ram_image(computer):
    found = computer.type("did", "read", "mode", "0x0303", "gyro_weights", "--json").json
    state = computer.firmware.ram[0]
    assert found["mode"] == {"mode": "NAVIGATION_ROTATING", "fault": "NONE"}
    assert found["axis_angles"]["inner_deg"] == pytest.approx(
        float(state["assembly"]["encoder_angle_deg"][0]), abs=2.0
    )
    assert found["gyro_weights"]["weights"] == [1.0] * 16


def test_all_that_the_computer_has(computer):
    found = computer.type("did", "read", "--all", "--json").json
    absent = {
        f"{kind}_{k}_calibration{of}"
        for kind in ("gyro", "accelerometer")
        for k in range(5, 17)
        for of in ("", "_sigma")
    }
    assert set(found) == {did.name for did in table.IDENTIFIERS} - absent


def test_a_table_fits_a_terminal_of_80_columns(computer, monkeypatch):
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    monkeypatch.setenv("TERM", "dumb")
    for words in (
        ("did", "read", "--all"),
        ("did", "list"),
        ("routine", "list"),
        ("memory", "read", "assembly"),
        ("identify",),
        ("dtc", "read", "--all"),
        ("dtc", "read", "overrun"),
    ):
        ended = computer.type(*words)
        assert ended.status == 0
        assert max(map(len, ended.out.splitlines())) <= 80


def test_reading_again_and_again(computer):
    ended = computer.type("did", "read", "epoch", "--every", "0.5", "--times", "3", "--json")
    epochs = [int(line.split()[-1].strip("}")) for line in ended.out.splitlines()]
    assert [later - before for before, later in itertools.pairwise(epochs)] == [
        pytest.approx(100, abs=4)
    ] * 2


def test_what_is_not_there_is_wrong_use_and_says_what_may_be_meant(computer):
    ended = computer.type("did", "read", "postion")  # codespell:ignore
    assert ended.status == 2
    assert "did you mean position" in ended.err
    assert computer.type("did", "read").status == 2
    assert computer.type("did", "read", "gyro_9_calibration").error == (
        "read gyro_9_calibration: requestOutOfRange (0x31): no such identifier, or a value beyond "
        "its limits; see `rrins diag did list`"
    )


def test_a_parameter_is_written_unlocked_only(computer):
    refused = computer.type("did", "write", "bridge", "bridge_s=0.5")
    assert refused.status == 22
    assert refused.error == (
        "write bridge: securityAccessDenied (0x33): the computer is locked; unlock with --security"
    )
    assert computer.stored == {}
    written = computer.type("did", "write", "bridge", "0.5", "--security", "--json")
    assert written.json == {"bridge": {"bridge_s": 0.5}}
    assert computer.stored == {0x1004: {"bridge_s": 0.5}}


def test_fields_that_are_not_named_keep_their_values(computer):
    computer.type("did", "write", "axis_watch", "axis_silence_s=0.3", "--security")
    assert computer.stored[0x1005] == {"follow_tolerance_deg": 5.0, "axis_silence_s": 0.3}
    computer.type("did", "write", "gyro_weights", "1,0.5", "--security")
    assert computer.stored[0x1007]["weights"] == (1.0, 0.5, *(1.0,) * 14)
    computer.type("did", "write", "alignment", "method=self-aligned", "--security")
    assert computer.stored[0x1003]["method"] == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("bridge", "bridge_s=50"), "bridge_s: 50 is not within 0 … 10 s"),
        (("bridge", "bridge_s=nan"), "bridge_s: nan is not within"),
        (("bridge", "bridge_ms=5"), "there is no field 'bridge_ms'; fields: bridge_s"),
        (("alignment", "method=SELF"), "allowed: GIVEN, SELF_ALIGNED"),
        (("alignment", "method=7"), "method: 7 is not within GIVEN, SELF_ALIGNED"),
        (("gyro_weights", ",".join(["1"] * 17)), "17 values, at most 16 allowed"),
        (("axis_watch", "0.5"), "is not FIELD=VALUE"),
        (("position", "latitude_deg=3"), "cannot be written"),
    ],
)
def test_what_may_not_be_written_is_told_before_anything_is_sent(computer, words, said):
    before = list(computer.medium.requests)
    ended = computer.type("did", "write", *words, "--security")
    assert ended.status == 2
    assert said in ended.err
    assert computer.medium.requests == before


def test_a_sensor_is_left_out_for_a_while(computer):
    adjust = ("did", "control", "excluded_sensors", "adjust", "gyros=2", "--security", "--json")
    ended = computer.type(*adjust, "--for", "7")
    assert ended.status == 0
    assert ended.out.splitlines()[-1] == ('{"excluded_sensors": {"gyros": 2, "accelerometers": 0}}')
    assert computer.firmware.ram[0]["gyros"]["used"] == 0b1101
    computer.bench.advance(5.5)  # without anybody who keeps the session
    assert computer.firmware.ram[0]["gyros"]["used"] == 0b1111
    assert computer.type("did", "control", "excluded_sensors", "adjust").status == 2


def test_the_mode_in_which_it_would_go_is_told(computer):
    refused = computer.type("did", "control", "axis_inner_control", "freeze", "--security")
    assert refused.status == 22
    assert "the mode is NAVIGATION_ROTATING; allowed: " in refused.error
    assert "STANDBY, FAULT and NAVIGATION_STRAPDOWN" in refused.error


def test_listing_needs_no_bus(computer):
    computer.medium.is_dead = True
    (described,) = computer.type("did", "list", "bridge", "--json").json
    assert described["fields"][0]["limits"] == "0 … 10 s"
    names = {one["name"] for one in computer.type("did", "list", "--controllable", "--json").json}
    assert names == {did.name for did in table.IDENTIFIERS if did.control}
