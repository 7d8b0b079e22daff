"""Presets of sensors, variations of a scenario, and what its tables refuse."""

from __future__ import annotations

import pytest

from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.experiments.fleet import run
from rrins.host_tools.hardware.settings import power_on
from rrins.host_tools.runs.set_up.settings import hardware_settings
from rrins.host_tools.scenario import presets
from rrins.host_tools.scenario.geometry import GEOMETRIES
from rrins.host_tools.scenario.scenario import Scenario, load

FOUR = ("tetrahedron", "cone", "orthogonal-plus-one")


def refused(text, write):
    """Return the one line that a scenario is refused with."""
    with pytest.raises(ScenarioError) as caught:
        load(write(text))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_the_promised_presets_are_there():
    assert presets.names() == ["ideal", "navigation", "prototype", "tactical"]


@pytest.mark.parametrize("geometry", GEOMETRIES)
@pytest.mark.parametrize("name", presets.names())
def test_a_preset_fits_every_geometry_of_its_count(name, geometry, write):
    text = f'duration_s = 1\nsensors = "{name}"\n[rimu]\ngeometry = "{geometry}"'
    if name == "prototype" and geometry not in FOUR:
        message = refused(text, write)
        count = len(GEOMETRIES[geometry])
        assert f'4 values for {count} sensors, of sensors = "prototype"' in message
        return
    sensors = power_on(hardware_settings(load(write(text))))[0].gyros
    assert sensors.count == len(GEOMETRIES[geometry])
    assert (name == "ideal") == (sensors.noise_increment[0] == 0)


def test_the_prototype_is_table_2():
    scenario = load("experiment_rotating")
    gyros, accelerometers = scenario.gyros, scenario.accelerometers
    assert gyros.bias_instability_dph == (0.0502, 0.0303, 0.0355, 0.0517)
    assert gyros.bias_repeatability_dph == (0.0831, 0.0109, 0.0720, 0.0770)
    assert accelerometers.bias_instability_ug == (12.4, 8.3, 27.7, 11.7)
    assert accelerometers.bias_repeatability_ug == (5.7, 5.8, 7.4, 5.1)
    assert (gyros.range_dps, accelerometers.range_g) == (300, 20)
    # "<= 50 ppm" and "<= 30 ppm" as three standard deviations
    assert gyros.scale_repeatability_ppm == pytest.approx(50 / 3, abs=0.05)
    assert accelerometers.scale_repeatability_ppm == pytest.approx(30 / 3)


def test_keys_of_its_own_are_changes_to_the_preset(write):
    scenario = load(
        write('duration_s = 1\nsensors = "tactical"\n[gyros]\nbias_dph = 7\nrange_dps = 90')
    )
    assert scenario.gyros.bias_dph == 7
    assert scenario.gyros.range_dps == 90
    assert scenario.gyros.bias_instability_dph == 0.5
    assert scenario.accelerometers.bias_repeatability_ug == 1000


def test_better_sensors_navigate_better():
    worst = {}
    for name in presets.names():
        scenario = Scenario(duration_s=600, rate_hz=50, mode="strapdown", sensors=name)
        largest = run(scenario).largest()["max_abs_position_error_m"]
        worst[name] = max(largest.values())
    assert worst["ideal"] < 1e-2 < worst["navigation"] < worst["tactical"] / 10


def test_an_unknown_preset_is_told_with_those_that_are_there(write):
    message = refused('duration_s = 1\nsensors = "tactcal"', write)
    assert "'tactcal'" in message
    assert "ideal, navigation, prototype, tactical" in message


# Variations


def test_a_variation_changes_what_it_names_and_nothing_else():
    scenario = load("rimu_rotating")
    varied = scenario.varied(seed=9, site__latitude_deg=10, firmware__stand_s=30)
    assert (varied.seed, varied.site.latitude_deg, varied.firmware.stand_s) == (9, 10, 30)
    assert varied.site.height_m == scenario.site.height_m
    assert varied.gyros == scenario.gyros
    assert scenario.varied() == scenario
    back = varied.varied(
        seed=scenario.seed,
        site__latitude_deg=scenario.site.latitude_deg,
        firmware__stand_s=scenario.firmware.stand_s,
    )
    assert back == scenario


def test_a_variation_can_take_a_table_away_or_whole():
    scenario = load("drive_rotating")
    assert scenario.varied(gyros={}).gyros.bias_dph == 0
    assert scenario.varied(altimeter=None).altimeter is None
    assert scenario.varied(motion={"kind": "sway"}).motion.kind == "sway"


def test_another_preset_takes_the_place_of_the_one_before():
    scenario = load("experiment_rotating").varied(gyros__bias_dph=3)
    varied = scenario.varied(sensors="navigation")
    fresh = Scenario(duration_s=1, sensors="navigation")
    assert varied.accelerometers == fresh.accelerometers
    assert varied.gyros.bias_instability_dph == fresh.gyros.bias_instability_dph
    assert varied.gyros.bias_dph == 3
    assert scenario.varied(sensors="ideal").gyros.bias_repeatability_dph == 0


def test_a_variation_that_cannot_be_is_told_in_one_line():
    scenario = load("rimu_rotating")
    for changes, words in (
        ({"gyros__bias_dhp": 1}, "gyros.bias_dhp: no such key, did you mean bias_dph?"),
        ({"rate_hz": 300}, "300 Hz"),
        ({"motion": {"kind": "drive"}}, 'firmware.height_channel: "held"'),
    ):
        with pytest.raises(ScenarioError) as caught:
            scenario.varied(**changes)
        assert words in str(caught.value)
        assert scenario.title in str(caught.value)


# What is refused


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[motion]\nkind = "drive"', ["firmware.height_channel", '"held"', "[altimeter]"]),
        ('[motion]\nkind = "file"', ["motion", "needs path"]),
        ('[motion]\nkind = "drve"', ["motion.kind", "'drive'"]),
        ('[motion]\nkind = "sway"\npath = "x"', ["motion: path is for kind = "]),
        ("[motion]\nknd = 1", ["motion.knd: no such key, did you mean kind?"]),
        ("[altimeter]", ["altimeter: is used with firmware.height_channel"]),
        (
            '[firmware]\nheight_channel = "damped"\n[altimeter]\nnois_m = 1',
            ["altimeter.nois_m: no such key, did you mean noise_m?"],
        ),
        ("[thermal]\ntime_constant_s = 0", ["thermal.time_constant_s", "0.001"]),
        ("[gyros]\nbias_instability_dph = -1", ["gyros.bias_instability_dph", "0"]),
        ("[gyros]\nbias_instability_dph = [1, -1, 0, 0]", ["gyros.bias_instability_dph.2"]),
        ("[gyros]\nlatency_ms = 26", ["gyros.latency_ms", "25"]),
        ("[gyros]\nbandwidth_hz = 0", ["gyros.bandwidth_hz", "0.01"]),
        ("[accelerometers]\ng_sensitivity_dph_per_g = 1", ["accelerometers.g_sens", "no such key"]),
        (
            "[turntable]\ninner = { jerk_limit_dps3 = 0.1 }",
            ["turntable.inner", "jerk_limit_dps3", "100 s to rise, 10 s at most"],
        ),
        (
            "[turntable]\ninner = { jerk_limit_dps3 = 1 }\n[firmware]\nstand_s = 5",
            ["firmware.stand_s: 5 s", "10.2 s"],
        ),
        ("[turntable]\nwoble_arcsec = 1", ["turntable.woble_arcsec", "did you mean wobble_arcsec"]),
        ("[turntable.inner]\nstickion_arcsec = 1", ["did you mean stiction_arcsec"]),
    ],
)
def test_a_wrong_table_is_told_in_one_line(text, words, write):
    message = refused(f"duration_s = 1\n{text}", write)
    for word in words:
        assert word in message


def test_files_lie_beside_the_scenario(write, tmp_path):
    folder = tmp_path / "deep"
    folder.mkdir()
    (folder / "own.toml").write_text(
        'duration_s = 1\n[motion]\nkind = "file"\npath = "way.csv"\n'
        '[firmware]\nheight_channel = "free"\ncalibration = "cal.toml"\n'
    )
    scenario = load(str(folder / "own.toml"))
    assert scenario.motion.path == str(folder / "way.csv")
    assert scenario.firmware.calibration == str(folder / "cal.toml")
    absolute = str(tmp_path / "else" / "cal.toml")
    path = write(f'duration_s = 1\n[firmware]\ncalibration = "{absolute}"')
    assert load(path).firmware.calibration == absolute


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "status", "words"),
    [
        ('[firmware]\ncalibration = "none.toml"', 3, "none.toml: cannot be read"),
        ('[motion]\nkind = "file"\npath = "none.csv"\n[firmware]\nheight_channel = "free"', 9,
         "none.csv"),
    ],
)  # fmt: skip
def test_a_file_that_is_missing_ends_a_command_in_one_line(start, write, text, status, words):
    path = write(f"duration_s = 1\n{text}")
    for command in ("simulate", "rehearse", "hardware" if status == 9 else "firmware"):
        running = start(command, path)
        returned, out = running.finish()
        assert returned == status, running.said
        told = [line for line in running.said if line.startswith("rrins: ") and words in line]
        assert len(told) == 1, running.said
        assert not any("Traceback" in line for line in running.said)
        assert out == ""
