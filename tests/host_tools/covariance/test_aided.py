"""The aided analysis against the filter's own, single runs, and many runs."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest

from rrins.firmware_py.core.records.estimator_records import Aid
from rrins.host_tools.campaigns import covariance_report
from rrins.host_tools.campaigns.definition import Wishes, load
from rrins.host_tools.covariance.aided import Aided
from rrins.host_tools.covariance.analysis import QUANTITIES, analyse
from rrins.host_tools.covariance.linear import HORIZONTAL
from rrins.host_tools.covariance.sources import sources_of
from rrins.host_tools.covariance.trace import trace_of
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.results.results import compare
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    given_pose,
    hardware_settings,
)

NAVIGATION_STATES = 9
CAR = {
    "title": "a car with a receiver", "mode": "rotating", "duration_s": 400.0, "rate_hz": 100,
    "motion": {"kind": "drive", "duration_s": 900.0},
    "gnss": {"outages": [{"at_s": 102.0, "for_s": 60.0}]},
    "firmware": {"height_channel": "free", "scheme": "16-position", "turn_rate_dps": 2.0,
                 "stand_s": 10.0, "alignment_s": 1.0, "heading_error_sigma_arcsec": 300.0,
                 "level_error_sigma_arcsec": 30.0},
    "redundancy": {"enabled": False},
    "estimator": {"enabled": True},
}  # fmt: skip
WHEEL = {"noise_mps": 0.02, "lever_arm_m": [-0.8, -1.2, -0.6]}


def car(**tables):
    """Return the car with keys of some tables changed."""
    changed = {name: CAR.get(name, {}) | table for name, table in tables.items()}
    return load(CAR | changed, Wishes()).scenario


def with_keys(scenario, duration_s, **keys):
    return load(scenario, Wishes(duration_s=duration_s, set=keys)).scenario


CONSTANTS = {"rate_hz": 100, "estimator.constants": True, "estimator.fine_alignment_s": 20.0}


@pytest.mark.parametrize(
    "scenario",
    [
        car(gnss={"latency_s": 0.0}, odometer=WHEEL, altimeter={"noise_m": 0.5}),
        car(gnss={"rate_hz": 10, "latency_s": 0.05, "lever_arm_m": [1.0, 2.0, 1.5]}),
        car(gnss={"position_correlated_noise_m": 1.0}, estimator={"detects_standing": True}),
        with_keys("rimu_rotating_aligned", 10.0, **CONSTANTS),
        with_keys("ship_moored", 5.0, **{"rate_hz": 100, "estimator.fine_alignment_s": 20.0}),
    ],
    ids=["wheel", "ten-hz", "lasting", "constants", "ship"],
)
def test_the_trace_is_the_filters(scenario):
    """With its transitions, rows and gains, what is left of each P is the noise of a second.

    That noise is diagonal but for white noise within attitude and velocity, and what sways.
    """
    found = trace_of(scenario.model_copy(update={"duration_s": min(scenario.duration_s, 20.0)}))
    layout, n = found.layout, len(found.P[0])
    noisy = np.eye(n, dtype=bool)
    noisy[:3, :3] = noisy[3:6, 3:6] = True
    sway = NAVIGATION_STATES + layout.gyros + layout.accelerometers
    if scenario.firmware.initial_attitude == "self-aligned-swaying":
        noisy[sway : sway + 4, sway : sway + 4] = True
    assert any(second.takes for second in found.seconds)
    for P, second, after in zip(found.P, found.seconds, found.P[1:], strict=False):
        for take in second.takes:
            left = np.eye(n) - np.outer(take.gain, take.row)
            P = left @ P @ left.T + take.sigma**2 * np.outer(take.gain, take.gain)
        scale = np.sqrt(np.maximum(np.diag(after), 1e-30))
        noise = (after - second.phi @ P @ second.phi.T) / np.outer(scale, scale)
        assert np.abs(noise[~noisy]).max() < 1e-9
        assert np.linalg.eigvalsh(0.5 * (noise + noise.T)).min() > -1e-9


def test_each_measurement_is_in_the_trace_once():
    found = trace_of(car(odometer=WHEEL).model_copy(update={"duration_s": 60.0}))
    used = [(take.aid, take.component) for second in found.seconds for take in second.takes]
    assert used.count((Aid.GNSS_POSITION, 0)) == used.count((Aid.GNSS_VELOCITY, 2)) == 60
    assert used.count((Aid.ODOMETER, 0)) == 58  # of a stretch between counts of two seconds


MATCHED = {
    "gyros": {"angle_random_walk_deg_per_sqrt_h": 0.05, "rate_random_walk_dph_per_sqrt_h": 1.0,
              "bias_repeatability_dph": 1.0},
    "accelerometers": {"white_noise_ug_per_sqrt_hz": 50.0, "random_walk_ug_per_sqrt_h": 100.0,
                       "bias_repeatability_ug": 200.0},
    "gnss": {"position_correlated_noise_m": 1.0, "position_correlation_s": 60.0,
             "outages": [{"at_s": 150.0, "for_s": 100.0}]},
    "altimeter": {"noise_m": 0.5, "random_walk_m_per_sqrt_h": 1.0},
    "estimator": {"enabled": True, "zero_velocity_sigma_mps": 1e-4, "position_sigma_m": 1e-3},
}  # fmt: skip
"""Errors of exactly the kinds and sizes that the filter assumes."""


def test_where_the_filters_models_are_true_its_sigma_is_true():
    found = analyse(with_keys(car(**MATCHED), 300.0))
    assert found.left_out == []
    for name in QUANTITIES:
        true, told = found.quantity(name)
        assert true[5:] == pytest.approx(told[5:], rel=2e-3), name
    assert found.filter_sigmas is not None
    shares = sum(one.variance[-1] for one in found.sources)
    assert shares == pytest.approx(found.sigmas[-1] ** 2)
    assert "within 10 %" in covariance_report.confidence(found)


def test_a_receiver_worse_than_it_tells_is_seen_as_such():
    """Noise of twice the size: its share of the variance is four times as large."""
    scenario = with_keys(car(gnss={"outages": ()}), 60.0)
    worse = with_keys(scenario, 60.0, **{"gnss.position_noise_m": 3.0})
    before, after = (analyse(scenario, (), true) for true in (None, worse))
    assert after.filter_sigmas == pytest.approx(before.filter_sigmas)
    one, other = (
        next(one for one in found.sources if one.name == "gnss.position_noise_m")
        for found in (before, after)
    )
    assert other.variance == pytest.approx(4.0 * one.variance)
    assert "over-confident in position east" in covariance_report.confidence(after)


@pytest.mark.parametrize(
    "key",
    [
        "gyros.bias_dph.2=2",
        "gyros.scale_error_ppm.3=100",
        "gyros.g_sensitivity_dph_per_g.1=1",
        "gyros.installation_u_arcsec.4=20",
        "accelerometers.bias_ug.3=500",
        "accelerometers.asymmetric_scale_error_ppm.1=200",
        "firmware.heading_error_arcsec=300",
        "odometer.scale_error_ppm=5000",
        "odometer.mounting_heading_deg=0.3",
    ],
)
@pytest.mark.slow
def test_each_constant_gives_what_an_aided_run_with_it_gives(key):
    """A run with the error less one without, at the end of an outage, in size and sign.

    The filter is told of tactical sensors in both, so that its gate has room for the error.
    """
    name, _, size = key.partition("=")
    wheel = {"odometer": WHEEL | {"pulse_mm": 0.01}} if name.startswith("odometer") else {}
    true = with_keys(car(**wheel), 160.0)
    told = with_keys(true, 160.0, sensors="tactical")
    definition = load(true, Wishes(vary={name: f"normal({size}, 1e-9)"}, runs=1))
    with_it, without = (run_of(told, one) for one in (definition.scenario_of(0), true))
    errors = with_it - without
    model = Aided(true, trace_of(told))
    sources = sources_of(true, definition.varied())
    (one,) = (one for one in sources.drawn if one.loading.any())
    found = model.of_drawn(one).mean[-1, HORIZONTAL]
    assert found == pytest.approx(errors, rel=0.05, abs=0.05 * np.hypot(*errors) + 1e-3)


def run_of(told, true):
    """Return the position's error at the end of a noise-free run, east and north, m."""
    given = given_pose(true.model_copy(update={"firmware": quiet(true.firmware)}))
    settings = firmware_settings(told).model_copy(update=asdict(given))
    run = FastRun.of(settings, hardware_settings(true))
    run.plant["gnss"]["position_noise"] = run.plant["gnss"]["velocity_noise"] = 0.0
    run.plant["odometer"]["noise"] = 0.0
    track = run.run(true.epochs)
    errors = compare(track.navigation, track.truth, true.rate_hz)
    return np.array([errors.position_east_m[-1], errors.position_north_m[-1]])


def quiet(firmware):
    """Return the firmware's table without what it draws."""
    drawn = ("heading_error_sigma_arcsec", "level_error_sigma_arcsec")
    return firmware.model_copy(update=dict.fromkeys(drawn, 0.0))
