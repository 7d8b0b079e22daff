"""Scenarios: what is built in, and that a wrong one ends in one line that says where."""

from __future__ import annotations

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.scenario import scenario as scenarios

NAMED = (
    "ideal",
    "imu_strapdown",
    "imu_rotating",
    "rimu_strapdown",
    "rimu_rotating",
    "imu_strapdown_self_aligned",
    "rimu_strapdown_self_aligned",
    "drive_aided",
    "drive_outage",
    "ship_moored",
    "drive_begun",
    "tour",
)


def test_all_promised_scenarios_are_built_in():
    assert set(NAMED) <= set(scenarios.names())


@pytest.mark.parametrize("name", NAMED)
def test_a_printed_scenario_loads_from_a_file_as_the_same(name, write):
    assert scenarios.load(write(scenarios.text_of(name))) == scenarios.load(name)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("duration_s = 1\n[gyros]\nbais_dph = 1", ["gyros.bais_dph", "did you mean bias_dph"]),
        ("duratoin_s = 1", ["duratoin_s", "did you mean duration_s"]),
        ("duration_s = -1", ["duration_s", "greater than 0", "-1"]),
        ("duration_s = nan", ["duration_s", "finite"]),
        ('duration_s = "long"', ["duration_s", "number"]),
        ("", ["duration_s", "missing"]),
        ("duration_s =\nseed = 1", ["not TOML", "line 1"]),
        ("duration_s = 1\n[gyros]\nbias_dph = [1, 2]", ["gyros.bias_dph", "2 values for 4"]),
        ("duration_s = 1\n[site]\nlatitude_deg = 95", ["site.latitude_deg", "95"]),
        ("duration_s = 1\nrate_hz = 300", ["rate_hz", "300"]),
        ("duration_s = 1\n[odometer]\nlatency_s = 0.1", ["odometer.latency_s", "0.1 s"]),
        ('duration_s = 1\n[[faults]]\nkind = "odometer_lock"', ["faults.1", "needs an [odometer]"]),
        ('duration_s = 1\n[[faults]]\nkind = "gnss_lost"', ["faults.1", "needs a [gnss]"]),
        (
            'duration_s = 1\n[gnss]\n[[faults]]\nkind = "gnss_lost"\ndirection = "up"',
            ["direction", "does not apply to gnss_lost"],
        ),
        ('duration_s = 1\n[firmware]\nscheme = "12"', ["firmware.scheme", "16-position"]),
        (
            'duration_s = 1\n[firmware]\nscheme = [{axis = "iner", angle_deg = 9}]',
            ["firmware.scheme", "axis", "iner"],
        ),
        ('duration_s = 1\n[rimu]\ngeometry = "custom"', ["rimu", "gyro_axes_deg"]),
        (
            'duration_s = 1\n[rimu]\ngeometry = "custom"\n'
            "gyro_axes_deg = [[90, 0], [90, 40], [90, 80]]\n"
            "accelerometer_axes_deg = [[90, 0], [90, 90], [0, 0]]",
            ["gyro_axes_deg", "one plane"],
        ),
        (
            'duration_s = 1\n[rimu]\ngeometry = "custom"\n'
            "gyro_axes_deg = [[90, 0], [90, 90], [0, 0]]\n"
            "accelerometer_axes_deg = [[0.2, 0], [0.2, 90], [0.2, 180], [0.2, 270]]",
            ["accelerometer_axes_deg", "too close to one line", "203 times", "573", "at most 300"],
        ),
        (
            'duration_s = 1\n[rimu]\ngeometry = "custom"\n'
            "gyro_axes_deg = [[89.9, 0], [90.1, 90], [89.9, 180], [90.1, 270]]\n"
            "accelerometer_axes_deg = [[90, 0], [90, 90], [0, 0]]",
            ["gyro_axes_deg", "too close to one plane", "at most 300"],
        ),
        (
            "duration_s = 1\n[firmware]\ngyro_weights = [1, 1, 1, 1e19]",
            ["firmware.gyro_weights", "1e+19 and 1 are too far apart", "at most 1e+18 to 1"],
        ),
        (
            'duration_s = 1\n[rimu]\ngeometry = "custom"\n'
            "gyro_axes_deg = [[90, 0], [90, 120], [89.99, 240], [0, 0]]\n"
            "accelerometer_axes_deg = [[90, 0], [90, 90], [0, 0]]\n"
            "[firmware]\ngyro_weights = [1e12, 1e12, 1e12, 1]",
            ["firmware.gyro_weights", "close to one plane", "5,729 times", "at most 1000"],
        ),
        (
            "duration_s = 1\n[firmware]\naccelerometer_weights = [0, 1, 1, 1]",
            ["firmware.accelerometer_weights.1", "greater than 0"],
        ),
        (
            'duration_s = 1\n[[operator]]\nat_s = 1e12\nrequest = "NAVIGATE_ROTATING"',
            ["operator.1.at_s", "less than or equal to 10000000"],
        ),
        (
            'duration_s = 1\n[[faults]]\nkind = "drop"\nat_s = 1e300',
            ["faults.1.at_s", "less than or equal to 10000000"],
        ),
        (
            'duration_s = 1\n[[faults]]\nkind = "drop"\nfor_s = 1e300',
            ["faults.1.for_s", "less than or equal to 10000000"],
        ),
        (
            "duration_s = 1\n[firmware]\nturn_rate_dps = 1e-300",
            ["firmware.turn_rate_dps", "greater than or equal to 0.01"],
        ),
        (
            "duration_s = 1\n[firmware]\nturn_rate_dps = 1e300",
            ["firmware.turn_rate_dps", "less than or equal to"],
        ),
        ("duration_s = 1\nrate_hz = 1e300", ["rate_hz", "1e+300"]),
        (f"duration_s = 1\ntitle = '{'x' * 100_000}'", ["title", "at most 200 characters"]),
        (
            'duration_s = 1\n[[operator]]\nat_s = 1\nrequest = "FLY"',
            ["operator.1.request", "NAVIGATE_ROTATING"],
        ),
    ],
)
def test_a_wrong_scenario_is_told_in_one_line(text, words, write):
    path = write(text)
    with pytest.raises(ScenarioError) as caught:
        scenarios.load(path)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 400
    assert path in message
    for word in words:
        assert word in message


def test_a_missing_scenario_names_the_nearest():
    with pytest.raises(ScenarioError, match="did you mean rimu_rotating"):
        scenarios.load("rimu_rotatnig")


def test_a_file_that_is_not_text_is_told(tmp_path):
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match="cannot be read"):
        scenarios.load(str(path))


@given(st.binary(max_size=200))
def test_no_file_raises_anything_else(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "fuzzed.toml"
    path.write_bytes(data)
    with pytest.raises(ScenarioError):
        scenarios.load(str(path))


def test_table_1_is_the_built_in_scheme():
    scheme = scenarios.load("rimu_rotating").scheme
    inner = outer = 0.0
    after = []
    for turn in scheme.turns:
        if turn.axis == "inner":
            inner += turn.angle_deg
        else:
            outer += turn.angle_deg
        after.append((inner, outer))
    # αI, αO after each position, as the closed table has them.
    assert after == [
        (180, 0), (180, -180), (360, -180), (360, 0), (360, 180), (540, 180), (540, 0), (720, 0),
        (540, 0), (540, 180), (360, 180), (360, 0), (360, -180), (180, -180), (180, 0), (0, 0),
    ]  # fmt: skip
    assert scheme.cycle_s == 1600


def test_the_toml_of_a_built_in_scenario_has_comments_to_learn_from():
    text = scenarios.text_of("rimu_rotating")
    assert text.startswith("#")
    assert tomllib.loads(text)["duration_s"] == 6000
