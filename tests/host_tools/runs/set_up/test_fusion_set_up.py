"""Recorded frames, fused by another program as the documentation says, navigate the same."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import cantools
import numpy as np
import pytest
from click.testing import CliRunner

from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.records.memory import Ins
from rrins.host_tools.cli.main import rrins
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.scenario.geometry import GEOMETRIES

ROOT = Path(__file__).parents[4]


def shown(name):
    result = CliRunner().invoke(rrins, ["scenarios", "show", str(name), "--json"])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def test_the_tetrahedron_is_shown_in_all_digits():
    found = shown("ideal")
    s = math.sqrt
    exact = [[0, 0, -1], [s(8) / 3, 0, 1 / 3]]
    exact += [[-s(2) / 3, s(6) / 3, 1 / 3], [-s(2) / 3, -s(6) / 3, 1 / 3]]
    for kind in ("gyros", "accelerometers"):
        assert pytest.approx(np.array(exact), abs=4e-16) == np.array(found["fusion"][kind]["H"])
        assert found["fusion"][kind]["weights"] == [1.0] * 4
    assert found["scenario"]["rate_hz"] == 200
    assert found["scenario"]["gyros"]["bias_dph"] == 0


def test_a_calibration_is_shown_as_the_firmware_has_it(tmp_path):
    (tmp_path / "own.cal.toml").write_text("[gyros]\nbias_dph = 0.1\ninstallation_u_arcsec = 60\n")
    scenario = tmp_path / "own.toml"
    scenario.write_text(
        'duration_s = 9\nrate_hz = 100\n[firmware]\ncalibration = "own.cal.toml"\n'
        "gyro_weights = [1, 2, 3, 4]\n"
    )
    gyros = shown(scenario)["fusion"]["gyros"]
    assert gyros["weights"] == [1, 2, 3, 4]
    assert gyros["bias_increment"] == pytest.approx([math.radians(0.1) / 3600 / 100] * 4)
    # Gyro 2, in the plane of x and z, is turned about u: towards y.
    assert gyros["H"][1][1] == pytest.approx(-math.radians(60 / 3600))


def test_the_angles_of_the_documentation_are_those_of_the_code():
    text = (ROOT / "docs" / "scenarios.md").read_text(encoding="utf-8")
    for name in ("tetrahedron", "dodecahedron", "cone"):
        row = re.search(rf"^\| `{name}` \|.*$", text, re.MULTILINE)[0]
        alpha_deg = GEOMETRIES[name][1][0]
        assert f"= {alpha_deg!r}°" in row


def increments(path):
    """Return epochs, and the increments of all sensors of each kind, read with cantools."""
    database = cantools.database.load_file(ROOT / "dbc" / "rrins.dbc")
    messages = {message.frame_id: message for message in database.messages}
    epochs, columns = [], {}
    for piece in Log(path).pieces():
        for can_id, word in zip(piece.frames["can_id"], piece.frames["data"], strict=True):
            message = messages[int(can_id)]
            if message.name == "SYNC":
                values = message.decode(int(word).to_bytes(8, "little"))
                epochs.append(int(values["epoch"]))
            elif message.name.startswith("SENSOR_"):
                values = message.decode(int(word).to_bytes(8, "little"), decode_choices=False)
                for signal in ("gyro_dtheta", "accelerometer_dv"):
                    columns.setdefault((signal, message.name), []).append(values[signal])
    by_kind = [
        np.stack([columns[signal, f"SENSOR_{k}"] for k in range(1, 5)], axis=1)
        for signal in ("gyro_dtheta", "accelerometer_dv")
    ]
    return np.array(epochs), *by_kind


def gain_of(kind):
    H, root = np.array(kind["H"]), np.sqrt(kind["weights"])
    gain = np.linalg.pinv(root[:, None] * H) * root
    assert pytest.approx(np.eye(3), abs=1e-14) == gain @ H
    return gain


def test_recorded_frames_fused_by_the_documentation_navigate_the_same(recordings, tmp_path):
    recorded = recordings(".log")
    scenario = tmp_path / "own.toml"
    scenario.write_text(recorded.scenario.toml())
    fusion = shown(scenario)["fusion"]
    epochs, gyro_dtheta, accelerometer_dv = increments(recorded.path)
    dtheta_s = gyro_dtheta @ gain_of(fusion["gyros"]).T
    dv_s = accelerometer_dv @ gain_of(fusion["accelerometers"]).T

    ram = recorded.firmware.ram[0]
    own = Ins.zeros()
    site = recorded.scenario.site
    strapdown.initialise(
        own[0],
        ram["alignment"]["C_s_n"],
        math.radians(site.latitude_deg),
        math.radians(site.longitude_deg),
        site.height_m,
    )
    navigated = (epochs > recorded.scenario.navigation_epoch) & (epochs < epochs[-1])
    for dtheta, dv in zip(dtheta_s[navigated], dv_s[navigated], strict=True):
        strapdown.update_array(own, dtheta, dv, fusion["period_ns"] * 1e-9, strapdown.HEIGHT_HELD)
    theirs = ram["ins"]
    assert np.abs(own[0]["velocity_n"]).max() > 1e-6  # its errors are those of the run
    assert own[0]["latitude"] == pytest.approx(theirs["latitude"], abs=1e-15)
    assert own[0]["longitude"] == pytest.approx(theirs["longitude"], abs=1e-15)
    assert own[0]["velocity_n"] == pytest.approx(theirs["velocity_n"], abs=1e-11)
    assert own[0]["q_s_n"] == pytest.approx(theirs["q_s_n"], abs=1e-13)
