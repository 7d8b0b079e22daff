"""Schemes and motion from Python."""

from __future__ import annotations

import pytest

import rrins


def test_a_scheme_is_analysed():
    analysis = rrins.analyse_scheme("16-position", turn_rate_dps=4)
    table = analysis.residuals
    assert len(table) == 2 * 4 * 4 * 3
    assert table[table.error == "bias"].vanishes.all()
    assert "residuals remain" in repr(analysis)
    assert "<table" in analysis._repr_html_()
    panels = analysis.plot(3, "accelerometer").axes
    assert panels[0].get_ylabel().startswith("velocity error")


def test_a_scheme_that_is_not_there():
    with pytest.raises(rrins.ScenarioError, match="did you mean 16-position"):
        rrins.analyse_scheme("16-positon")


def test_a_search_finds_the_paper_s_number_of_residuals():
    from rrins.host_tools.rotation.enumeration import Limits

    found = rrins.search_schemes(Limits(positions=8), top=2)
    assert len(found.best) == 2


def test_motion_as_a_dataset():
    motion = rrins.load_motion("drive", duration_s=60)
    assert motion.duration_s >= 60
    speed = (motion.states.velocity_n**2).sum("axis") ** 0.5
    assert float(speed.max()) > 5
    assert motion.states.latitude.units == "deg"
    assert "drives" in repr(motion)
    with pytest.raises(rrins.ScenarioError, match="wave_height_m"):
        rrins.load_motion("drive", wave_height_m=2)
