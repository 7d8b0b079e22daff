"""Sensors that are alike stand in one column; round faults are tried."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from rrins.host_tools.cli.redundancy import tables
from rrins.host_tools.redundancy.candidates import candidates_of
from rrins.host_tools.redundancy.monte_carlo import Delays, Fault, Trials
from rrins.host_tools.redundancy.report import pair, write
from rrins.host_tools.redundancy.survey import Study, round_sizes


@pytest.mark.parametrize(
    ("smallest", "first"), [(0.7, 0.5), (0.5, 0.5), (0.96, 0.5), (304.0, 200.0), (1.0, 1.0)]
)
def test_faults_to_try_are_round_and_begin_below_the_smallest(smallest, first):
    sizes = round_sizes(smallest)
    assert sizes[0] == first
    assert len(sizes) == 6
    assert np.allclose(np.log10(np.divide(sizes[3:], sizes[:-3])), 1.0)


@pytest.fixture(scope="module")
def study():
    said = []
    candidates = candidates_of(None, ["orthogonal-plus-one"])
    made = Study(candidates, {"gyros": [5.0]}, said.append)
    assert len(said) == Study.steps(1, 0)
    return made


def test_three_orthogonal_sensors_are_alike_and_the_fourth_is_not(study):
    (survey,) = study.surveys
    for one in survey.sets:
        assert [group.sensors for group in one.groups] == [(0, 1, 2), (3,)]
        assert [group.words for group in one.groups] == ["1-3", "4"]


def test_the_figures_are_plain_values(study):
    values = json.loads(json.dumps(study.values()))
    gyros = values["candidates"][0]["gyros"]
    assert gyros["count"] == 4
    first, fourth = gyros["groups"]
    assert fourth["smallest"]["alarm"]["10_s"]["half"] < first["smallest"]["alarm"]["10_s"]["half"]
    nothing = dict.fromkeys(("half", "95_percent", "tried"))
    assert first["smallest"]["parity"]["600_s"] == nothing
    (delay,) = fourth["delays_s"]
    assert delay["fault"] == 5.0
    assert delay["theory"]["alarm"]["half"] == pytest.approx(0.8, abs=0.2)
    assert delay["monte_carlo"] is None


def test_theory_that_the_runs_do_not_show_is_doubted(study):
    (survey,) = study.surveys
    of = survey.sets[0]
    group, late = of.groups[1], [10.8, 11.0, 10.5, 11.3, math.inf]
    fault = Fault(of.kind, group.sensors, 5.0)
    try:
        survey.trials = Trials({fault: Delays(alarm=[0.7] * 5, standing=late, parity=late)})
        assert survey.doubted(of, group, 5.0) == ("standing",)
        assert survey.smallest_tried(of, group, "alarm", 10) == 5.0
        assert survey.smallest_tried(of, group, "standing", 10) == math.inf
        assert survey.smallest_tried(of, group, "standing", 60) == 5.0
        delay = study.values()["candidates"][0]["gyros"]["groups"][1]["delays_s"][0]
        assert delay["theory_fails"] == ["standing"]
        table = tables.delay_table(study, survey, of, group)
        assert any("≠" in cell for column in table.columns for cell in column.cells)
        assert tables.lines_below(study)[0].startswith("≠: theory fails")
    finally:
        survey.trials = None


def test_the_report_is_one_page_with_the_picture_inside(study, tmp_path):
    page, picture = write(tmp_path, study, 0, "sensors of a test")
    text = page.read_text()
    assert "http" not in text
    assert text.count("data:image/png;base64,") == 1
    for words in ("orthogonal-plus-one, gyro 1-3", "Smallest step found", "sensors of a test"):
        assert words in text
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_pair_has_a_dash_for_what_is_never_found():
    assert pair(1.0, math.inf) == "1.0 / –"
