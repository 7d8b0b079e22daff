"""Routines: started, waited for, stopped."""

from __future__ import annotations

import pytest


def test_a_routine_in_the_wrong_mode(computer):
    refused = computer.type("routine", "start", "self_test", "--security")
    assert refused.status == 22
    assert refused.error == (
        "routine start self_test: conditionsNotCorrect (0x22): not possible in the current state; "
        "the mode is NAVIGATION_ROTATING; allowed: In STANDBY and FAULT"
    )
    assert computer.type("routine", "start", "self_test").status == 22


def test_an_axis_is_turned_and_waited_for(computer):
    computer.to_standby()
    words = ("routine", "start", "go_to_axis_angle", "axis=OUTER", "angle_deg=-30", "--security")
    found = computer.type(*words, "--wait", "--json").json["go_to_axis_angle"]
    assert (found["state"], found["axis"]) == ("DONE", "OUTER")
    assert found["encoder_angle_deg"] == pytest.approx(-30.0, abs=0.01)


def test_a_routine_that_fails_has_a_status_of_its_own(computer):
    computer.bench.inject("silence", message="SENSOR_2")
    computer.to_standby()
    ended = computer.type("routine", "start", "self_test", "--security", "--wait")
    assert ended.status == 24
    assert "SELF_TEST_FAILED" in ended.out
    assert ended.err == "rrins: routine self_test is FAILED\n"


def test_a_routine_that_takes_longer_than_is_waited(computer):
    computer.to_standby()
    computer.bench.advance(3.0)  # the axes come to rest
    words = ("routine", "start", "calibration", "duration_s=30", "store=0", "--security", "--wait")
    ended = computer.type(*words, "--limit", "5")
    assert ended.status == 24
    assert "is RUNNING" in ended.err
    stopped = computer.type("routine", "stop", "calibration", "--security", "--json").json
    assert stopped["calibration"]["state"] == "STOPPED"


def test_calibration_is_kept_alive_and_stored(computer):
    computer.to_standby()
    words = ("routine", "start", "go_to_axis_angle", "angle_deg=0", "--security", "--wait")
    for axis in ("INNER", "OUTER"):
        assert computer.type(*words, f"axis={axis}").status == 0
    words = ("routine", "start", "calibration", "duration_s=20", "store=1", "--security", "--wait")
    found = computer.type(*words, "--json").json["calibration"]
    assert found["stored"] == 1
    assert found["gyro_bias_dph"][:4] == pytest.approx([0.1, 0.11, 0.12, 0.13], abs=0.02)
    assert computer.stored[0x1102]["bias_dph"] == pytest.approx(0.11, abs=0.02)


def test_results_and_stopping_out_of_order(computer):
    early = computer.type("routine", "result", "alignment", "--security")
    assert (early.status, "it has not been started since power-on" in early.error) == (22, True)
    assert computer.type("routine", "stop", "alignment", "--security").status == 22
    assert computer.type("routine", "stop", "self_test", "--security").status == 2


@pytest.mark.parametrize(
    "words",
    [
        ("go_to_axis_angle",),
        ("go_to_axis_angle", "axis=INNER"),
        ("go_to_axis_angle", "axis=TOP", "angle_deg=3"),
        ("go_to_axis_angle", "axis=INNER", "angle_deg=4000"),
        ("self_test", "now=1"),
        ("selftest",),
    ],
)
def test_arguments_are_checked_before_anything_is_sent(computer, words):
    before = list(computer.medium.requests)
    assert computer.type("routine", "start", *words, "--security").status == 2
    assert computer.medium.requests == before
