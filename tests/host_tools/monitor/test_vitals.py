"""Mode, axes, navigation and troubles of rehearsals, as a watch on their bus sees them."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.dbc.codec import load
from rrins.host_tools.monitor.troubles import troubles_of
from rrins.host_tools.monitor.vitals import vitals_of

QUICK = {"alignment_s": 1}


def navigate(bench, seconds=4.0):
    bench.expect(
        "FIRMWARE_STATUS", within=5, where={"mode": lambda mode: mode.startswith("NAVIGATION")}
    )
    bench.advance(seconds)


def test_a_sound_rehearsal_has_no_troubles(rehearsed):
    seen = {}

    def drive(bench):
        navigate(bench)
        seen["navigation"] = bench.navigation
        seen["axis"] = bench.last("AXIS_INNER_STATUS")

    state = rehearsed(drive, firmware=QUICK).state
    vitals = vitals_of(state)
    assert troubles_of(state, vitals) == []
    assert vitals.firmware.mode == "NAVIGATION_ROTATING"
    assert (vitals.firmware.fault, vitals.firmware.usable_sensors) == ("NONE", 4)
    assert vitals.firmware.scheme_position == 1
    assert vitals.axes["inner"].state == seen["axis"]["state"] == "MOVING"
    assert vitals.axes["inner"].angle_deg == pytest.approx(seen["axis"]["encoder_angle_deg"])
    assert vitals.axes["outer"].follows
    assert vitals.navigation.latitude_deg == seen["navigation"].lat_deg
    assert vitals.navigation.velocity_up == seen["navigation"].velocity_up_mps
    assert vitals.navigation.heading_deg == pytest.approx(seen["navigation"].heading_deg)
    assert all(counter.count == 0 for counter in vitals.counters.values())
    assert {message.name for message in state.messages} >= {"SYNC", "SENSOR_4", "NAV_ATTITUDE"}
    assert all(message.errors == 0 for message in state.messages)
    assert state.message("SENSOR_4").rate_hz == pytest.approx(200)


def test_an_aided_rehearsal_has_none_either(rehearsed):
    """Whatever begins, ends and begins again: no cycle of its own is a loss, or a silence."""

    def drive(bench):
        navigate(bench)
        for request in ("STANDBY", "ALIGN", "NAVIGATE_STRAPDOWN"):
            for _ in range(40):
                bench.send("MODE_COMMAND", mode_request=request)
                bench.advance(0.1)
        navigate(bench)

    bus = rehearsed(drive, "drive_aided", firmware=QUICK)
    assert told_of(bus) == []
    assert [message.name for message in bus.state.messages if message.errors] == []


def test_redundant_sensors_as_they_are_reported(played):
    for k in range(4):
        played.send(
            "GYRO_REDUNDANCY", 1.0 * k, k, alarm=1, redundant=1, parity_ratio=2.5 - k / 2,
            window_log2=3, suspect=2, standing=1, drift=4,
        )  # fmt: skip
        played.send(
            "ACCELEROMETER_REDUNDANCY", 1.0 * k, k, excluded=0b100, isolated=3, how="STUCK",
            repairing=1,
        )  # fmt: skip
    played.send(
        "READMISSION_STATUS", 3.0, state="REFUSED", kind="ACCELEROMETER", sensor=3,
        refusal="PARITY", passed_s=4, test_s=60, parity_ratio=12.5,
    )  # fmt: skip
    state = played.watch.state()
    vitals = vitals_of(state)
    gyros, accelerometers = vitals.redundancy["gyros"], vitals.redundancy["accelerometers"]
    assert (gyros.parity_ratio, gyros.largest_ratio) == pytest.approx((1.0, 2.5))
    assert (gyros.window_s, gyros.suspect, gyros.excluded) == (8, 2, ())
    assert (gyros.how, gyros.isolated, gyros.redundancy_left) == (None, None, True)
    assert (gyros.drift, accelerometers.drift) == ("FROM_40_TO_80_PPM", None)
    assert (accelerometers.excluded, accelerometers.isolated) == ((3,), 3)
    assert (accelerometers.how, accelerometers.redundancy_left) == ("STUCK", False)
    readmission = vitals.readmission
    assert (readmission.state, readmission.refusal) == ("REFUSED", "PARITY")
    assert (readmission.kind, readmission.sensor, readmission.passed_s) == ("accelerometer", 3, 4)
    assert troubles_of(state, vitals) == [
        "the gyros disagree: one of them fails, and it is not known which",
        "gyro calibration drifted: from 40 to 80 ppm, if it is one gyro",
        "accelerometer 3 is left out, found by its repeated increments",
        "no redundancy is left among the accelerometers",
    ]


def test_a_gyro_that_is_left_out(rehearsed):
    def drive(bench):
        navigate(bench, 20)
        bench.inject("gyro_bias", sensor=2, bias_dph=100)
        bench.advance(5)

    bus = rehearsed(drive, firmware=QUICK, redundancy={"enabled": True})
    vitals = vitals_of(bus.state)
    gyros = vitals.redundancy["gyros"]
    assert (gyros.excluded, gyros.isolated, gyros.how) == ((2,), 2, "STANDING")
    assert (gyros.redundancy_left, gyros.suspect) == (False, None)
    ratio = bus.state.signal("GYRO_REDUNDANCY", "parity_ratio")
    assert ratio.value is None  # 0 would read as perfect
    row = load().signal_index("GYRO_REDUNDANCY", "parity_ratio")
    assert np.isnan(bus.watch.latest(np.array([row])).values[0])
    both = bus.state.value("ACCELEROMETER_REDUNDANCY", "parity_ratio"), vitals.redundancy
    assert both[0] == both[1]["accelerometers"].parity_ratio > 0
    assert both[1]["accelerometers"].suspect is None  # whatever the parity points at most
    assert vitals.redundancy["accelerometers"].redundancy_left
    assert vitals.readmission is None
    troubles = troubles_of(bus.state, vitals)
    assert (
        "gyro 2 is left out, found by comparison with encoders, Earth rate and gravity" in troubles
    )
    assert "no redundancy is left among the gyros" in troubles


def test_a_calibration_that_has_drifted(rehearsed, tmp_path):
    """250 ppm of one gyro are found by the parity while the table turns."""
    calibration = tmp_path / "calibration.toml"
    calibration.write_text(
        "[gyros.sigma]\nscale_error_ppm = 2.0\nasymmetric_scale_error_ppm = 3.5\n"
        "installation_u_arcsec = 0.45\ninstallation_v_arcsec = 0.36\n",
        encoding="utf-8",
    )

    def drive(bench):
        navigate(bench, 175)

    gyros = {"angle_random_walk_deg_per_sqrt_h": 0.005, "scale_error_ppm": [0.0, 250.0, 0.0, 0.0]}
    firmware = QUICK | {"calibration": str(calibration)}
    bus = rehearsed(drive, rate_hz=50, firmware=firmware, gyros=gyros, accelerometers={})
    vitals = vitals_of(bus.state)
    assert vitals.redundancy["gyros"].drift == "FROM_160_TO_320_PPM"
    assert vitals.redundancy["accelerometers"].drift is None
    assert troubles_of(bus.state, vitals) == [
        "gyro calibration drifted: from 160 to 320 ppm, if it is one gyro"
    ]


def test_before_anything_was_on_the_bus(played):
    state = played.watch.state()
    vitals = vitals_of(state)
    assert vitals.firmware is vitals.navigation is vitals.counters is vitals.readmission is None
    assert vitals.redundancy == {"gyros": None, "accelerometers": None}
    assert vitals.axes == {"inner": None, "outer": None}
    assert troubles_of(state, vitals) == []


def told_of(bus):
    return troubles_of(bus.state, vitals_of(bus.state))


def told(rehearsed, drive, **overrides):
    return told_of(rehearsed(drive, **{"firmware": QUICK} | overrides))


def test_a_sensor_that_falls_silent(rehearsed):
    def drive(bench):
        navigate(bench)
        bench.inject("drop", message="SENSOR_3")
        bench.advance(2)

    troubles = told(rehearsed, drive)
    assert "the firmware uses 3 of 4 sensor groups" in troubles
    assert any(t.startswith("SENSOR_3 has been silent for 2.0 s") for t in troubles)
    assert any(t.startswith("the firmware counts missing_frames: ") for t in troubles)
    assert "injected on the wire by rrins: drop" in troubles
    assert not any("SENSOR_2" in trouble for trouble in troubles)


def test_frames_that_are_lost_repeated_corrupt_or_miscounted(rehearsed):
    def drive(bench):
        navigate(bench)
        bench.inject("drop", message="SENSOR_1", for_s=0.05)
        bench.inject("duplicate", message="SENSOR_2", for_s=0.05)
        bench.inject("corrupt", message="SENSOR_3", for_s=0.05)
        bench.inject("wrong_counter", message="SENSOR_4", for_s=0.05)
        bench.advance(1)

    bus = rehearsed(drive, firmware=QUICK)
    errors = {
        name: (message.lost, message.out_of_turn, message.crc_errors)
        for name in ("SENSOR_1", "SENSOR_2", "SENSOR_3", "SENSOR_4")
        if (message := bus.state.message(name))
    }
    assert errors["SENSOR_1"] == (10, 0, 0)
    assert errors["SENSOR_2"] == (0, 10, 0)
    assert errors["SENSOR_3"] == (10, 0, 10)
    # The first of the ten skips a number; one more, after the last, seems to come twice.
    assert errors["SENSOR_4"] == (1, 10, 0)
    troubles = troubles_of(bus.state, vitals_of(bus.state))
    assert "SENSOR_1: 10 lost recently" in troubles
    assert "SENSOR_3: 10 lost, 10 with a wrong CRC recently" in troubles


def test_a_firmware_in_fault(rehearsed):
    def drive(bench):
        navigate(bench)
        for group in (1, 2, 3):
            bench.inject("drop", message=f"SENSOR_{group}")
        bench.advance(4)

    troubles = told(rehearsed, drive)
    assert troubles[0] == "mode FAULT: SENSORS_LOST"
    assert not any(trouble.startswith("NAV_") for trouble in troubles), "it rightly sends none"


def test_a_bus_on_which_only_the_hardware_is_left(played):
    for k in range(600):
        played.send("SYNC", k * 0.005, k)
        if k < 100 and k % 20 == 0:
            played.send("FIRMWARE_STATUS", k * 0.005, k // 20, mode="NAVIGATION_ROTATING")
            played.send("NAV_HEIGHT", k * 0.005, k // 20, height=7)
    state = played.watch.state()
    vitals = vitals_of(state)
    assert vitals.firmware.is_silent
    assert vitals.firmware.age_s == pytest.approx(599 * 0.005 - 0.4)
    assert [trouble for trouble in troubles_of(state, vitals) if "silent" in trouble] == [
        "FIRMWARE_STATUS has been silent for 2.6 s",
        "NAV_HEIGHT has been silent for 2.6 s",
    ]


def test_axes_sync_and_absent_sensors(played):
    played.send(
        "FIRMWARE_STATUS", 0.0, mode="STANDBY", axis_outer_not_following=1, sync_lost=1,
        load_percent=95, usable_sensors=1,
    )  # fmt: skip
    played.send("AXIS_INNER_STATUS", 0.0, state="FAULT")
    played.send("AXIS_OUTER_STATUS", 0.0, state="HOLDING")
    played.send("SENSOR_1", 0.0, status="GYRO_ABSENT")
    state = played.watch.state()
    assert troubles_of(state, vitals_of(state)) == [
        "the firmware has lost SYNC and runs on its own clock",
        "the firmware is busy for 95 % of its period",
        "the inner axis reports FAULT",
        "the outer axis did not follow its command",
        "SENSOR_1 reports GYRO_ABSENT",
    ]


def test_a_babbling_node(rehearsed):
    def drive(bench):
        navigate(bench)
        bench.inject("babble", frames_per_epoch=40)
        bench.advance(3)

    troubles = told(rehearsed, drive)
    assert any(t.startswith("the bus load is ") for t in troubles)
    assert "unknown identifier 0x001, 8000 per second" in troubles
