"""Studies from Python: as tables and figures, the same as the command line's."""

from __future__ import annotations

import json
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import rrins
from rrins.host_tools.cli.main import rrins as command


def said(*words):
    ended = CliRunner().invoke(command, [*words, "--json"])
    assert ended.exit_code == 0, ended.output
    return json.loads(ended.stdout)


def test_the_covariance_of_a_scenario(tmp_path):
    found = rrins.analyse_covariance("rimu_rotating", duration_s=60, sensors="prototype")
    printed = said("covariance", "rimu_rotating", "--duration", "60", "--set", "sensors=prototype")
    assert found.sources["share"].to_dict() == {
        one["name"]: one["share"] for one in printed["sources"]
    }
    assert found.sources["share"].sum() == pytest.approx(1.0)
    assert found.sigma["east_m"].iloc[-1] == printed["sigma_m"]["east"]
    assert found.sigma.index[-1] == 60
    assert found.agrees is None
    assert found.plot().axes[0].get_ylabel() == "σ of the position, east\n/ m"
    assert "share" in found._repr_html_()
    assert [path.name for path in found.save(tmp_path)] == ["covariance.csv", "covariance.png"]


def test_the_covariance_of_an_aided_scenario(tmp_path):
    true = {"gnss.position_noise_m": 6.0}
    found = rrins.analyse_covariance("drive_aided", duration_s=40, rate_hz=100, true=true)
    said_so = ("--set", "rate_hz=100", "--true", "gnss.position_noise_m=6")
    printed = said("covariance", "drive_aided", "--duration", "40", *said_so)
    assert found.quantities.loc["height_m"].to_dict() == printed["quantities"]["height_m"]
    assert found.quantities.loc["position_east_m", "ratio"] > 1.1
    heading = found.over_time("heading_arcsec")
    assert list(heading) == ["true", "filter"]
    assert heading["filter"].iloc[-1] == printed["quantities"]["heading_arcsec"]["filter_sigma"]
    for name in printed["quantities"]:
        shares = [one["shares"][name] for one in printed["sources"]]
        assert sum(shares) == pytest.approx(1.0)
    labels = [axes.get_ylabel() for axes in found.plot_filter().axes]
    assert "σ of the velocity, horizontal\n/ (m/s)" in labels
    written = [path.name for path in found.save(tmp_path)]
    assert written == ["covariance.csv", "covariance.png", "covariance_filter.png"]
    rows = pd.read_csv(tmp_path / "covariance.csv")
    assert rows["filter: heading_arcsec"].iloc[-1] == pytest.approx(
        heading["filter"].iloc[-1], 1e-5
    )
    with pytest.raises(
        rrins.RehearsalError, match=r"--true body\.heading_deg: is for keys of gyros"
    ):
        rrins.analyse_covariance("drive_aided", true={"body.heading_deg": 1.0})


def test_the_covariance_beside_the_runs_of_a_campaign(tmp_path):
    campaign = rrins.Campaign(
        "rimu_rotating", runs=20, duration_s=10, out=tmp_path / "runs", sensors="prototype"
    )
    campaign.run(workers=1, progress=False)
    found = rrins.analyse_covariance(campaign)
    assert found.agrees is not None
    assert rrins.analyse_covariance(campaign.folder).agrees == found.agrees


@pytest.mark.slow
def test_what_redundant_sensors_find(tmp_path):
    steps = {"gyro_steps_dph": [1, 10], "accelerometer_steps_ug": [5000]}
    found = rrins.study_redundancy(geometries=["tetrahedron"], **steps, runs=1)
    printed = said(
        *("redundancy", "--rimu", "tetrahedron", "--runs", "1"),
        *("--gyro", "1", "--gyro", "10", "--accelerometer", "5000", "--out", str(tmp_path)),
    )
    assert found.values["candidates"] == printed["candidates"]
    assert set(found.smallest["geometry"]) == {"tetrahedron"}
    gyros = found.delays[found.delays["kind"] == "gyros"]
    assert set(gyros["fault"]) == {1, 10}
    alarms = gyros[(gyros["way"] == "alarm") & (gyros["geometry"] == "tetrahedron")]
    assert np.all(np.diff(alarms.sort_values("fault")["theory_half_s"]) < 0)
    assert found.plot().axes
    assert found.save(tmp_path / "own")[0].read_text().lower().startswith("<!doctype html>")


def test_a_unit_calibrated(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = rrins.calibrate(turn_rate_dps=30, stand_s=0.5)
    assert list(tmp_path.iterdir()) == []  # nothing is written unasked
    assert {path.name for path in found.save("mine")} >= {"calibration.toml"}
    assert found.file.name == "calibration.toml"
    assert found.report.exists()
    assert found.verified == ""
    sensors = found.constants.groupby(["kind", "constant"])["sensor"].max()
    assert set(sensors) == {4}
    bias = found.constants[found.constants["constant"] == "bias_dph"]
    assert bias["value"].tolist() == found.values["gyros"]["bias_dph"]["value"]
    assert (found.constants["sigma"] > 0).all()
    again = rrins.simulate(
        "rimu_rotating", duration_s=1, calibration=str(found.file), progress=False
    )
    assert again.summary["firmware"]["calibration"]["file"]
    assert found.plot().axes


def test_the_conformance_of_a_firmware(tmp_path):
    found = rrins.conform(only=["start-up"])
    assert found.failed == []
    assert found.checks["outcome"].tolist() == ["passed"]
    found.write_junit(tmp_path / "junit.xml")
    found.write_page(tmp_path / "page.html")
    assert ElementTree.parse(tmp_path / "junit.xml").getroot().tag == "testsuites"
    assert "start-up" in (tmp_path / "page.html").read_text()
    with pytest.raises(rrins.RehearsalError, match="no check"):
        rrins.conform(only=["start"])


def test_schemes_side_by_side():
    cycle = rrins.compare_schemes(["16-position", "8-position"])
    printed = said("scheme", "compare", "16-position", "8-position")["schemes"]
    assert cycle.index.tolist() == ["16-position", "8-position"]
    rms = [one["velocity_error_rms_mps"] for one in printed]
    assert cycle["velocity_error_rms_mps"].tolist() == rms
    assert cycle["gyro bias, left"].tolist() == [0, 0]


def test_what_a_scheme_shows():
    shown, hidden = rrins.observe_scheme("calibration"), rrins.observe_scheme("16-position")
    assert "shows all constants" in repr(shown)
    assert hidden.observability.unseen
    assert (shown.sigma["sigma"] < 2 * shown.sigma["wanted"]).all()


def test_motion_saved_is_read_and_checked(tmp_path):
    motion = rrins.load_motion("drive", duration_s=60)
    motion.save(tmp_path / "drive.csv", rate_hz=20)
    checked = rrins.check_motion(tmp_path / "drive.csv")
    assert checked["rate_hz"] == pytest.approx(20)
    assert checked["irregularities"] == []
    assert motion.plot().axes
    with pytest.raises(rrins.RehearsalError):
        motion.save(tmp_path / "drive.kml")


def test_what_becomes_of_failures(tmp_path):
    rates = tmp_path / "rates.toml"
    rates.write_text('[[modes]]\nkind = "gyro_absent"\nfit = 1000\n', encoding="utf-8")
    found = rrins.fmeda("rimu_rotating", duration_s=60, rates=rates, runs=1, window_s=10)
    assert found.parts["all"]["unit"] == pytest.approx(4000)
    assert set(found.cells["detected"]) == {1.0}
    assert [path.name for path in found.save(tmp_path)] == ["report.html", "fmeda.csv"]
    assert "gyro_4" in found._repr_html_()
