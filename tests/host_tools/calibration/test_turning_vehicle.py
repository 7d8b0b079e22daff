"""Schemes in a vehicle that turns: where the table is, and what isolates the heading."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from rrins.firmware_py.core.settings import Scheme, Turn
from rrins.host_tools.calibration.turning_vehicle import angles_of, isolated
from rrins.host_tools.cli.main import rrins
from rrins.host_tools.hardware.memory import INNER, OUTER

SCHEME = Scheme(
    turns=(Turn(axis="outer", angle_deg=180), Turn(axis="inner", angle_deg=180)),
    turn_rate_dps=6.0,
    stand_s=5.0,
)


def rotation(axis, angle):
    """Return the matrix of a turn about x (0) or z (2)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array(
        [[1, 0, 0], [0, c, -s], [0, s, c]] if axis == 0 else [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    )


def test_cycle_follows_cycle():
    angles = np.degrees(angles_of(SCHEME, np.array([0.0, 15.0, 32.0, 50.0, 70.0, 85.0, 139.9])))
    assert angles[:, OUTER] == pytest.approx([0, 90, 180, 180, 180, 270, 360])
    assert angles[:, INNER] == pytest.approx([0, 0, 0, 90, 180, 180, 360], abs=0.7)


def test_a_vehicle_that_keeps_its_heading_needs_no_isolation():
    angles = angles_of(SCHEME, np.arange(0.0, 500.0, 0.5))
    assert isolated(angles, np.full(len(angles), 1.2)) == pytest.approx(angles)


def test_with_the_outer_axis_upright_the_sensors_do_not_notice_the_vehicles_turn():
    times_s = np.arange(0.0, 500.0, 0.5)
    angles = angles_of(SCHEME, times_s)
    heading = 0.3 + np.radians(7.0) * times_s  # ten turns
    taken = isolated(angles, heading)
    is_upright = np.abs(np.sin(angles[:, OUTER])) < 1e-9
    assert is_upright.sum() > 400
    for at in np.flatnonzero(is_upright):
        ways = [
            rotation(2, -h) @ rotation(0, one[OUTER]) @ rotation(2, one[INNER])
            for h, one in ((heading[0], angles[at]), (heading[at], taken[at]))
        ]
        assert ways[1] == pytest.approx(ways[0], abs=1e-9)
    extra = np.degrees(taken[:, INNER] - angles[:, INNER])
    assert np.abs(np.diff(extra)).max() < 90  # in half a second: no jumps by whole turns


@pytest.mark.slow
def test_isolation_takes_most_of_the_bias_away(tmp_path):
    """Constants of the gyros' bias alone, on the first route; noise is the same for all."""
    file = tmp_path / "bias.toml"
    file.write_text("[gyros]\nbias_dph = 0.1\n")
    command = ["scheme", "compare", "16-position", "--case", "drive", "--routes", "1", "--json"]
    result = CliRunner().invoke(rrins, [*command, "--errors", str(file)])
    assert result.exit_code == 0, result.output
    rows = {row["scheme"]: row for row in json.loads(result.stdout)["schemes"]}
    strapdown, plain, without = (
        rows[name] for name in ("strapdown", "16-position", "16-position, isolated")
    )
    assert without["constants_m"] < 0.3 * plain["constants_m"]
    assert plain["constants_m"] == pytest.approx(strapdown["constants_m"], rel=0.5)
    for row in rows.values():
        assert row["noise_m"] == pytest.approx(strapdown["noise_m"])
