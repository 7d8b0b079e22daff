"""The FMEDA: rates, runs from a copied memory, weighted figures."""

from __future__ import annotations

import csv
import json
import math
import threading
import tomllib

import pytest
from click.testing import CliRunner

import rrins
from rrins.host_tools.cli.integrity.fmeda import fmeda
from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.hardware.fault_kinds import HardwareFault
from rrins.host_tools.integrity.fmeda import rates
from rrins.host_tools.integrity.fmeda.study import Fmeda
from rrins.host_tools.integrity.fmeda.table import Table
from rrins.host_tools.integrity.fmeda.trials import Finding, Trial, trials_of
from rrins.host_tools.scenario import scenario

FEW = """
[phases]
later = 3
outage = 1
[[modes]]
kind = "gyro_bias"
fit = 900
bias_dph = 100
[[modes]]
kind = "odometer_lost"
fit = 100
"""


@pytest.fixture
def few(tmp_path):
    path = tmp_path / "rates.toml"
    path.write_text(FEW, encoding="utf-8")
    return path


def test_the_example_has_modes_of_every_part_and_sizes_within_limits():
    found = rates.load()
    assert {mode.fault.part for mode in found.modes} == {kind.part for kind in HardwareFault}
    assert sum(found.phases.values()) == pytest.approx(1.0)
    assert len({mode.name for mode in found.modes}) == len(found.modes)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("modes = 3", "modes: is missing"),
        ('[[modes]]\nkind = "gyro_bais"\nfit = 1', "did you mean gyro_bias"),
        ('[[modes]]\nkind = "gyro_bias"', "modes.1.fit: None is not a number"),
        ('[[modes]]\nkind = "gyro_bias"\nfit = 1\nbias_dph = "normal(0)"', "takes 2 numbers"),
        ('[[modes]]\nkind = "gyro_noise"\nfit = 1\nsigma = 1', "modes.1.sigma: no such key"),
        ('[[modes]]\nkind = "gyro_shift_u"\nfit = 1\nshift_arcsec = 1e6', "must be -3600 to 3600"),
        ('[[modes]]\nkind = "gyro_dead"\nfit = 1\n' * 2, "gyro_dead is there twice"),
        ("[phases]\nlaunch = 1", "did you mean|there are alignment"),
        ("[[modes", "not TOML"),
    ],
)
def test_what_is_wrong_with_a_file_is_one_line(tmp_path, text, words):
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError, match=words) as found:
        rates.load(path)
    assert "mine.toml" in str(found.value)
    assert "\n" not in str(found.value)


def finding(trial, detected_s=math.inf, dangerous_s=math.inf, wrong=()):
    return Finding(trial, detected_s, math.inf, wrong, dangerous_s, 1.0, 1.0, "")


def test_figures_are_weighted_by_rate_and_phase(few):
    found = rates.load(few)
    bias, lost = found.modes

    def of(mode, phase, seed=1):
        return Trial(mode, "gnss", 0, phase, 0, seed, None)

    findings = [
        finding(of(bias, "later"), detected_s=2.0),
        finding(of(bias, "later", 2), dangerous_s=3.0),
        finding(of(bias, "outage"), detected_s=5.0, dangerous_s=4.0, wrong=("gyro_2", "gnss")),
        finding(of(lost, "later"), detected_s=1.0),
        finding(of(lost, "outage"), detected_s=9.0, dangerous_s=9.0),
    ]
    unit = Table(found, findings).unit
    assert unit.fit == pytest.approx(1000)
    shares = {name: share.value for name, share in unit.shares.items()}
    later, outage = 900 * 0.75, 900 * 0.25
    assert shares["detected"] == pytest.approx((0.5 * later + outage + 100) / 1000)
    assert shares["dangerous_undetected"] == pytest.approx((0.5 * later + outage) / 1000)
    assert shares["wrong_sensor"] == pytest.approx(outage / 1000)
    assert shares["latent"] == 0
    fits = unit.rates_fit()
    assert sum(fits.values()) == pytest.approx(1000)
    assert fits["dangerous_detected"] == pytest.approx(25)
    assert unit.quantile(lambda one: one.detected_s, 0.5) == 5.0
    assert unit.quantile(lambda one: one.detected_s, 0.95) == math.inf


def test_a_run_from_a_copy_is_the_run_that_its_scenario_repeats():
    mode = next(mode for mode in rates.load().modes if mode.name == "gyro_bias")
    one = rates.Rates((mode,), {"later": 1.0, "alignment": 0, "first_turn": 0, "outage": 0})
    loaded = scenario.load("drive_outage", duration_s=120)
    study = Fmeda("drive", loaded, one, alert_m=0.01, runs=1, seed=4, window_s=30)
    study.trials = [trial for trial in study.trials if trial.phase == "later"][:1]
    study.run(1, threading.Event())
    (found,) = study.findings
    failing = found.trial.scenario(study.scenario, 30)
    repeated, healthy = rrins.simulate(failing), rrins.simulate(failing.varied(faults=()))
    moved = repeated.errors.position_n - healthy.errors.position_n
    moved_m = (moved.sel(axis="east") ** 2 + moved.sel(axis="north") ** 2) ** 0.5
    assert float(moved_m.max()) == pytest.approx(found.effect_m, rel=0.02)
    redundancy = repeated.summary["redundancy"]["gyros"]
    assert redundancy["alarm_s"] - 60 == pytest.approx(found.detected_s, abs=0.02)


def test_trials_are_drawn_by_the_seed_alone():
    loaded, modes = scenario.load("drive_outage"), rates.load().modes
    first, again = trials_of(loaded, modes, 2, 1), trials_of(loaded, modes, 2, 1)
    assert first == again
    assert {trial.phase for trial in first} == {"alignment", "first_turn", "later", "outage"}
    assert [t.value for t in first if t.seed == 2] == [
        t.value for t in trials_of(loaded, modes, 1, 2)
    ]


def test_the_command_shows_its_example_and_runs_a_file(few, tmp_path):
    shown = CliRunner().invoke(fmeda, ["--show-rates"])
    assert tomllib.loads(shown.stdout)["phases"]["later"] == 0.83
    words = ["drive_outage", "--rates", str(few), "--runs", "1", "--window", "40", "--json"]
    done = CliRunner().invoke(fmeda, [*words, "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    values = json.loads(done.stdout)
    assert values["done"] == values["planned"] == 5 * 4
    assert values["parts"]["odometer"]["shares"]["detected"]["value"] == 1.0
    with (tmp_path / "out" / "fmeda.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 20
    assert "gyro bias, later" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    repeated = scenario.load(rows[0]["repeat"].split()[-1])
    assert repeated.faults[0].kind == rows[0]["mode"]
