"""How well it navigates: the figures that the scheme is judged by.

Without frames, which is the same to the bit: `test_fast.py`.
"""

from __future__ import annotations

import pytest

from rrins.host_tools.runs.direct import run_without_frames
from rrins.host_tools.runs.results.results import read_errors
from rrins.host_tools.scenario.scenario import Scenario, load


@pytest.fixture(scope="module")
def largest(tmp_path_factory):
    found = {}

    def run(scenario: Scenario):
        key = scenario.model_dump_json()
        if key not in found:
            folder = tmp_path_factory.mktemp("run")
            firmware = run_without_frames(scenario, folder).firmware
            assert firmware["fault"] == "NONE"
            found[key] = read_errors(folder, scenario.rate_hz).largest()
        return found[key]

    return run


def worst(figures, key):
    return max(figures[key].values())


def variant(**sections):
    table = {"duration_s": 1600, "mode": "rotating"} | sections
    return Scenario.model_validate(table)


def test_ideal_sensors_stay_within_5_mm_over_a_cycle(largest):
    assert worst(largest(load("ideal")), "max_abs_position_error_m") < 5e-3


@pytest.mark.parametrize("weight", [1e6, 1e12])
def test_ideal_sensors_of_very_different_weight_navigate_as_well(largest, weight):
    weights = {"gyro_weights": [1, 1, 1, weight], "accelerometer_weights": [weight, 1, 1, 1]}
    figures = largest(variant(duration_s=100, firmware=weights))
    assert worst(figures, "max_abs_position_error_m") < 1e-3


@pytest.mark.parametrize(
    "site",
    [
        {"latitude_deg": 0, "longitude_deg": 0, "height_m": 0},
        {"latitude_deg": -67, "longitude_deg": -179.9999999, "height_m": 3000},
        {"latitude_deg": 85, "longitude_deg": 179.9999999, "height_m": -100},
    ],
)
def test_ideal_sensors_stay_within_5_mm_anywhere(largest, site):
    body = {"roll_deg": 3, "pitch_deg": -2, "heading_deg": 123}
    figures = largest(variant(duration_s=400, site=site, body=body))
    assert worst(figures, "max_abs_position_error_m") < 5e-3


@pytest.mark.parametrize("rate_hz", [100, 400])
def test_ideal_sensors_stay_within_5_mm_at_other_rates(largest, rate_hz):
    figures = largest(variant(duration_s=800, rate_hz=rate_hz))
    assert worst(figures, "max_abs_position_error_m") < 5e-3


def test_ideal_six_sensors_on_a_dodecahedron(largest):
    alpha = 63.4349488
    axes = [[0, 0], *([alpha, 72 * k] for k in range(5))]
    rimu = {"geometry": "custom", "gyro_axes_deg": axes, "accelerometer_axes_deg": axes}
    assert worst(largest(variant(duration_s=400, rimu=rimu)), "max_abs_position_error_m") < 5e-3


def test_the_turning_rimu_stays_within_10_m_and_beats_the_standing_one(largest):
    rotating, strapdown = largest(load("rimu_rotating")), largest(load("rimu_strapdown"))
    assert worst(rotating, "max_abs_position_error_m") < 10
    assert worst(rotating, "max_abs_velocity_error_mps") < 0.02
    for axis in ("east", "north"):
        ratio = (
            strapdown["max_abs_position_error_m"][axis] / rotating["max_abs_position_error_m"][axis]
        )
        assert ratio > 100


def test_redundancy_beats_three_sensors(largest):
    for mode in ("strapdown", "rotating"):
        rimu, imu = largest(load(f"rimu_{mode}")), largest(load(f"imu_{mode}"))
        assert worst(rimu, "max_abs_position_error_m") < worst(imu, "max_abs_position_error_m")


def test_noise_makes_the_error_grow_and_the_seed_repeats_it(tmp_path):
    noisy = {"angle_random_walk_deg_per_sqrt_h": 0.01}
    digests = []
    for seed in (1, 1, 2):
        scenario = variant(duration_s=20, gyros=noisy, seed=seed)
        firmware = run_without_frames(scenario).firmware
        digests.append(firmware["navigation_sha256"])
    assert digests[0] == digests[1] != digests[2]


def test_a_self_aligned_start_carries_the_known_heading_error(tmp_path):
    # An east gyro bias b turns the found heading by b / (Ω cos φ).
    scenario = variant(
        duration_s=1,
        mode="strapdown",
        rimu={"geometry": "orthogonal"},
        gyros={"bias_dph": [0.01, 0.0, 0.0]},
        firmware={"initial_attitude": "self-aligned", "alignment_s": 120},
    )
    run_without_frames(scenario, tmp_path)
    error_deg = read_errors(tmp_path, 200).heading_deg[0]
    earth_dph = 15.041
    expected_deg = 0.01 / (earth_dph * 0.7620) * 57.2958  # cos(40.3554°)
    assert abs(error_deg) == pytest.approx(expected_deg, rel=2e-3)


def test_a_scheme_that_never_turns_back_goes_on_through_the_wrap_of_the_encoder(tmp_path):
    # Two turns of the inner axis a cycle; the frames count 32 turns either way.
    scenario = variant(
        rate_hz=50,
        turntable={"inner": {"rate_limit_dps": 60}, "outer": {"rate_limit_dps": 60}},
        firmware={"scheme": "8-position", "turn_rate_dps": 30, "stand_s": 3.5},
    )
    firmware = run_without_frames(scenario, tmp_path).firmware
    errors = read_errors(tmp_path, 50)
    assert errors.inner_deg.max() > 32 * 360
    assert firmware["mode"] == "SHUTDOWN"
    assert firmware["axes_not_following"] == [False, False]
    assert firmware["scheme_cycles"] == 1600 / (8 * 9.5) // 1
    assert abs(errors.heading_deg).max() < 1e-4


def test_rotation_can_be_left_and_taken_up_again():
    operator = [
        {"at_s": 1, "request": "NAVIGATE_ROTATING"},
        {"at_s": 10, "request": "NAVIGATE_STRAPDOWN"},
        {"at_s": 12, "request": "NAVIGATE_ROTATING"},
    ]
    firmware = run_without_frames(variant(duration_s=60, operator=operator)).firmware
    assert firmware["axes_not_following"] == [False, False]
    assert firmware["fault"] == "NONE"
