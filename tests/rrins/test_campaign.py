"""A campaign from Python."""

from __future__ import annotations

import pytest

import rrins


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    made = rrins.Campaign(
        "rimu_rotating",
        runs=60,
        duration_s=10,
        turn_rate_dps=4,
        vary={"gyros.scale_error_ppm": "normal(0, 500) common"},
        out=tmp_path_factory.mktemp("campaign") / "c",
    )
    return made.run(workers=2, progress=False)


@pytest.mark.slow
def test_its_tables_have_all_runs_and_their_figures(campaign):
    table = campaign.table()
    assert table.index.tolist() == list(range(60))
    assert (table["status"] == "ok").all()
    assert campaign.table("horizontal_error_m").columns.tolist() == ["horizontal_error_m"]
    median = campaign.percentiles().loc[("horizontal_error_m", 50.0)]
    assert median["low"] <= median["value"] <= median["high"]
    assert median["value"] == campaign.cep().loc["cep50_m", "value"]
    assert campaign.sensitivity().index[0] == "gyros.scale_error_ppm"
    assert campaign.compare(campaign).p_value == 1


@pytest.mark.slow
def test_it_is_there_again_and_so_is_each_of_its_runs(campaign):
    again = rrins.Campaign.open(campaign.folder)
    assert len(again.run(progress=False).table()) == 60
    run = again.rerun(7)
    row = again.table().loc[7]
    assert run.summary["end_position_error_m"] == row["horizontal_error_m"]
    assert run.scenario.firmware.turn_rate_dps == 4
    assert again.report()[0].is_file()
