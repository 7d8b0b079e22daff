"""The analysis against runs: σ of many runs, with chi-square intervals, beside the one predicted.

At length (`-m soak`), `RRINS_RUNS=400 pytest -s -m soak FILE` prints the figures of the page.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from rrins.host_tools.campaigns.definition import Wishes, load
from rrins.host_tools.campaigns.row import Work, rows_of
from rrins.host_tools.covariance.analysis import analyse
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.results.results import compare
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings

QUANTITIES = {
    "position_east_m": "position_east_m",
    "position_north_m": "position_north_m",
    "height_error_m": "height_m",
    "velocity_east_mps": "velocity_east_mps",
    "velocity_north_mps": "velocity_north_mps",
    "heading_error_arcsec": "heading_arcsec",
}
"""Columns of a campaign's row, and what the analysis calls them."""

OF_ERRORS = {
    "position_east_m": lambda e: e.position_east_m[0],
    "position_north_m": lambda e: e.position_north_m[0],
    "height_error_m": lambda e: e.height_m[0],
    "velocity_east_mps": lambda e: e.velocity_east_mps[0],
    "velocity_north_mps": lambda e: e.velocity_north_mps[0],
    "heading_error_arcsec": lambda e: 3600.0 * e.heading_deg[0],
}

GRADES = {
    "prototype": {
        "sensors": "ideal",
        "gyros.bias_repeatability_dph": 0.07,
        "gyros.bias_instability_dph": 0.05,
        "gyros.angle_random_walk_deg_per_sqrt_h": 0.005,
        "accelerometers.bias_repeatability_ug": 6.0,
        "accelerometers.bias_instability_ug": 15.0,
        "gyros.scale_repeatability_ppm": 50.0,
    },
    "navigation": {"sensors": "navigation", "gyros.scale_repeatability_ppm": 50.0},
    "tactical": {"sensors": "tactical"},
}
COMMON = {"rate_hz": 100, "redundancy.enabled": False}
REST = COMMON | {
    "body.heading_deg": 30.0,
    "site.latitude_deg": 55.0,
    "gyros.bias_dph": 0.1,
    "accelerometers.bias_ug": 50.0,
}
DRIVE = COMMON | {
    "firmware.heading_error_sigma_arcsec": 300.0,
    "firmware.level_error_sigma_arcsec": 30.0,
    "firmware.height_channel": "free",
    "gnss.outages": [{"at_s": 183.0, "for_s": 120.0}],
}
CAR = {
    "title": "a car with a receiver and nothing else",
    "mode": "rotating",
    "duration_s": 300.0,
    "motion": {"kind": "drive", "duration_s": 900.0},
    "gnss": {},
    "firmware": {"height_channel": "free", "turn_rate_dps": 2.0, "stand_s": 10.0},
    "estimator": {"enabled": True},
}
STARTS: dict[str, tuple[Any, float, dict[str, Any]]] = {
    "given": ("rimu_rotating", 2400.5, REST),
    "self-aligned": (
        "rimu_rotating",
        2400.5,
        REST | {"firmware.initial_attitude": "self-aligned", "firmware.alignment_s": 300.0},
    ),
    "fine-aligned": ("rimu_rotating_aligned", 600.5, REST),
    "aided with an outage": (CAR, 299.5, DRIVE),
    "odometer in an outage": ("drive_aided", 299.5, DRIVE),
    "aided by a receiver that lasts": (
        CAR,
        179.5,
        DRIVE | {"gnss.position_correlated_noise_m": 1.5},
    ),
}
"""Scenario, s, and keys. They end between two seconds: what the last fix said has been fed back."""

CASES = [  # tactical gyros find north within 20°: that is not linear
    *(("given", grade) for grade in GRADES),
    *(("self-aligned", grade) for grade in ("prototype", "navigation")),
    *(("fine-aligned", grade) for grade in ("prototype", "navigation")),
    *(("aided with an outage", grade) for grade in GRADES),
    *(("odometer in an outage", grade) for grade in GRADES),
    ("aided by a receiver that lasts", "tactical"),
]


def errors_of(definition, runs):
    """Return the errors at the end of runs that came to it, by column."""
    work = Work.of(definition)
    rows = rows_of(work, [0])
    with ThreadPoolExecutor(2) as pool:
        parts = pool.map(lambda k: rows_of(work, range(k, min(k + 10, runs))), range(1, runs, 10))
        rows += [row for part in parts for row in part]
    sound = [row for row in rows if row["status"] == "ok"]
    assert len(sound) > 0.95 * runs
    return {name: np.array([row[name] for row in sound]) for name in QUANTITIES}


def ratios(analysis, errors, level):
    """Yield for each quantity σ of the runs over that predicted, and the interval of this ratio."""
    from scipy.stats import chi2

    for column, name in QUANTITIES.items():
        predicted = analysis.quantity(name)[0][-1]
        if predicted > 0.0:
            freedom = len(errors[column]) - 1
            limits = np.sqrt(chi2.ppf([0.5 - 0.5 * level, 0.5 + 0.5 * level], freedom) / freedom)
            yield name, predicted, errors[column].std(ddof=1) / predicted, *limits


@pytest.mark.slow
def test_an_aided_outage_is_as_in_runs():
    keys = DRIVE | {"rate_hz": 50, "gnss.outages": [{"at_s": 63.0, "for_s": 60.0}]}
    wishes = Wishes(duration_s=119.5, runs=60, set=keys | GRADES["tactical"], seed=5)
    definition = load(CAR, wishes)
    found = analyse(definition.scenario, definition.varied())
    for name, _, ratio, low, high in ratios(found, errors_of(definition, 60), 0.999):
        assert low < ratio < high, name


@pytest.mark.slow
def test_gyros_worse_than_the_filter_is_told_are_as_in_runs():
    """White noise of 40 times the data sheet, in 60 runs: the tilt is worse than its σ."""
    keys = DRIVE | GRADES["prototype"] | {"rate_hz": 50, "gnss.outages": ()}
    told = load(CAR, Wishes(duration_s=119.5, set=keys)).scenario
    worse = {"gyros.angle_random_walk_deg_per_sqrt_h": 0.2}
    true = load(told, Wishes(set=worse)).scenario
    found = analyse(told, (), true)
    errors: dict[str, list[float]] = {name: [] for name in QUANTITIES}
    for seed in range(60):
        own = {"seed": seed}
        firmware = firmware_settings(told.model_copy(update=own))
        run = FastRun.of(firmware, hardware_settings(true.model_copy(update=own)))
        track = run.run(told.epochs)
        end = compare(track.navigation[-1:], track.truth[-1:], told.rate_hz)
        for name, column in OF_ERRORS.items():
            errors[name].append(column(end))
    columns = {name: np.array(values) for name, values in errors.items()}
    for name, _, ratio, low, high in ratios(found, columns, 0.999):
        assert low < ratio < high, name
    tilt, told_tilt = found.quantity("tilt_east_arcsec")
    assert tilt[-1] > 2.0 * told_tilt[-1]


@pytest.mark.soak
@pytest.mark.parametrize(("start", "grade"), CASES)
@pytest.mark.parametrize("geometry", ["orthogonal", "tetrahedron", "dodecahedron"])
def test_it_lies_in_the_intervals_of_runs(start, grade, geometry):
    runs = int(os.environ.get("RRINS_RUNS", "100"))
    scenario, duration_s, keys = STARTS[start]
    fixed = keys | GRADES[grade] | {"rimu.geometry": geometry}
    definition = load(scenario, Wishes(duration_s=duration_s, runs=runs, set=fixed, seed=11))
    found = analyse(definition.scenario, definition.varied())
    errors, inside = errors_of(definition, runs), []
    lines = list(ratios(found, errors, 0.999))
    for _, _, ratio, low, high in ratios(found, errors, 0.95):
        inside.append(low < ratio < high)
    figures = ", ".join(
        f"{name} {predicted:.3g} x {ratio:.3f}" for name, predicted, ratio, *_ in lines
    )
    print(f"\n{start}, {grade}, {geometry}: {figures}; {sum(inside)} of {len(inside)} in 95 %")
    for name, _, ratio, low, high in lines:
        assert low < ratio < high, name
