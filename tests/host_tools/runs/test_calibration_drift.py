"""Scale factors that have drifted since the calibration are reported, those that have not are not.

The truth is analytic: the sensors' errors are what the calibration says, drawn with its standard
deviations, plus the drift that is put into the sensors.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

import rrins
from rrins.host_tools.rounding import rounded
from rrins.host_tools.runs.results.findings import FINDINGS

SIGMA = {
    "gyros": {
        "scale_error_ppm": 2.0,
        "asymmetric_scale_error_ppm": 3.5,
        "installation_u_arcsec": 0.45,
        "installation_v_arcsec": 0.36,
    },
    "accelerometers": {
        "scale_error_ppm": 0.5,
        "asymmetric_scale_error_ppm": 0.9,
        "installation_u_arcsec": 0.1,
        "installation_v_arcsec": 0.09,
    },
}
NOISE = {
    "gyros": {"angle_random_walk_deg_per_sqrt_h": 0.005},
    "accelerometers": {"white_noise_ug_per_sqrt_hz": 10.0},
}
SPREAD = {
    "scale_error_ppm": 50.0,
    "asymmetric_scale_error_ppm": 20.0,
    "installation_u_arcsec": 20.0,
    "installation_v_arcsec": 20.0,
}
LOST = 1 / 3
"""Square of the input axes' component along which the 16 positions tell nothing (y or x)."""

EXPECTED = 3.0
"""Mean of the square of three normal components: the distance of sensors that have not drifted."""


def calibrated_run(tmp_path, seed, drift=None, with_sigma=True, **more):
    """Return what a cycle of the 16 positions says of a calibration; `drift` adds to the truth."""
    random = np.random.default_rng(seed)
    lines, tables = ["[calibrated]", "date_utc = 2026-11-01T08:00:00Z", "temperature_c = 22.5"], {}
    for kind, sigmas in SIGMA.items():
        true = {key: random.normal(0.0, SPREAD[key], 4) for key in sigmas}
        lines.append(f"[{kind}]")
        for key, values in true.items():
            found = values + random.normal(0.0, sigmas[key], 4)
            lines.append(f"{key} = {found.tolist()}")
        if with_sigma:
            lines.append(f"[{kind}.sigma]")
            lines += [f"{key} = {sigma}" for key, sigma in sigmas.items()]
        for key, changes in (drift or {}).get(kind, {}).items():
            true[key] = true[key] + np.array(changes)
        tables[kind] = NOISE[kind] | {key: values.tolist() for key, values in true.items()}
        tables[kind] |= more.get(kind, {})
    path = tmp_path / f"cal{seed}.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return rrins.simulate(
        "rimu_rotating",
        duration_s=1600,
        seed=seed,
        rate_hz=50,
        firmware={"calibration": str(path)},
        **tables,
    )


def state_of(run, kind):
    return run.summary["firmware"]["calibrated"][kind]


def only(sensor, ppm):
    return [ppm if k == sensor - 1 else 0.0 for k in range(4)]


def test_what_has_not_drifted_is_not_reported_and_the_distance_is_in_sigmas(tmp_path):
    squares = {"gyros": [], "accelerometers": []}
    for seed in range(5):
        run = calibrated_run(tmp_path, seed)
        for kind, found in squares.items():
            assert state_of(run, kind)["state"] == "kept"
            assert state_of(run, kind)["drifted_s"] is None
            found.append(state_of(run, kind)["distance_sigma"] ** 2)
    # Five squares of three components each: a chi-square of 15.
    low, high = chi2.ppf([0.0005, 0.9995], 15) / 15
    for found in squares.values():
        assert low < np.mean(found) / EXPECTED < high


@pytest.mark.parametrize("sensor", [1, 2, 3, 4])
def test_a_gyro_that_has_drifted_is_reported(tmp_path, sensor):
    drift = {"gyros": {"scale_error_ppm": only(sensor, 100.0)}}
    run = calibrated_run(tmp_path, 10 * sensor, drift)
    gyros = state_of(run, "gyros")
    assert gyros["state"] == "drifted"
    assert gyros["distance_sigma"] > gyros["limit_sigma"]
    # As far as the turns show it; σ of what is learned is 5 ppm of one sensor.
    assert 100 * np.sqrt(1 - 2 * LOST) - 20 < gyros["drift_ppm"] < 120
    assert 0 < gyros["drifted_s"] < 1600
    assert state_of(run, "accelerometers")["state"] == "kept"
    assert run.summary["redundancy"]["gyros"]["alarm_s"] is None
    origin, line = FINDINGS[0].lines(run.summary["firmware"])
    assert origin.startswith("sensors calibrated on 2026-11-01, ")
    assert origin.endswith(" days ago, at 22.5 °C")
    assert line.startswith("gyros: ")
    assert f"drifted by {rounded(gyros['drift_ppm'])} ppm" in line


def test_an_accelerometer_that_has_drifted_is_reported(tmp_path):
    for seed in range(2):
        drift = {"accelerometers": {"scale_error_ppm": only(2, 25.0)}}
        run = calibrated_run(tmp_path, seed, drift)
        assert state_of(run, "accelerometers")["state"] == "drifted"
        assert state_of(run, "gyros")["state"] == "kept"


def test_installation_that_has_changed_is_reported(tmp_path):
    drift = {"gyros": {"installation_v_arcsec": only(1, 25.0)}}  # 121 ppm
    assert state_of(calibrated_run(tmp_path, 1, drift), "gyros")["state"] == "drifted"


def test_what_the_data_sheet_lets_change_is_no_drift(tmp_path):
    drift = {"gyros": {"scale_error_ppm": only(2, 60.0)}}
    unstable = {"gyros": {"scale_repeatability_ppm": 60.0}}
    assert state_of(calibrated_run(tmp_path, 1, drift), "gyros")["state"] == "drifted"
    assert state_of(calibrated_run(tmp_path, 1, drift, **unstable), "gyros")["state"] == "kept"


def test_without_standard_deviations_nothing_is_compared(tmp_path):
    drift = {"gyros": {"scale_error_ppm": only(2, 100.0)}}
    run = calibrated_run(tmp_path, 1, drift, with_sigma=False)
    calibrated = run.summary["firmware"]["calibrated"]
    assert calibrated["date_utc"] == "2026-11-01T08:00:00Z"
    assert calibrated["temperature_c"] == 22.5
    assert calibrated["age_days"] > 0
    assert calibrated["gyros"]["state"] == "not_compared"
    assert calibrated["gyros"]["distance_sigma"] is None


def test_a_run_without_a_calibration_says_nothing_of_one():
    run = rrins.simulate("rimu_rotating", duration_s=10)
    assert run.summary["firmware"]["calibrated"] is None
