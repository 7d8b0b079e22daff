"""The inner axis takes the vehicle's turn out: the sensors keep their heading while it turns."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.host_tools.hardware.memory import INNER, OUTER, Truth
from rrins.host_tools.runs.direct import run_direct, run_without_frames
from rrins.host_tools.runs.results.samples import TRUTH_SAMPLES, read_samples
from rrins.host_tools.scenario.scenario import Scenario, ScenarioError

RATE_HZ, DURATION_S = 200, 90
TURN_DPS, BEGIN_S, RAMP_S = 8.0, 6.0, 4.0
LATE_EPOCHS = 3
"""Two until a command takes effect, one until its encoder's frame is there."""

TABLES = {
    "turntable": {
        "inner": {"acceleration_limit_dps2": 50, "rate_limit_dps": 60},
        "outer": {"acceleration_limit_dps2": 50},
    },
    "firmware": {
        "turn_rate_dps": 20,
        "stand_s": 4,
        "alignment_s": 0.5,
        "height_channel": "free",
        "scheme": [
            {"axis": "outer", "angle_deg": 180},
            {"axis": "inner", "angle_deg": 90},
            {"axis": "outer", "angle_deg": -180},
            {"axis": "inner", "angle_deg": -90},
        ],
    },
}


def heading_deg(t):
    """Return the heading of a vehicle that speeds up its turn evenly, and then keeps it up."""
    t = np.clip(t - BEGIN_S, 0.0, None)
    return TURN_DPS * np.where(t < RAMP_S, 0.5 * t**2 / RAMP_S, t - 0.5 * RAMP_S)


@pytest.fixture
def turning(tmp_path):
    """Return a scenario of a vehicle that turns on the spot, one and a half turns and more."""
    t = np.arange(0.0, DURATION_S + 10.0, 0.25)
    lines = ["time_s,latitude_deg,longitude_deg,height_m,roll_deg,pitch_deg,heading_deg"]
    lines += [f"{a},45,9,100,0,0,{b:.9f}" for a, b in zip(t, heading_deg(t) % 360, strict=True)]
    path = tmp_path / "turning.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")

    def make(isolate=True, **tables):
        values = {"duration_s": DURATION_S, "rate_hz": RATE_HZ, "mode": "rotating"} | TABLES
        values["motion"] = {"kind": "file", "path": str(path)}
        values["firmware"] = TABLES["firmware"] | {"isolate_heading": isolate}
        return Scenario.model_validate(values | tables)

    return make


def flown(scenario, folder):
    folder.mkdir()
    outcome = run_without_frames(scenario, folder)
    return outcome.firmware, read_samples(folder / TRUTH_SAMPLES, Truth)


def off_deg(isolated, plain, upright):
    """Return by how much the sensors' heading is off that in a vehicle that does not turn."""
    turned = np.unwrap(plain["heading"]) - plain["heading"][0]
    extra = isolated["axis_angle"][:, INNER] - plain["axis_angle"][:, INNER]
    off = extra - turned * np.cos(plain["axis_angle"][:, OUTER])
    return np.degrees((off + np.pi) % (2.0 * np.pi) - np.pi)[upright]


def is_upright(truth):
    return np.abs(np.sin(truth["axis_angle"][:, OUTER])) < 1e-9


def test_the_sensors_keep_their_heading_in_a_vehicle_that_turns(turning, tmp_path):
    summary, isolated = flown(turning(), tmp_path / "isolated")
    _, plain = flown(turning(isolate=False), tmp_path / "plain")
    assert summary["axes_not_following"] == [False, False]
    assert isolated["axis_angle"][:, OUTER] == pytest.approx(plain["axis_angle"][:, OUTER])
    seconds = isolated["epoch"] / RATE_HZ
    upright = is_upright(plain) & (seconds < DURATION_S)
    late_deg = LATE_EPOCHS / RATE_HZ * (TURN_DPS + 2.0 * TABLES["firmware"]["turn_rate_dps"])
    off = off_deg(isolated, plain, upright)
    assert upright.sum() > 400
    turned = np.degrees(np.unwrap(plain["heading"]))[upright]
    assert turned[-1] - turned[0] > 500  # it would be off by this
    # Right after an outer turn the inner axis still closes in; later only the bus is between.
    assert np.abs(off).max() < late_deg + 1.0
    assert np.percentile(np.abs(off), 90) < LATE_EPOCHS / RATE_HZ * TURN_DPS + 0.01
    rate = np.diff(isolated["axis_angle"][:, INNER]) / np.diff(seconds)
    assert np.degrees(np.abs(rate)).max() <= 60 * (1 + 1e-9)


def test_with_frames_and_without_it_navigates_to_the_same_bytes(turning):
    stall = [{"kind": "axis_stall", "axis": "inner", "at_s": 14, "for_s": 3}]
    scenario = turning(duration_s=30, faults=stall)
    found = [way(scenario).firmware for way in (run_direct, run_without_frames)]
    assert len({one["navigation_sha256"] for one in found}) == 1


def test_an_axis_that_stalled_takes_out_what_has_come_together_meanwhile(turning, tmp_path):
    stall = [{"kind": "axis_stall", "axis": "inner", "at_s": 23, "for_s": 3}]
    summary, isolated = flown(turning(faults=stall), tmp_path / "isolated")
    _, plain = flown(turning(isolate=False), tmp_path / "plain")
    assert summary["axes_not_following"] == [False, False]  # any more
    seconds = isolated["epoch"] / RATE_HZ
    during = (seconds > 23.1) & (seconds < 26)
    assert np.ptp(isolated["axis_angle"][during, INNER]) == 0
    upright = is_upright(plain) & is_upright(isolated)
    assert np.percentile(np.abs(off_deg(isolated, plain, upright & (seconds > 40))), 90) < 0.13


def test_a_vehicle_that_keeps_its_heading_turns_no_axis(tmp_path):
    values = {"duration_s": 40, "mode": "rotating"} | TABLES
    truths = []
    for isolate in (True, False):
        values["firmware"] = TABLES["firmware"] | {"isolate_heading": isolate}
        _, truth = flown(Scenario.model_validate(values), tmp_path / str(isolate))
        truths.append(np.degrees(truth["axis_angle"]))
    # The same turns; what the ramps round differs by parts of an epoch.
    assert np.abs(truths[0] - truths[1]).max() < 20 * LATE_EPOCHS / RATE_HZ + 0.1


def test_an_axis_with_limited_jerk_is_refused():
    with pytest.raises(ScenarioError, match="isolate_heading: an inner axis with jerk_limit"):
        Scenario.model_validate({"duration_s": 10}).varied(
            firmware__isolate_heading=True, turntable__inner={"jerk_limit_dps3": 100}
        )
