"""Each kind of fault of a sensor, in each mode: found, left out, or told; never the wrong one."""

from __future__ import annotations

import math
import os
import random

import pytest

import rrins

BEGIN_S = 3.0
"""When navigation begins, with the built-in scenarios' alignment of 2 s."""

SELF_ALIGNED = {"firmware": {"initial_attitude": "self-aligned", "alignment_s": 60}}
NOISE = {
    "gyros": {"angle_random_walk_deg_per_sqrt_h": 0.005, "bias_dph": 0.0},
    "accelerometers": {"white_noise_ug_per_sqrt_hz": 10, "bias_ug": 0.0},
}
UNCALIBRATED = {
    "scale_error_ppm": [50, -50, 30, -40],
    "installation_u_arcsec": [10, -10, 7, -5],
    "installation_v_arcsec": [-10, 6, 10, -8],
}


UNEVEN = {kind: one | UNCALIBRATED for kind, one in NOISE.items()}


def simulate(*faults, scenario="rimu_rotating", duration_s=300, noise=NOISE, **changes):
    changes = {"redundancy": {"enabled": True}} | noise | changes
    return rrins.simulate(scenario, duration_s=duration_s, faults=faults, **changes).summary


def worst_m(summary):
    error = summary["max_abs_position_error_m"]
    return math.hypot(error["east"], error["north"])


def of(summary, kind):
    return summary["redundancy"][kind.split("_")[0] + "s"]


AT_STANDSTILL = {
    "ramp of a gyro": ({"kind": "gyro_ramp", "bias_dph_per_min": 10}, 15.0, 15.0),
    "scale factor of a gyro": ({"kind": "gyro_scale"}, 5.0, 5.0),
    "mount of a gyro": ({"kind": "gyro_shift_v"}, 5.0, 5.0),
    "dead gyro": ({"kind": "gyro_dead"}, 5.0, 5.0),
    "gyro at full scale": ({"kind": "gyro_full_scale"}, 5.0, 5.0),
    "gyro that fails now and then": (
        {"kind": "gyro_bias", "period_s": 10, "duty": 0.2}, 5.0, 5.0,
    ),
    "gyro that is stuck now and then": (
        {"kind": "gyro_stuck", "period_s": 10, "duty": 0.3}, 5.0, 5.0,
    ),
    "scale factor of an accelerometer": ({"kind": "accelerometer_scale"}, 1.0, 5.0),
    "dead accelerometer": ({"kind": "accelerometer_dead"}, 1.0, 5.0),
    "accelerometer at full scale": ({"kind": "accelerometer_full_scale"}, 5.0, 5.0),
    "accelerometer that fails now and then": (
        {"kind": "accelerometer_bias", "period_s": 10, "duty": 0.2}, 1.0, 5.0,
    ),
    # 60" of gravity are 290 µg, as 60" of tilt would be: one of them fails, unknown which.
    "ramp of an accelerometer": ({"kind": "accelerometer_ramp"}, 60.0, None),
    "mount of an accelerometer": ({"kind": "accelerometer_shift_v"}, 5.0, None),
}  # fmt: skip


@pytest.mark.parametrize("name", AT_STANDSTILL)
def test_at_standstill_each_fault_is_found(name):
    fault, alarm_s, isolated_s = AT_STANDSTILL[name]
    summary = simulate({"sensor": 3, "at_s": 203} | fault)
    found = of(summary, fault["kind"])
    assert found["alarm_s"] - 200 == pytest.approx(0, abs=alarm_s)
    if isolated_s is None:
        assert (found["excluded"], found["unresolved_s"]) == (None, found["alarm_s"])
    else:
        assert (found["excluded"], found["unresolved_s"]) == ([3], None)
        assert found["isolated_s"] - 200 < isolated_s
    assert summary["firmware"]["fault"] == "NONE"
    assert worst_m(summary) < 25


MOVING = {
    "drive": {"scenario": "drive_rotating"},
    "sway": {"scenario": "rimu_rotating", "motion": {"kind": "sway"}},
}


@pytest.mark.parametrize("motion", MOVING)
@pytest.mark.parametrize("what", ["stuck", "dead", "absent", "full_scale"])
@pytest.mark.parametrize("kind", ["gyro", "accelerometer"])
def test_in_motion_a_useless_sensor_is_left_out(kind, what, motion):
    fault = {"kind": f"{kind}_{what}", "sensor": 2, "at_s": 153}
    summary = simulate(fault, duration_s=200, **MOVING[motion])
    found = of(summary, fault["kind"])
    assert (found["excluded"], found["unresolved_s"]) == ([2], None)
    assert found["isolated_s"] - 150 < 2.5
    assert summary["firmware"]["fault"] == "NONE"
    assert worst_m(summary) < 60


@pytest.mark.parametrize("what", ["stuck", "dead", "absent", "full_scale"])
@pytest.mark.parametrize("kind", ["gyro", "accelerometer"])
def test_a_sensor_that_is_useless_at_power_on_is_left_out(kind, what):
    summary = simulate({"kind": f"{kind}_{what}", "sensor": 3, "at_s": 0}, duration_s=120)
    assert of(summary, kind)["excluded"] == [3]
    assert summary["firmware"]["fault"] == "NONE"
    assert worst_m(summary) < 5


def test_without_redundancy_an_absent_sensor_fails_the_self_test():
    fault = {"kind": "gyro_absent", "sensor": 3, "at_s": 0}
    summary = simulate(fault, duration_s=20, redundancy={"enabled": False})
    assert summary["firmware"]["fault"] == "SELF_TEST_FAILED"


def test_one_of_three_that_cannot_be_spared_fails_the_self_test_as_before():
    fault = {"kind": "gyro_absent", "sensor": 3, "at_s": 0}
    summary = simulate(fault, duration_s=20, rimu={"geometry": "orthogonal"})
    assert summary["firmware"]["fault"] == "SELF_TEST_FAILED"


@pytest.mark.parametrize("at_s", [pytest.param(40, marks=pytest.mark.soak), 61])
@pytest.mark.parametrize(
    "fault",
    [
        {"kind": "gyro_bias", "bias_dph": 100},
        {"kind": "gyro_stuck"},
        {"kind": "gyro_noise"},
        {"kind": "gyro_absent"},
        {"kind": "gyro_full_scale"},
        {"kind": "accelerometer_bias", "bias_ug": 5000},
        {"kind": "accelerometer_dead"},
        {"kind": "accelerometer_noise"},
        {"kind": "accelerometer_scale"},
    ],
    ids=lambda fault: fault["kind"],
)
def test_a_sensor_that_fails_during_alignment_is_left_out_of_it(fault, at_s):
    """Alignment lasts from 1.5 to 61.5 s; it waits for a suspicion, and begins anew."""
    summary = simulate(fault | {"sensor": 2, "at_s": at_s}, duration_s=120, **SELF_ALIGNED)
    assert of(summary, fault["kind"])["excluded"] == [2]
    assert summary["firmware"]["fault"] == "NONE"
    anew_s = {40: 40.0, 61: 61.0}[at_s]
    navigated_s = summary["firmware"]["epochs_navigated"] / 200
    waits = fault["kind"] not in ("gyro_absent", "gyro_full_scale", "gyro_stuck") or at_s == 40
    assert not waits or navigated_s == pytest.approx(120 - anew_s, abs=3)
    assert worst_m(summary) < 5


def test_two_faults_one_after_the_other_each_in_its_kind():
    faults = [
        {"kind": "gyro_scale", "sensor": 2, "at_s": 103},
        {"kind": "accelerometer_dead", "sensor": 4, "at_s": 104},
    ]
    summary = simulate(*faults, duration_s=200)
    assert of(summary, "gyro")["excluded"] == [2]
    assert of(summary, "accelerometer")["excluded"] == [4]
    assert worst_m(summary) < 15


@pytest.mark.parametrize("what", ["bias", "scale"])
def test_a_fault_during_recovery_from_lost_frames_is_found(what):
    faults = [
        {"kind": "silence", "node": "hardware", "at_s": 103, "for_s": 0.09},
        {"kind": f"gyro_{what}", "sensor": 2, "at_s": 103.05},
        {"kind": "drop", "probability": 0.01, "at_s": 20},
    ]
    summary = simulate(*faults, duration_s=140)
    found = of(summary, "gyro")
    assert (found["excluded"], found["unresolved_s"]) == ([2], None)
    assert found["isolated_s"] - 100 < 5
    assert of(summary, "accelerometer")["alarm_s"] is None


@pytest.mark.parametrize("kind", ["gyro", "accelerometer"])
def test_a_sensor_that_sticks_is_known_on_a_bus_that_loses_frames_since_power_on(kind):
    faults = [
        {"kind": "drop", "probability": 0.01, "at_s": 0},
        {"kind": f"{kind}_stuck", "sensor": 2, "at_s": 63},
    ]
    summary = simulate(*faults, duration_s=90, **MOVING["sway"])
    found = of(summary, kind)
    assert (found["excluded"], found["unresolved_s"]) == ([2], None)
    assert found["isolated_s"] - 60 < 10


@pytest.mark.parametrize(("at_s", "noise"), [(103, NOISE), (203, {})])
def test_a_group_that_repeats_one_frame_for_ever_is_left_out(at_s, noise):
    fault = {"kind": "stale", "message": "SENSOR_3", "at_s": at_s}
    summary = simulate(fault, noise=noise)
    for kind in ("gyro", "accelerometer"):
        found = of(summary, kind)
        assert (found["excluded"], found["how"]) == ([3], "absent")
        assert found["isolated_s"] - (at_s - BEGIN_S) < 2
    assert worst_m(summary) < 10  # 9.4 km when every 15th epoch was used


@pytest.mark.parametrize(
    ("share", "noise"),
    [
        pytest.param(0.2, NOISE, id="0.2-noise"),
        pytest.param(0.2, {}, id="0.2-ideal", marks=pytest.mark.soak),
        pytest.param(0.2, UNEVEN, id="0.2-uncalibrated", marks=pytest.mark.soak),
        pytest.param(0.4, NOISE, id="0.4-noise"),
        pytest.param(0.4, {}, id="0.4-ideal"),
        pytest.param(0.4, UNEVEN, id="0.4-uncalibrated"),
    ],
)
def test_a_bus_that_loses_many_frames_raises_no_alarm_and_hides_no_fault(share, noise):
    lost = {"kind": "drop", "probability": share, "at_s": 20}
    summary = simulate(lost, noise=noise)
    for kind in ("gyro", "accelerometer"):
        found = of(summary, kind)
        assert (found["alarm_s"], found["redundancy_left"]) == (None, True)
    found = of(simulate(lost, {"kind": "gyro_bias", "bias_dph": 40, "sensor": 2, "at_s": 203},
        noise=noise), "gyro")  # fmt: skip
    assert (found["excluded"], found["unresolved_s"]) == ([2], None)
    assert found["alarm_s"] - 200 < 1
    assert found["isolated_s"] - 200 < (60 if share > 0.2 else 10)


def test_what_cannot_be_compared_is_not_redundant():
    for times, redundant in (({"at_s": 103}, False), ({"at_s": 103, "for_s": 30}, True)):
        summary = simulate({"kind": "drop", "message": "SENSOR_3", **times}, duration_s=150)
        for kind in ("gyro", "accelerometer"):
            found = of(summary, kind)
            assert (found["redundancy_left"], found["alarm_s"]) == (redundant, None)


def test_a_stuck_gyro_is_left_out_before_a_fifth_of_a_second():
    for at_s in (203, 230.13):  # turning, and at rest
        found = of(simulate({"kind": "gyro_stuck", "sensor": 2, "at_s": at_s}), "gyro")
        assert (found["excluded"], found["how"]) == ([2], "stuck")
        assert found["isolated_s"] - (at_s - BEGIN_S) < 0.2


@pytest.mark.parametrize(
    "fault",
    [
        {"kind": "accelerometer_bias", "bias_ug": 500},
        {"kind": "accelerometer_ramp", "bias_ug_per_min": 1000},
    ],
)
def test_a_sensor_about_whose_axis_the_table_turns_is_not_stuck_when_another_fails(fault):
    found = of(
        simulate(fault | {"sensor": 2, "at_s": 100}, duration_s=170, noise={}), fault["kind"]
    )
    assert found["excluded"] in (None, [2])
    assert found["alarm_s"] is not None


@pytest.mark.parametrize("noisy", [True, False])
def test_coarse_counts_are_no_fault(noisy):
    coarse = {"gyros": {"resolution_arcsec": 1}, "accelerometers": {"resolution_um_per_s": 1000}}
    noise = {kind: one | (NOISE[kind] if noisy else {}) for kind, one in coarse.items()}
    summary = simulate(noise=noise)
    assert of(summary, "gyro")["alarm_s"] is of(summary, "accelerometer")["alarm_s"] is None
    fault = {"kind": "gyro_bias", "bias_dph": 40, "sensor": 2, "at_s": 203}
    found = of(simulate(fault, noise=noise), "gyro")
    assert (found["excluded"], found["unresolved_s"]) == ([2], None)


@pytest.mark.parametrize("least_first", [True, False])
def test_in_motion_no_sensor_is_left_out_whose_noise_is_a_thousandth_of_anothers(least_first):
    gyros, accelerometers = (5e-4, 0.005, 0.05, 0.5), (1000, 10, 1, 100)
    step = 1 if least_first else -1
    noise = {
        "gyros": {"angle_random_walk_deg_per_sqrt_h": gyros[::step]},
        "accelerometers": {"white_noise_ug_per_sqrt_hz": accelerometers[::step]},
    }
    for seed in (1, 37):
        summary = simulate(scenario="drive_rotating", noise=noise, seed=seed, duration_s=200)
        for kind in ("gyro", "accelerometer"):
            assert of(summary, kind)["excluded"] is None


STEPS = ((10, 2), (10, 15), (1, 2), (1, 10))  # °/h, s since power-on


@pytest.mark.parametrize(("bias_dph", "at_s"), STEPS)
def test_no_navigation_on_an_alignment_that_a_failing_gyro_spoils(bias_dph, at_s):
    """Too early to be found: 10 °/h would leave the heading 30° off, 1 °/h 3.7°."""
    fault = {"kind": "gyro_bias", "bias_dph": bias_dph, "sensor": 2, "at_s": at_s}
    aligned = {"firmware": {"initial_attitude": "self-aligned", "alignment_s": 120}}
    summary = simulate(fault, duration_s=30, estimator={"enabled": True}, **aligned)
    if bias_dph == 10:
        assert summary["firmware"]["fault"] == "ALIGNMENT_FAILED"
    else:
        assert summary["estimator"]["sigma"]["attitude_arcsec"][2] > 3600 * 3.7 / 2


@pytest.mark.parametrize("height_m", [2.5, 0.05])
def test_a_ship_that_sways_is_not_aligned_as_if_it_stood(height_m):
    sway = {"kind": "sway", "wave_height_m": height_m, "wave_period_s": 8, "begins_s": -200}
    aligned = {"firmware": {"initial_attitude": "self-aligned", "alignment_s": 120}}
    summary = simulate(duration_s=10, motion=sway, **aligned)
    assert summary["firmware"]["fault"] == "ALIGNMENT_FAILED"


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["gyro_scale", "gyro_stuck", "accelerometer_scale"])
def test_without_calibration_a_scale_factor_and_a_stuck_sensor_are_found_at_once(kind):
    noise = {name: keys | UNCALIBRATED for name, keys in NOISE.items()}
    for seed in range(2):
        fault = {"kind": kind, "sensor": seed % 4 + 1, "at_s": 1003}
        found = of(simulate(fault, duration_s=1040, noise=noise, seed=seed), kind)
        assert found["excluded"] == [seed % 4 + 1]
        assert -0.01 < found["alarm_s"] - 1000 < 5


SIZES = {
    "bias": ("bias_dph", 1, 100, "bias_ug", 50, 5000),
    "ramp": ("bias_dph_per_min", 0.5, 20, "bias_ug_per_min", 20, 2000),
    "scale": ("scale_ppm", 500, 20_000, "scale_ppm", 200, 20_000),
    "shift_u": ("shift_arcsec", 20, 600, "shift_arcsec", 20, 600),
    "shift_v": ("shift_arcsec", 20, 600, "shift_arcsec", 20, 600),
    "noise": ("angle_random_walk_deg_per_sqrt_h", 0.1, 5, "white_noise_ug_per_sqrt_hz", 100, 5000),
    "stuck": (),
    "dead": (),
    "full_scale": (),
    "absent": (),
}
"""Smallest and largest value of a campaign's faults, of gyros and of accelerometers."""


def random_fault(number):
    """Return a fault: kinds in turn, all else drawn."""
    draw = random.Random(number)
    kinds = [(part, what) for part in ("gyro", "accelerometer") for what in SIZES]
    part, what = kinds[number % len(kinds)]
    fault = {"kind": f"{part}_{what}", "sensor": draw.randint(1, 4), "at_s": draw.uniform(400, 800)}
    if SIZES[what]:
        key, least, most = SIZES[what][:3] if part == "gyro" else SIZES[what][3:]
        size = least * (most / least) ** draw.random()
        fault[key] = size if what == "noise" else size * draw.choice((1, -1))
    if draw.random() < 0.25:
        fault |= {"period_s": draw.uniform(1, 30), "duty": draw.uniform(0.1, 0.9)}
    return fault


@pytest.mark.skipif("RRINS_FAULT_RUNS" not in os.environ, reason="RRINS_FAULT_RUNS is not set")
@pytest.mark.timeout(0)
@pytest.mark.parametrize(
    ("scenario", "changes"),
    [
        ("drive_rotating", {}),
        ("drive_strapdown", {}),
        ("rimu_rotating", {"motion": {"kind": "sway"}}),
        ("rimu_rotating", {}),
    ],
    ids=["drive", "locked", "sea", "standing"],
)
def test_no_sound_sensor_is_left_out(scenario, changes):
    """`RRINS_FAULT_RUNS` runs of each scenario, each with a random fault; calibrated or not."""
    outcome = {"left out": 0, "one of them": 0, "unnoticed": 0}
    wrong = []
    for number in range(int(os.environ["RRINS_FAULT_RUNS"])):
        fault = random_fault(number)
        off = UNCALIBRATED if number // len(SIZES) % 4 > 1 else {}
        noise = {name: keys | off for name, keys in NOISE.items()}
        duration_s = fault["at_s"] + 250
        if "motion" in changes:
            changes = {"motion": changes["motion"] | {"seed": number}}
        run = {"scenario": scenario, "duration_s": duration_s, "noise": noise, "seed": number}
        summary = simulate(fault, **run, **changes)
        own = of(summary, fault["kind"])
        others = [kind for kind in summary["redundancy"].values() if kind is not own]
        early = any(
            kind["alarm_s"] is not None and kind["alarm_s"] < fault["at_s"] - BEGIN_S - 0.1
            for kind in summary["redundancy"].values()
        )
        if early or own["excluded"] not in (None, [fault["sensor"]]) or others[0]["excluded"]:
            wrong.append((number, fault, summary["redundancy"]))
        told = "one of them" if own["unresolved_s"] is not None else "unnoticed"
        outcome["left out" if own["excluded"] else told] += 1
    print(f"\n{scenario} {changes}: {outcome}, wrong {len(wrong)}")
    assert not wrong
