"""Faults of the hardware from a scenario, and what the firmware makes of each."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.hardware.memory import FAULT_CAPACITY
from rrins.host_tools.hardware.settings import power_on
from rrins.host_tools.runs.direct import run_direct
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario, fault_of, load

BEGIN_S = 3.0  # of navigation
USED_ON = {"enabled": False}  # faulty sensors, too


def scenario_with(*planned, **tables):
    values = {"duration_s": 60, "faults": list(planned)} | tables
    return Scenario.model_validate(values)


# Axes: at 10 s the inner axis is amid its first turn.

LASTING = {
    "stall": {"kind": "axis_stall", "axis": "inner", "at_s": 10},
    "stall of the axis that ought to turn next": {
        "kind": "axis_stall", "axis": "outer", "at_s": 2,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", LASTING)
def test_an_axis_that_does_not_follow_ends_the_rotation_not_the_navigation(fly, name):
    fault = LASTING[name]
    firmware, errors = fly(scenario_with(fault, duration_s=200))
    assert firmware["axes_not_following"] == [fault["axis"] == "inner", fault["axis"] == "outer"]
    assert firmware["fault"] == "NONE"
    assert firmware["epochs_navigated"] > 200 * 200
    # The sensors feel whatever the table does: an ideal navigator is where it is.
    assert max(errors.largest()["max_abs_position_error_m"].values()) < 5e-3
    # Both axes are held: after the fault nothing turns any more.
    late = errors.time_s > 120
    for angle in (errors.inner_deg[late], errors.outer_deg[late]):
        assert np.ptp(angle) == 0


PASSING = {
    "stall": {"kind": "axis_stall", "axis": "inner", "at_s": 10, "for_s": 8},
    "runaway": {"kind": "axis_runaway", "axis": "outer", "rate_dps": -4, "at_s": 10, "for_s": 8},
}


@pytest.mark.parametrize("name", PASSING)
def test_an_axis_that_follows_again_resumes_the_rotation_on_time(fly, name):
    fault = PASSING[name]
    firmware, errors = fly(scenario_with(fault, duration_s=200))
    assert firmware["axes_not_following"] == [False, False]
    assert firmware["axis_interruptions"] == [fault["axis"] == "inner", fault["axis"] == "outer"]
    assert max(errors.largest()["max_abs_position_error_m"].values()) < 5e-3
    # The second turn is over, as without the fault.
    assert errors.inner_deg[-1] == pytest.approx(180)
    assert errors.outer_deg[-1] == pytest.approx(-180)


def test_after_a_stall_the_rotation_cancels_biases_as_before(fly):
    gyros = {"bias_dph": [0.1, 0.11, 0.12, 0.13]}
    fault = {"kind": "axis_stall", "axis": "inner", "at_s": 20, "for_s": 3}
    scenario = Scenario(mode="rotating", duration_s=1600, gyros=gyros)
    worst = {}
    for name, planned in {"sound": [], "stalled": [fault]}.items():
        _, errors = fly(scenario.varied(faults=planned))
        worst[name] = np.hypot(errors.position_east_m, errors.position_north_m).max()
    # A turn that lags by 5° for 3 s is a tilt of 0.05": a few metres, where strapdown loses 141 m.
    assert worst["stalled"] < worst["sound"] + 5


def test_a_stall_shorter_than_the_tolerance_is_caught_up(fly):
    fault = {"kind": "axis_stall", "axis": "inner", "at_s": 10, "for_s": 1}
    firmware, errors = fly(scenario_with(fault, duration_s=200))
    assert firmware["axes_not_following"] == [False, False]
    stands = (errors.time_s > 10 - BEGIN_S + 0.2) & (errors.time_s < 11 - BEGIN_S - 0.2)
    assert np.ptp(errors.inner_deg[stands]) == 0
    # The second turn is over, both axes are where the scheme wants them.
    assert errors.inner_deg[-1] == pytest.approx(180)
    assert errors.outer_deg[-1] == pytest.approx(-180)


# Encoders: what one says wrongly reaches neither the attitude nor the rotation.

WRONG_ENCODERS = {
    # fault, what is used at the end, and in °: the largest error of the heading until it is found
    "jump": ({"kind": "encoder_offset", "offset_deg": 1.5}, "corrected", 1e-4),
    "jump beyond the tolerance": ({"kind": "encoder_offset", "offset_deg": 10}, "corrected", 1e-4),
    "jump and back": (
        {"kind": "encoder_offset", "offset_deg": -0.05, "for_s": 10},
        "encoder",
        1e-4,
    ),
    "glitches": (
        {"kind": "encoder_offset", "offset_deg": 3, "for_s": 30, "period_s": 1, "duty": 0.01},
        "encoder",
        1e-4,
    ),
    "stuck": ({"kind": "encoder_stuck"}, "gyros", 0.17),
    "stuck for a while": ({"kind": "encoder_stuck", "for_s": 20}, "encoder", 0.17),
    "slip": ({"kind": "encoder_slip", "slip_percent": 1}, "gyros", 0.21),
    "slip for a while": (
        {"kind": "encoder_slip", "slip_percent": -2, "for_s": 20},
        "corrected",
        0.21,
    ),
}


@pytest.mark.parametrize("name", WRONG_ENCODERS)
def test_a_wrong_encoder_is_found_and_done_without(fly, name):
    fault, source, until_found_deg = WRONG_ENCODERS[name]
    planned = {"axis": "inner", "at_s": 10} | fault
    firmware, errors = fly(scenario_with(planned, duration_s=200))
    assert firmware["axis_interruptions"] == [0, 0]
    assert firmware["encoders"]["outer"] is None
    inner = firmware["encoders"]["inner"]
    assert inner["source"] == source
    assert 10 <= inner["found_at_s"] <= (40 if name == "glitches" else 21)
    # C_b_n = C_s_n C_b_s: a table that seems turned on by an angle is a body turned back.
    assert np.abs(errors.heading_deg).max() <= until_found_deg
    found = errors.time_s > inner["found_at_s"] - BEGIN_S + 0.1
    for error in (errors.roll_deg, errors.pitch_deg, errors.heading_deg):
        assert np.abs(error[found]).max() < 2e-3
    assert errors.inner_deg[-1] == pytest.approx(180)
    assert errors.outer_deg[-1] == pytest.approx(-180)


def test_a_jump_is_found_in_the_epoch_and_measured(fly):
    fault = {"kind": "encoder_offset", "axis": "outer", "offset_deg": -0.75, "at_s": 120}
    firmware, _ = fly(scenario_with(fault, duration_s=130))
    outer = firmware["encoders"]["outer"]
    assert outer["found_at_s"] == 120
    assert outer["offset_deg"] == pytest.approx(-0.75, abs=3e-5)


@pytest.mark.parametrize("offset_deg", [-0.1, 1.0, 10.0])
def test_a_jump_is_found_in_a_vehicle_that_drives(fly, offset_deg):
    fault = {"kind": "encoder_offset", "axis": "inner", "offset_deg": offset_deg, "at_s": 400}
    scenario = load("drive_rotating", duration_s=500)
    firmware, errors = fly(scenario.varied(faults=[fault]))
    inner = firmware["encoders"]["inner"]
    assert (inner["found_at_s"], inner["source"]) == (400, "corrected")
    # The vehicle may have turned faster or slower in that epoch than in the one before.
    assert inner["offset_deg"] == pytest.approx(offset_deg, abs=5e-3)
    assert np.abs(errors.heading_deg).max() < 6e-3


FAR_FROM_IDEAL = {
    "prototype": {"sensors": "prototype"},
    "tactical": {"sensors": "tactical"},
    "slow gyros, and an axis that stalls": {
        "gyros": {"bandwidth_hz": 20},
        "faults": [
            {"kind": "axis_stall", "axis": "inner", "at_s": 20, "for_s": 1.5},
            {"kind": "axis_stall", "axis": "outer", "at_s": 130, "for_s": 4},
            {"kind": "axis_runaway", "axis": "inner", "rate_dps": 20, "at_s": 230, "for_s": 4},
        ],
    },
    "crooked table": {
        "turntable": {
            "inner": {
                "ripple_arcsec": 60, "stiction_arcsec": 200, "jerk_limit_dps3": 20,
                "encoder_bits": 14, "acceleration_limit_dps2": 20,
            },
            "outer": {"ripple_arcsec": 30, "stiction_arcsec": 600, "encoder_bits": 12},
            "non_orthogonality_arcsec": 300,
            "wobble_arcsec": 300,
        },
    },
    "gyro that fails": {"faults": [{"kind": "gyro_bias", "sensor": 1, "bias_dph": 500}]},
}  # fmt: skip


@pytest.mark.parametrize(
    "motion", ["stationary", "drive", pytest.param("sway", marks=pytest.mark.soak)]
)
@pytest.mark.parametrize("name", FAR_FROM_IDEAL)
def test_a_sound_encoder_is_never_blamed(fly, name, motion):
    tables = {"motion": {"kind": motion}}
    if motion == "drive":
        tables |= {"altimeter": {}, "firmware": {"height_channel": "damped"}}
    scenario = scenario_with(duration_s=450, mode="rotating", **tables)
    firmware, _ = fly(scenario.varied(**FAR_FROM_IDEAL[name]))
    assert firmware["encoders"] == {"inner": None, "outer": None}


def test_lost_frames_are_no_jumps_of_an_encoder(tmp_path):
    for probability in (0.01, 0.1):
        fault = {"kind": "drop", "probability": probability, "at_s": 5}
        scenario = scenario_with(fault, duration_s=150)
        assert run_direct(scenario, tmp_path).firmware["encoders"] == {
            "inner": None, "outer": None,
        }  # fmt: skip


# Sensors


def test_without_two_gyros_of_four_the_firmware_fails_after_its_bridge(fly):
    planned = [{"kind": "gyro_absent", "sensor": k, "at_s": 5} for k in (1, 2)]
    firmware, _ = fly(scenario_with(*planned))
    assert firmware["fault"] == "SENSORS_LOST"
    assert firmware["epochs_navigated"] == pytest.approx((5 - BEGIN_S) * 200 + 20, abs=3)


def test_a_gyro_bias_turns_the_attitude_by_its_share_of_the_fusion(fly):
    # Gyro 1 of the tetrahedron points down; (HᵀH)⁻¹Hᵀ = 3/4 Hᵀ. For 20 s at 3600 °/h = 1 °/s.
    fault = {"kind": "gyro_bias", "sensor": 1, "bias_dph": 360, "at_s": 10, "for_s": 20}
    _, errors = fly(scenario_with(fault, mode="strapdown", redundancy=USED_ON))
    after = errors.time_s > 28
    assert np.abs(errors.heading_deg[after]) == pytest.approx(0.75 * 0.1 * 20, rel=1e-3)
    assert np.abs(errors.heading_deg[errors.time_s < 6.9]).max() < 1e-6


def test_an_accelerometer_bias_moves_the_position(fly):
    # Accelerometer 2 leans 70.53° to x_s, east here: 3/4 sin α of the bias.
    fault = {"kind": "accelerometer_bias", "sensor": 2, "bias_ug": 1000, "at_s": 10}
    _, errors = fly(scenario_with(fault, mode="strapdown", redundancy=USED_ON))
    share = 0.75 * math.sin(math.acos(1 / 3))
    seconds = errors.time_s[-1] - (10 - BEGIN_S)
    expected = share * 1000 * 9.80665e-6 * seconds**2 / 2
    assert errors.position_east_m[-1] == pytest.approx(expected, rel=0.01)
    assert abs(errors.position_north_m[-1]) < 0.01 * expected


def test_noise_of_a_fault_is_noise_of_its_density(fly):
    fault = {
        "kind": "gyro_noise", "angle_random_walk_deg_per_sqrt_h": 6, "at_s": 5, "for_s": 50,
    }  # fmt: skip
    _, errors = fly(scenario_with(fault, mode="strapdown", redundancy=USED_ON))
    # About each axis the fusion leaves √(3/4) of one sensor's; 6 °/√h is 0.1 °/√s.
    during = (errors.time_s > 5 - BEGIN_S + 0.2) & (errors.time_s < 54 - BEGIN_S)
    heading = errors.heading_deg[during]
    steps = np.diff(heading)
    expected = 0.1 * math.sqrt(0.75) * math.sqrt(0.1)
    assert steps.std() == pytest.approx(expected, rel=4 / math.sqrt(2 * len(steps)))
    after = errors.time_s > 56 - BEGIN_S
    assert np.ptp(errors.heading_deg[after]) < 1e-3


def test_a_stuck_gyro_goes_on_with_its_last_increment(fly):
    fault = {"kind": "gyro_stuck", "sensor": 1, "at_s": 60, "for_s": 100}
    # Stuck while the table turns at 2 °/s about its axis, until after it stands: 3/4 of 2 °/s.
    _, errors = fly(scenario_with(fault, duration_s=110, redundancy=USED_ON))
    standing = (errors.time_s > 91) & (errors.time_s < 99)
    rate = np.polyfit(errors.time_s[standing], errors.heading_deg[standing], 1)[0]
    assert abs(rate) == pytest.approx(0.75 * 2, rel=1e-3)


# Plans


def test_a_fault_lasts_one_epoch_at_least():
    fault = fault_of({"kind": "gyro_bias", "for_s": 0.001})
    assert fault.epochs(200) == (0, 0)
    assert fault_of({"kind": "gyro_bias", "at_s": 1, "for_s": 1}).epochs(200) == (200, 399)
    assert fault_of({"kind": "gyro_bias", "at_s": 1}).epochs(200) == (200, -1)


def test_more_faults_than_the_hardware_can_hold_are_refused():
    fault = {"kind": "gyro_bias", "at_s": 1}
    plant = power_on(hardware_settings(scenario_with(*[fault] * FAULT_CAPACITY)))
    assert plant["faults"]["count"] == FAULT_CAPACITY
    wire = {"kind": "drop"}
    with pytest.raises(ValueError, match="33 of the hardware itself, 32 at most"):
        scenario_with(*[fault] * (FAULT_CAPACITY + 1), *[wire] * 5)
    with pytest.raises(ScenarioError, match="32 at most"):
        scenario_with().varied(faults=[fault] * (FAULT_CAPACITY + 1))


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ({"kind": "axis_stal"}, ["kind", "axis_stal", "did you mean axis_stall"]),
        ({"kind": "axis_stall"}, ["axis: is missing"]),
        ({"kind": "axis_stall", "axs": "inner"}, ["axs: no such key", "did you mean axis?"]),
        ({"kind": "axis_runaway", "axis": "inner", "rate_dpss": 1}, ["did you mean rate_dps?"]),
        ({"kind": "gyro_bias", "bias_dhp": 1}, ["bias_dhp", "did you mean bias_dph?"]),
        ({"kind": "gyro_bias", "sensor": 0}, ["sensor", "greater than or equal to 1"]),
        ({"kind": "drop", "nessage": "SYNC"}, ["nessage", "did you mean message?"]),
        ({"axis": "inner"}, ["kind: is missing"]),
    ],
)
def test_a_wrong_fault_is_told_in_one_line(fault, words):
    for make, where in (
        (lambda: fault_of(fault), "fault: "),
        (lambda: Scenario(duration_s=1).varied(faults=[{"kind": "cut"}, fault]), "faults.2"),
    ):
        with pytest.raises(ScenarioError) as caught:
            make()
        message = str(caught.value)
        assert "\n" not in message
        assert where in message
        for word in words:
            assert word in message


def test_a_sensor_that_is_not_there_is_refused():
    with pytest.raises(ValueError, match="sensor 5 of 4"):
        scenario_with({"kind": "gyro_bias", "sensor": 5})
    dodecahedron = {"geometry": "dodecahedron"}
    scenario = scenario_with({"kind": "gyro_bias", "sensor": 5}, rimu=dodecahedron)
    assert firmware_settings(scenario)
