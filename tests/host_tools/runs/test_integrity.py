"""Protection levels: above the error whatever fails, not far above it when nothing does."""

from __future__ import annotations

import math

import numpy as np
import pytest

import rrins
from rrins.firmware_py.core.estimator.fault_effects import FIRST_AID, FIRST_SHIFT
from rrins.firmware_py.core.records.estimator_records import ATTITUDE, HEIGHT, LATITUDE
from rrins.firmware_py.core.records.integrity_records import (
    ALL_ACCELEROMETERS,
    ALL_GYROS,
    ALTIMETER_DRIFT,
    HEADING,
    HORIZONTAL,
    SINCE_BEGIN,
    VERTICAL,
    IntegrityStatus,
)
from rrins.host_tools.campaigns.row import run_fast
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.results.integrity import integrity_summary
from rrins.host_tools.runs.results.integrity_plot import bounded_errors
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import load
from rrins.host_tools.scenario.tables import Integrity

ON = {"enabled": True}
AT_S = 303.0
AVAILABLE, DEGRADED = IntegrityStatus.AVAILABLE, IntegrityStatus.DEGRADED
NOT = IntegrityStatus.NOT_AVAILABLE


def followed(scenario="drive_aided", **changes):
    """Return the run's seconds, and errors and bounds (horizontal, vertical, heading) in each."""
    run = rrins.simulate(scenario, integrity=changes.pop("integrity", ON), **changes)
    seconds, errors = run._result.seconds.estimates, run._result.errors
    at = np.searchsorted(errors.epoch, seconds["epoch"]).clip(0, len(errors) - 1)
    level, height, heading_deg = (error[at] for error in bounded_errors(errors))
    return run, seconds, np.stack([level, height, np.radians(heading_deg)], axis=1)


@pytest.fixture(scope="module")
def healthy():
    return followed(odometer=None)


def test_a_healthy_aided_drive_is_available_and_its_bounds_are_tight(healthy):
    run, seconds, errors = healthy
    assert np.mean(seconds["integrity"] == AVAILABLE) >= 0.99
    assert (errors <= seconds["protection"]).all()
    sigma = np.hypot(seconds["position_sigma"][:, 0], seconds["position_sigma"][:, 1])
    for bound, one in (
        (HORIZONTAL, sigma),
        (VERTICAL, seconds["position_sigma"][:, 2]),
        (HEADING, seconds["attitude_sigma"][:, 2]),
    ):
        assert np.median(seconds["protection"][1:, bound] / one[1:]) < 8
    found = run.summary["integrity"]
    assert found["status"] == "available"
    assert found["available_share"] >= 0.99
    last = seconds["protection"][-1]
    assert found["horizontal_protection_m"] == pytest.approx(last[HORIZONTAL], abs=1e-4)
    assert found["heading_protection_deg"] == pytest.approx(math.degrees(last[HEADING]), abs=1e-5)


FAULTS = {
    "gyro 0.5 °/h": {"kind": "gyro_bias", "sensor": 2, "bias_dph": 0.5},
    "gyro 20 °/h": {"kind": "gyro_bias", "sensor": 3, "bias_dph": -20},
    "gyro ramp": {"kind": "gyro_ramp", "sensor": 1, "bias_dph_per_min": 1},
    "accelerometer 1 mg": {"kind": "accelerometer_bias", "sensor": 4, "bias_ug": 1000},
    "fixes jump a little": {"kind": "gnss_jump", "jump_m": 3},
    "fixes jump": {"kind": "gnss_jump", "jump_m": 100},
    "fixes drift slowly": {"kind": "gnss_pull", "pull_mps": 0.1},
    "fixes drift": {"kind": "gnss_pull", "pull_mps": 0.5},
    "heights jump": {"kind": "altimeter_jump", "jump_m": 30},
    "heights drift slowly": {"kind": "altimeter_pull", "pull_mps": 0.05},
    "heights drift": {"kind": "altimeter_pull", "pull_mps": 1},
}


@pytest.mark.parametrize("name", FAULTS)
def test_under_a_fault_the_error_is_below_its_bound_or_the_navigation_not_available(name):
    _, seconds, errors = followed(
        odometer=None, duration_s=500, faults=[{"at_s": AT_S} | FAULTS[name]]
    )
    misleading = (errors > seconds["protection"]).any(axis=1)
    assert not (misleading & (seconds["integrity"] == AVAILABLE)).any()


@pytest.mark.parametrize("pull_mps", [0.02, 0.05])
def test_an_altimeter_that_drifts_is_covered_even_where_nothing_else_knows_the_height(pull_mps):
    pull = {"at_s": AT_S, "kind": "altimeter_pull", "pull_mps": pull_mps}
    run, seconds, errors = followed(gnss=None, duration_s=500, faults=[pull])
    assert errors[-1, VERTICAL] > 2 * seconds["position_sigma"][-1, 2]
    assert (errors <= seconds["protection"]).all()
    assert (seconds["integrity"] != NOT).all()
    assert run.summary["integrity"]["limited_by"][VERTICAL] == "altimeter drift"


@pytest.mark.parametrize("aids", [{}, {"odometer": None}])
def test_once_a_gyro_is_left_out_the_navigation_is_of_use(aids):
    """Another may fail, which no parity would show; but hardly just now."""
    fault = {"kind": "gyro_bias", "sensor": 2, "bias_dph": 10, "at_s": AT_S}
    run, seconds, errors = followed(duration_s=600, faults=[fault], **aids)
    isolated_s = run.summary["redundancy"]["gyros"]["isolated_s"]
    after = slice(round(isolated_s) + 15, None)
    assert (seconds["integrity"][after] == DEGRADED).all()
    assert (errors <= seconds["protection"])[after].all()


@pytest.mark.parametrize("jump_m", [2, -100])
def test_an_altimeter_that_jumps_beside_a_receiver_is_learned_anew(jump_m):
    _, seconds, errors = followed(
        odometer=None,
        duration_s=500,
        faults=[{"at_s": AT_S, "kind": "altimeter_jump", "jump_m": jump_m}],
    )
    before, after = seconds[round(AT_S) - 2], seconds[round(AT_S) + 60 :]
    assert (after["integrity"] == AVAILABLE).all()
    assert (after["protection"][-1] < 2 * before["protection"]).all()
    learned = after["altimeter_bias"][-1] - before["altimeter_bias"]
    assert learned == pytest.approx(jump_m, abs=1)
    assert errors[:, VERTICAL].max() < 1


PASSES = {
    "receiver jumps": {"kind": "gnss_jump", "jump_m": 20},
    "receiver is led away": {"kind": "gnss_pull", "pull_mps": 0.5},
    "wheel slips": {"kind": "odometer_slip", "slip_percent": 5},
}
LASTS_S, FORGOTTEN_AFTER_S = 30, 25


@pytest.mark.parametrize("name", PASSES)
def test_a_fault_of_an_aid_that_passes_leaves_no_trace(name):
    """It degrades while it lasts: odometer and receiver tell which of the two it is."""
    fault = {"at_s": AT_S, "for_s": LASTS_S} | PASSES[name]
    _, seconds, errors = followed(duration_s=500, faults=[fault])
    assert (errors < seconds["protection"]).all()
    begun, ended = round(AT_S), round(AT_S) + LASTS_S
    assert (seconds["integrity"][begun + 2 : begun + 14] > AVAILABLE).all()
    assert (seconds["integrity"][10:] <= DEGRADED).all()
    after = seconds[ended + FORGOTTEN_AFTER_S :]
    assert (after["integrity"] == AVAILABLE).all()
    assert (after["protection"][-1] < 2 * seconds["protection"][begun - 2]).all()


def test_what_a_sensor_has_left_of_the_velocity_is_not_taken_for_a_fault_of_the_receiver():
    """The navigation falls by 2 m/s when a sensor that was off by 0.3 g is left out."""
    fault = {"at_s": 200.0, "kind": "accelerometer_bias", "sensor": 1, "bias_ug": 3e5}
    _, seconds, errors = followed(duration_s=230, faults=[fault])
    assert (errors < seconds["protection"]).all()


@pytest.mark.parametrize(
    ("fault", "of_use"),
    [({"at_s": AT_S}, 1.0), ({"at_s": AT_S + 0.4}, 1.0), ({"period_s": 25, "duty": 0.8}, 0.98)],
)
def test_a_wheel_that_locks_is_known_for_it(fault, of_use):
    """For good, from within a second on, or now and then; where the car stops, it agrees."""
    lock = {"at_s": AT_S, "kind": "odometer_lock"} | fault
    _, seconds, errors = followed(duration_s=700, faults=[lock])
    assert (errors < seconds["protection"]).all()
    after = seconds[round(AT_S) :]
    assert np.mean(after["integrity"] <= DEGRADED) >= of_use
    assert np.mean(after["integrity"] == AVAILABLE) < 0.1
    assert (after["protection"][-1] < 4 * seconds["protection"][round(AT_S) - 2]).all()


@pytest.mark.parametrize(
    ("slips", "status"),
    [
        ({"slip_percent": 40}, AVAILABLE),
        ({"slip_percent": 10, "period_s": 25, "duty": 0.5}, DEGRADED),
    ],
)
def test_a_wheel_that_slips_leaves_the_navigation_of_use(slips, status):
    slip = {"at_s": AT_S, "kind": "odometer_slip"} | slips
    _, seconds, errors = followed(duration_s=700, faults=[slip])
    assert (errors < seconds["protection"]).all()
    assert np.mean(seconds["integrity"][round(AT_S) :] <= status) > 0.94


@pytest.mark.parametrize("odometer", [True, False])
def test_a_receiver_that_has_jumped_for_good_bounds_the_error_by_its_distance(odometer):
    """Its fixes may be right; of the sensors they say nothing more."""
    changes = {} if odometer else {"odometer": None}
    jump = {"at_s": AT_S, "kind": "gnss_jump", "jump_m": 100}
    _, seconds, errors = followed(duration_s=500, faults=[jump], **changes)
    assert (errors < seconds["protection"]).all()
    assert errors[:, HORIZONTAL].max() < 1
    last = seconds[round(AT_S) + 60 :]
    assert (last["integrity"] == DEGRADED).all()
    level = last["protection"][:, HORIZONTAL]
    assert ((level > 100) & (level < 115)).all()
    assert last["protection"][:, VERTICAL].max() < 3


def test_a_drift_that_is_followed_is_suspected_before_it_is_ten_metres():
    """Without a second aid nothing else shows that fixes and velocities are led away together."""
    _, seconds, errors = followed(
        odometer=None, duration_s=500, faults=[{"at_s": AT_S} | FAULTS["fixes drift"]]
    )
    doubtful = seconds["integrity"] != AVAILABLE
    assert errors[np.argmax(doubtful), HORIZONTAL] < 10
    assert not doubtful[:290].any()


SCALE_PPM = 5.0
PLUS_ONE = {"geometry": "orthogonal-plus-one"}
EFFECTS = {
    1: ({"kind": "gyro_bias", "sensor": 2, "bias_dph": 0.02}, math.radians(0.02 / 3600)),
    FIRST_AID + ALL_GYROS: ({"kind": "gyro_scale", "scale_ppm": SCALE_PPM}, SCALE_PPM * 1e-6),
    FIRST_AID + ALL_ACCELEROMETERS: (
        {"kind": "accelerometer_scale", "scale_ppm": SCALE_PPM},
        SCALE_PPM * 1e-6,
    ),
    FIRST_SHIFT: ({"kind": "gyro_bias", "bias_dph": 0.02}, math.radians(0.02 / 3600)),
    FIRST_SHIFT + 1: ({"kind": "accelerometer_bias", "bias_ug": 50}, 50e-6 * 9.80665),
}


@pytest.mark.parametrize("number", EFFECTS)
def test_the_effect_of_a_fault_is_what_the_fault_does(number):
    """Two runs alike but for the fault: the error differs by the effect times the fault's size."""
    (fault, size), ends = EFFECTS[number], []
    for faults in ((), (fault | {"at_s": 3.0},)):
        changes = {"odometer": None, "integrity": ON, "faults": faults}
        # All alike: a tetrahedron would cancel it.
        scenario = load("drive_aided", duration_s=60, rimu=PLUS_ONE, **changes)
        ends.append(run_fast(scenario, firmware_settings(scenario), 20))
    (ram, without), (_, with_fault) = ends
    effect = ram[0].integrity.faults[number]["effects"][SINCE_BEGIN]["state"]
    turned = math.radians((with_fault.turn_up_arcsec[-1] - without.turn_up_arcsec[-1]) / 3600)
    # An error of the filter is what has to be added; the errors are navigation minus truth.
    least = 1e-7 if number == FIRST_SHIFT + 1 else 1e-8  # which hardly turns it
    assert turned == pytest.approx(-size * effect[2], rel=0.02, abs=least)
    moved = with_fault.position_north_m[-1] - without.position_north_m[-1]
    expected = -size * effect[6] * ram[0].estimator.north_radius
    assert moved == pytest.approx(expected, rel=0.05, abs=1e-4)


def test_the_effect_of_an_altimeter_that_drifts_is_that_of_a_drift():
    """At a time when no large correction has yet to be fed back, as there is at 60 s."""
    pull_mps, heights = 0.01, []
    for faults in ((), ({"kind": "altimeter_pull", "pull_mps": pull_mps, "at_s": 3.0},)):
        scenario = load("drive_aided", duration_s=120, integrity=ON, faults=faults)
        ram, result = run_fast(scenario, firmware_settings(scenario), 20)
        heights.append(result.height_m[-1])
    drift = ram[0].integrity.faults[FIRST_AID + ALTIMETER_DRIFT]["effects"][SINCE_BEGIN]
    assert heights[1] - heights[0] == pytest.approx(-pull_mps * drift["state"][HEIGHT], rel=0.05)


def test_in_an_outage_the_bound_grows_with_the_error():
    outage = [{"at_s": 200, "for_s": 100}]
    _, seconds, errors = followed(odometer=None, duration_s=400, gnss={"outages": outage})
    bound = seconds["protection"][:, HORIZONTAL]
    assert bound[295] > 4 * bound[195]
    assert bound[390] < 2 * bound[195]
    assert (errors[:, HORIZONTAL] <= bound).all()


def test_without_an_aid_the_bound_grows_until_the_alert_limit():
    _, seconds, errors = followed(
        "rimu_rotating", estimator=ON, duration_s=1200,
        gyros={"angle_random_walk_deg_per_sqrt_h": 0.005},
        integrity=ON | {"horizontal_alert_m": 300},
    )  # fmt: skip
    assert (
        errors[:, [HORIZONTAL, HEADING]] <= seconds["protection"][:, [HORIZONTAL, HEADING]]
    ).all()
    level = seconds["protection"][:, HORIZONTAL]
    assert np.median(level[1:] / seconds["position_sigma"][1:, :2].max(axis=1)) < 8
    first = np.argmax(level > 300)
    assert first > 100
    assert (seconds["integrity"][first:] == IntegrityStatus.NOT_AVAILABLE).all()


@pytest.mark.parametrize(
    ("at_s", "unknown", "bound"), [(125, ATTITUDE + 2, HEADING), (510, LATITUDE, HORIZONTAL)]
)
def test_a_bound_that_leaves_the_whole_circle_open_is_none(at_s, unknown, bound):
    scenario = load("drive_outage").model_copy(update={"integrity": Integrity(enabled=True)})
    run = FastRun.of(firmware_settings(scenario), hardware_settings(scenario))
    run.run(at_s * scenario.rate_hz)  # where no measurement narrows it down at once
    ram = run.ram[0]
    assert math.isfinite(ram.integrity.protection[bound])
    ram.estimator.P[unknown, unknown] = 4.0**2
    run.run(2 * scenario.rate_hz)
    assert ram.integrity.protection[bound] == math.inf
    assert ram.integrity.status == IntegrityStatus.NOT_AVAILABLE
    found = integrity_summary(run.ram)
    assert (
        found["heading_protection_deg" if bound == HEADING else "horizontal_protection_m"] is None
    )


def test_it_needs_the_estimator():
    with pytest.raises(rrins.ScenarioError, match=r"integrity\.enabled: needs estimator\.enabled"):
        rrins.load_scenario("rimu_rotating", integrity=ON)
