"""Why the error is what it is: against closed forms, the linear equations and itself."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from rrins.host_tools.cli.main import rrins
from rrins.host_tools.covariance.sources import KINDS
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.explanation.check import check
from rrins.host_tools.explanation.explain import Explanation, explain
from rrins.host_tools.explanation.reruns import StoppedError
from rrins.host_tools.scenario.scenario import Scenario, load
from rrins.run import simulate

_GRAVITY = 9.80
_DPH = math.radians(1) / 3600


def _horizontal(found: Explanation) -> float:
    return float(np.linalg.norm(found.error[-1, :2]))


def _whole(found: Explanation) -> list[float]:
    parts = sum((part.value for part in found.parts), np.zeros(9))
    return list(parts + found.rest[-1] + found.together)


def test_a_single_bias_is_the_whole_error() -> None:
    """δr = g ε t³ / 6 of a gyro that points to the east, to the north."""
    scenario = load("imu_strapdown", duration_s=70).varied(
        gyros__bias_dph=(1.0, 0.0, 0.0), accelerometers__bias_ug=0.0
    )
    found = explain(scenario, 60.0)
    (part,) = found.parts
    assert (part.source, part.part) == ("gyro bias", "gyro 1")
    north = _GRAVITY * _DPH * 60.0**3 / 6.0
    assert abs(part.value[1]) == pytest.approx(north, rel=0.02)
    assert found.share(part.value, "position") == pytest.approx(1.0, abs=1e-3)
    assert np.abs(found.rest[-1, :2]).max() < 0.001 * north
    assert found.together == pytest.approx(np.zeros(9), abs=1e-12)


def test_parts_add_up_and_agree_with_the_linear_equations() -> None:
    """Of constants, noise and drift, each as the run drew it."""
    scenario = load("experiment_rotating", duration_s=70).varied(
        gyros__installation_u_arcsec=(10.0, -5.0, 0.0, 7.0), firmware__heading_error_arcsec=100.0
    )
    found = explain(scenario, 60.0, "source")
    assert _whole(found) == pytest.approx(list(found.error[-1]), rel=1e-9, abs=1e-12)
    assert np.linalg.norm(found.together[:2]) < 0.01 * _horizontal(found)
    linear = check(scenario, found)
    assert ("gyro installation", "") in linear.constants
    assert linear.largest_m < 0.01 * max(np.linalg.norm(p.value[:2]) for p in found.parts)
    assert {"gyro white noise", "gyro bias instability"} <= linear.sigmas.keys()
    drawn = next(p.value for p in found.parts if p.source == "gyro white noise")
    assert np.linalg.norm(drawn[:2]) < 4 * np.linalg.norm(linear.sigmas["gyro white noise"])


def test_all_sources_of_a_kind_are_the_sum_of_its_sensors() -> None:
    scenario = load("rimu_rotating", duration_s=30)
    single, joined = (explain(scenario, 20.0, by) for by in ("sensor", "source"))
    assert len(single.parts) == 8
    for part in joined.parts:
        of_sensors = [one.value for one in single.parts if one.source == part.source]
        assert sum(of_sensors) == pytest.approx(part.value, rel=1e-3, abs=1e-5)


def test_an_aided_run_is_split_too() -> None:
    """The filter keeps its tuning: without the receiver's noise its error is no larger."""
    scenario = load("drive_aided", duration_s=60)
    found = explain(scenario, 40.5, "source")
    names = {part.source for part in found.parts}
    assert {"GNSS velocity noise", "odometer mounting", "odometer scale factor"} <= names
    assert _whole(found) == pytest.approx(list(found.error[-1]), rel=1e-9, abs=1e-12)
    assert np.linalg.norm(found.together[:3]) < 0.1 * np.linalg.norm(found.error[-1, :3])
    linear = check(scenario, found)
    assert len(linear.constants) == 4
    largest = max(np.hypot(*track) for track in linear.constants.values())
    assert linear.largest_m < 0.05 * largest
    assert {"GNSS position noise", "odometer noise"} <= set(linear.sigmas)
    assert set(linear.not_covered) == {"odometer mounting", "odometer scale factor"}


@pytest.mark.parametrize(
    "fault",
    [
        {"kind": "gyro_bias", "sensor": 2, "bias_dph": 30.0, "at_s": 10.0},
        {"kind": "drop", "message": "SENSOR_2", "probability": 0.5, "at_s": 10.0, "for_s": 5.0},
    ],
)
def test_a_fault_is_a_source(fault: dict[str, object]) -> None:
    scenario = Scenario.model_validate(
        load("ideal", duration_s=30).model_dump(exclude_unset=True)
        | {"faults": [fault], "redundancy": {"enabled": False}}
    )
    found = explain(scenario, 25.0)
    (part,) = found.parts
    assert part.source == "fault 1"
    assert part.part.startswith(str(fault["kind"]).replace("_", " "))
    assert part.value == pytest.approx(found.error[-1] - found.rest[-1], abs=1e-12)
    assert np.linalg.norm(part.value[:2]) > 100 * np.linalg.norm(found.rest[-1, :2])


def test_a_calibrated_constant_errs_by_what_is_left_of_it(tmp_path: Path) -> None:
    file = tmp_path / "unit.toml"
    file.write_text("[gyros]\nbias_dph = [0.1, 0.11, 0.12, 0.03]\n")
    scenario = load("rimu_rotating", duration_s=30).varied(
        firmware__calibration=str(file), accelerometers__bias_ug=0.0
    )
    found = explain(scenario, 20.0)
    assert [part.part for part in found.parts] == ["gyro 4"]


def test_it_stops_when_it_is_told_to() -> None:
    with pytest.raises(StoppedError):
        explain(load("rimu_rotating"), 20.0, should_stop=lambda: True)


def test_a_run_explains_itself() -> None:
    run = simulate("rimu_rotating", duration_s=30)
    found = run.explain(20, by="source")
    total = found.parts.drop(columns="share").sum() + found.rest + found.together
    assert total.to_numpy() == pytest.approx(found.error.to_numpy(), rel=1e-9, abs=1e-12)
    at = run.errors.sel(time=found.time_s, method="nearest")
    assert found.error["east_m"] == float(at.position_n.sel(axis="east"))
    assert found.parts.index.names == ["source", "part"]
    assert "Why the position is off by" in repr(found)
    run.scenario = None  # type: ignore[assignment]  # not what it looks at
    run._result.errors.position_east_m[:] += 1.0
    with pytest.raises(RehearsalError, match="live faults, frames that came late, or a program"):
        run.explain(20, by="source")


@pytest.mark.pictures
def test_the_command_prints_a_table_or_json_and_draws(tmp_path: Path) -> None:
    words = ["explain", "--at", "10", "--duration", "20", "--by", "source", "--out", str(tmp_path)]
    shown = CliRunner().invoke(rrins, [*words, "--check"])
    assert shown.exit_code == 0, shown.output
    assert "gyro bias" in shown.output
    assert "linear error equations: 2 constants" in shown.output
    assert (tmp_path / "explain.png").stat().st_size > 10_000
    printed = CliRunner().invoke(rrins, [*words, "--of", "attitude", "--json"])
    values = json.loads(printed.output)
    assert {part["source"] for part in values["parts"]} == {f"{k[:-1]} bias" for k in KINDS}
    assert sum(p["share"]["attitude"] for p in values["parts"]) == pytest.approx(1.0, abs=0.2)


def test_what_cannot_be_explained_is_refused_in_a_line(tmp_path: Path) -> None:
    log = tmp_path / "bus.log"
    log.write_text("(0.000000) can0 080#0000000000000000\n")
    refused = CliRunner().invoke(rrins, ["explain", str(log), "--at", "10"])
    assert isinstance(refused.exception, SystemExit)
    assert refused.exit_code == 1
    assert "a recording that says nothing of its scenario cannot be run again" in refused.output
    late = CliRunner().invoke(rrins, ["explain", "--at", "30", "--duration", "20"])
    assert "explain: at 30 s: navigation ends at 20 s" in late.output
    assert CliRunner().invoke(rrins, ["explain"]).exit_code == 2
