"""A calibrated firmware: large constants that it knows are as good as none."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from rrins.host_tools.cli.main import rrins
from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.runs.direct import run_direct
from rrins.host_tools.runs.set_up.settings import firmware_settings
from rrins.host_tools.scenario.scenario import Scenario, load

CONSTANTS = {
    "gyros": {
        "bias_dph": [5, -3, 4, 8],
        "scale_error_ppm": [300, -500, 100, 800],
        "asymmetric_scale_error_ppm": [50, 80, -120, 20],
        "installation_u_arcsec": [100, -60, 20, 200],
        "installation_v_arcsec": [-90, 40, 150, -30],
    },
    "accelerometers": {
        "bias_ug": [500, -300, 700, 200],
        "scale_error_ppm": [-400, 200, 600, 90],
        "asymmetric_scale_error_ppm": [30, -60, 90, 10],
        "installation_u_arcsec": [50, 120, -80, 10],
        "installation_v_arcsec": [-30, 200, 60, -100],
    },
}


def write_toml(path, tables):
    lines = []
    for table, values in tables.items():
        lines.append(f"[{table}]")
        lines += [f"{key} = {value}" for key, value in values.items()]
    path.write_text("\n".join(lines), encoding="utf-8")
    return str(path)


@pytest.fixture
def file(tmp_path):
    return write_toml(tmp_path / "cal.toml", CONSTANTS)


def largest_m(errors):
    return float(np.hypot(errors.position_east_m, errors.position_north_m).max())


@pytest.mark.parametrize("mode", ["strapdown", "rotating"])
def test_constants_that_are_calibrated_leave_no_error(fly, file, mode):
    scenario = Scenario.model_validate({"duration_s": 600, "mode": mode} | CONSTANTS)
    calibrated = scenario.varied(firmware__calibration=file)
    _, ideal = fly(Scenario.model_validate({"duration_s": 600, "mode": mode}))
    firmware, errors = fly(calibrated)
    _, raw = fly(scenario)
    assert largest_m(raw) > 1000
    assert largest_m(errors) < 5e-3 + largest_m(ideal)
    assert firmware["calibration"] == {"file": file} | CONSTANTS


def test_calibrated_while_the_vehicle_moves(fly, file):
    scenario = Scenario.model_validate(
        {"duration_s": 600, "motion": {"kind": "drive"}, "altimeter": {}} | CONSTANTS
        | {"firmware": {"height_channel": "damped", "calibration": file}}
    )  # fmt: skip
    _, errors = fly(scenario)
    assert largest_m(errors) < 0.05


def test_half_of_a_bias_calibrated_leaves_half_of_its_error(fly, tmp_path):
    ends = []
    for known in (0.0, 0.05):
        path = write_toml(tmp_path / "half.toml", {"gyros": {"bias_dph": [known, 0, 0]}})
        scenario = Scenario.model_validate(
            {
                "duration_s": 600, "mode": "strapdown", "rimu": {"geometry": "orthogonal"},
                "gyros": {"bias_dph": [0.1, 0, 0]}, "firmware": {"calibration": path},
            }
        )  # fmt: skip
        _, errors = fly(scenario)
        ends.append(errors.position_north_m[-1])
    assert ends[1] == pytest.approx(ends[0] / 2, rel=1e-3)


def test_the_summary_tells_what_was_used(run, tmp_path, file):
    (tmp_path / "own.toml").write_text('duration_s = 2\n[firmware]\ncalibration = "cal.toml"\n')
    summary = run("simulate", "own.toml", "--out", "calibrated")
    assert summary["firmware"]["calibration"]["gyros"] == CONSTANTS["gyros"]
    written = json.loads((tmp_path / "calibrated" / "summary.json").read_text())
    assert written["firmware"]["calibration"]["file"] == "cal.toml"


def test_the_file_lies_beside_the_scenario(tmp_path, file):
    scenario = tmp_path / "own.toml"
    scenario.write_text('duration_s = 2\n[firmware]\ncalibration = "cal.toml"\n')
    settings = firmware_settings(load(str(scenario)))
    assert settings.calibration.gyros.bias_dph == (5, -3, 4, 8)
    assert settings.calibration_file == file


def test_a_calibration_of_other_sensors_is_told_in_one_line(tmp_path, file):
    scenario = Scenario.model_validate(
        {"duration_s": 1, "rimu": {"geometry": "dodecahedron"}, "firmware": {"calibration": file}}
    )
    with pytest.raises(ScenarioError, match=r"cal\.toml: gyros\.\w+: 4 values for 6 sensors"):
        firmware_settings(scenario)
    path = tmp_path / "own.toml"
    path.write_text(
        'duration_s = 1\n[rimu]\ngeometry = "orthogonal"\n[firmware]\ncalibration = "cal.toml"\n'
    )
    for command in ("simulate", "rehearse"):
        ended = CliRunner().invoke(rrins, [command, str(path)])
        assert ended.exit_code == 3
        (told,) = [line for line in ended.stderr.splitlines() if line.startswith("rrins: ")]
        assert "4 values for 3 sensors" in told


def test_a_run_of_direct_tells_it_too(file):
    scenario = Scenario.model_validate({"duration_s": 1, "firmware": {"calibration": file}})
    assert run_direct(scenario).firmware["calibration"]["file"] == file
