"""Subject of the comparison: a scenario's sensors, or a preset's on any geometry."""

from __future__ import annotations

import pytest

from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.redundancy.candidates import BUILT_IN, candidates_of

OWN = """
duration_s = 10
sensors = "tactical"
motion.kind = "sway"
[redundancy]
false_alarms_per_1000_h = 2.0
[[faults]]
kind = "gyro_bias"
"""


@pytest.fixture
def own(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(OWN)
    return str(path)


def test_by_default_four_geometries_with_the_sensors_of_the_prototype():
    candidates = candidates_of()
    assert [one.name for one in candidates] == list(BUILT_IN)
    for one in candidates:
        assert one.scenario.redundancy.enabled
        assert one.scenario.gyros.angle_random_walk_deg_per_sqrt_h == 0.005


def test_a_preset_keeps_its_values_per_sensor_where_they_fit():
    tetrahedron, dodecahedron = candidates_of(None, ["tetrahedron", "dodecahedron"], "prototype")
    assert len(tetrahedron.scenario.gyros.bias_instability_dph) == 4
    assert dodecahedron.scenario.gyros.bias_instability_dph == 0.0517


def test_a_scenario_keeps_its_motion_and_promise_and_loses_its_faults(own):
    (candidate,) = candidates_of(own)
    assert candidate.name == "own"
    assert candidate.scenario.faults == ()
    assert candidate.scenario.motion.kind == "sway"
    assert candidate.scenario.redundancy.false_alarms_per_1000_h == 2.0


def test_geometry_preset_and_promise_take_the_place_of_the_scenarios(own):
    (candidate,) = candidates_of(own, ["dodecahedron"], "navigation", 5.0)
    assert candidate.scenario.motion.kind == "sway"
    assert len(candidate.scenario.rimu.gyros) == 6
    assert candidate.scenario.gyros.angle_random_walk_deg_per_sqrt_h == 0.002
    assert candidate.scenario.redundancy.false_alarms_per_1000_h == 5.0


def test_own_axes_come_from_a_file(tmp_path):
    axes = "[[0, 0], [60, 0], [60, 90], [60, 180], [60, 270]]"
    path = tmp_path / "five.toml"
    path.write_text(f"gyro_axes_deg = {axes}\naccelerometer_axes_deg = {axes}\n")
    (candidate,) = candidates_of(None, [str(path)], "tactical")
    assert candidate.name == "five"
    assert len(candidate.scenario.rimu.gyros) == 5


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("rimu_rotatin",), "did you mean rimu_rotating"),
        ((None, ["tetrahedrom"]), "did you mean tetrahedron"),
        ((None, ["cone"], "tactica"), "did you mean tactical"),
        ((None, ["orthogonal"]), "orthogonal: three sensors of each kind have nothing to compare"),
    ],
)
def test_what_is_wrong_is_told_in_one_line(arguments, words):
    with pytest.raises(ScenarioError, match=words) as told:
        candidates_of(*arguments)
    assert "\n" not in str(told.value)
