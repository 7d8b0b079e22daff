"""A sensor that was left out comes back by order of the operator, after a test that it passes."""

from __future__ import annotations

import functools
import math

import pytest

import rrins
from tests.host_tools.runs.noisy_runs import WHITE_NOISE

BEFORE_S = 2.995
"""Navigation begins this long after power-on."""

FAULT = {"kind": "gyro_bias", "sensor": 2, "bias_dph": 10, "at_s": 203}
PROTOTYPE = {"sensors": "prototype", "gyros": {}, "accelerometers": {}}


def simulate(faults, *orders, duration_s=500, **changes):
    redundancy = {
        "enabled": True,
        "readmit": [{"kind": "gyro", "sensor": 2, "test_s": 30} | order for order in orders],
    }
    changes = {"scenario": "rimu_rotating", "duration_s": duration_s} | changes
    return rrins.simulate(faults=faults, redundancy=redundancy, **changes)


def gyros_of(run):
    return run.summary["redundancy"]["gyros"]


def worst_m(run):
    error = run.summary["max_abs_position_error_m"]
    return math.hypot(error["east"], error["north"])


@pytest.mark.parametrize("preset", [{}, PROTOTYPE])
def test_a_sensor_that_is_well_again_comes_back_and_the_next_fault_is_found(preset):
    again = {"kind": "gyro_bias", "sensor": 3, "bias_dph": 20, "at_s": 403}
    run = simulate([FAULT | {"for_s": 100}, again], {"at_s": 353}, **preset)
    gyros = gyros_of(run)
    assert (gyros["readmitted"], gyros["readmission_refused"]) == (2, None)
    assert gyros["readmitted_s"] == pytest.approx(353 + 30 - BEFORE_S, abs=1.1)
    assert (gyros["sensor"], gyros["excluded"], gyros["how"]) == (3, [3], "standing")
    assert gyros["alarm_s"] == pytest.approx(403 - BEFORE_S, abs=0.5)
    assert gyros["isolated_s"] == pytest.approx(403 - BEFORE_S, abs=2.0)
    assert worst_m(run) < 1.3 * worst_m(simulate([], **preset))


def test_the_navigation_uses_it_again():
    healthy = simulate([], **PROTOTYPE)
    left_out = simulate([FAULT | {"for_s": 100}], **PROTOTYPE)
    back = simulate([FAULT | {"for_s": 100}], {"at_s": 353}, **PROTOTYPE)
    assert gyros_of(left_out)["excluded"] == [2]
    assert not gyros_of(left_out)["redundancy_left"]
    assert gyros_of(back)["excluded"] is None
    assert gyros_of(back)["redundancy_left"]
    hashes = {run.summary["navigation_sha256"] for run in (healthy, left_out, back)}
    assert len(hashes) == 3


@pytest.mark.parametrize(
    ("fault", "why"),
    [
        ({}, "parity"),
        ({"kind": "gyro_absent"}, "missing"),
        ({"kind": "gyro_stuck"}, "stuck"),
        ({"kind": "gyro_noise"}, "parity"),
    ],
)
def test_one_that_still_fails_is_refused(fault, why):
    fault = {"kind": "gyro_bias", "sensor": 2, "at_s": 203} | fault
    run = simulate([fault], {"at_s": 253}, duration_s=330, **PROTOTYPE)
    gyros = gyros_of(run)
    assert (gyros["excluded"], gyros["readmitted"]) == ([2], None)
    assert gyros["readmission_refused"] == why


def test_one_that_is_in_use_or_is_not_there_is_refused():
    run = simulate([FAULT], {"at_s": 253, "sensor": 3}, duration_s=260)
    assert gyros_of(run)["readmission_refused"] == "not_left_out"
    assert gyros_of(run)["excluded"] == [2]


def test_another_bias_is_refused_unless_it_is_learned_anew_and_then_does_no_harm():
    faults = [
        FAULT | {"for_s": 100},
        {"kind": "gyro_bias", "sensor": 2, "bias_dph": 3, "at_s": 303},
    ]
    as_it_was = simulate(faults, {"at_s": 353})
    assert gyros_of(as_it_was)["readmission_refused"] == "parity"
    anew = simulate(faults, {"at_s": 353, "anew": True, "test_s": 600}, duration_s=1100)
    assert (gyros_of(anew)["readmitted"], gyros_of(anew)["excluded"]) == (2, None)
    left_out = simulate(faults, {"at_s": 1000, "sensor": 1}, duration_s=1100)
    assert worst_m(anew) < 1.1 * worst_m(left_out)


def test_a_bias_far_beyond_the_data_sheet_is_refused():
    faults = [FAULT | {"bias_dph": 50}]
    run = simulate(faults, {"at_s": 253, "anew": True, "test_s": 60}, duration_s=400)
    assert gyros_of(run)["readmission_refused"] == "limits"


def test_with_frames_it_is_the_same_to_the_bit():
    faults = [FAULT | {"at_s": 33, "for_s": 10, "bias_dph": 100}]
    order = {"at_s": 53, "test_s": 10}
    direct = simulate(faults, order, duration_s=80)
    with_frames = simulate(faults, order, duration_s=80, frames=True)
    assert gyros_of(direct)["readmitted"] == 2
    for key in ("navigation_sha256", "redundancy"):
        assert with_frames.summary[key] == direct.summary[key]


@pytest.mark.slow
def test_of_six_one_comes_back_in_motion_while_another_stays_out():
    noise = {"angle_random_walk_deg_per_sqrt_h": 0.005}
    six = {"rimu": {"geometry": "dodecahedron"}, "gyros": noise, "accelerometers": {}}
    six["scenario"] = "drive_rotating"
    faults = [
        {"kind": "gyro_bias", "sensor": 2, "bias_dph": 100, "at_s": 203, "for_s": 60},
        {"kind": "gyro_bias", "sensor": 5, "bias_dph": 100, "at_s": 283},
    ]
    run = simulate(faults, {"at_s": 353}, duration_s=500, **six)
    gyros = gyros_of(run)
    assert (gyros["excluded"], gyros["readmitted"]) == ([5], 2)
    assert (gyros["unresolved_s"], gyros["redundancy_left"]) == (None, True)


in_soak = functools.partial(pytest.param, marks=pytest.mark.soak)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("off_by_dph", "test_s", "seeds", "least", "most"),
    [
        (0, 60, 4, 4, 4),
        (1, 60, 4, 0, 0),
        in_soak(0, 60, 20, 20, 20),
        in_soak(0.5, 60, 20, 1, 8),
        in_soak(0.5, 600, 20, 0, 3),
        in_soak(1, 60, 20, 0, 0),
        in_soak(2, 60, 20, 0, 0),
    ],
)
def test_how_many_pass(off_by_dph, test_s, seeds, least, most):
    """With the prototype's white noise; the parity has been learned for 600 s."""
    passed = 0
    for seed in range(seeds):
        bad = {"kind": "gyro_bias", "sensor": seed % 4 + 1}
        faults = [bad | {"bias_dph": 100, "at_s": 603, "for_s": 30}]
        if off_by_dph:
            faults.append(bad | {"bias_dph": off_by_dph, "at_s": 633})
        order = {"at_s": 653, "sensor": seed % 4 + 1, "test_s": test_s}
        run = simulate(faults, order, duration_s=690 + test_s, seed=seed, **WHITE_NOISE)
        assert gyros_of(run)["sensor"] == seed % 4 + 1
        passed += gyros_of(run)["readmitted"] is not None
    assert least <= passed <= most
