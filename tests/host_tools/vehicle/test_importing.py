"""A vehicle's recording through the firmware: as exact as its increments, aided by its fixes."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from rrins.dbc.codec import load
from rrins.host_tools.cli.main import rrins
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.logs.replay import replay
from rrins.host_tools.recording.note import read_note
from rrins.host_tools.runs.results.results import read_errors
from rrins.host_tools.vehicle import beginning, importing, reading
from rrins.host_tools.vehicle.errors import VehicleError

DATA = os.environ.get("RRINS_VEHICLE_DATA")


def navigated(log, folder, **changes):
    """Return the summary of a replay and its errors."""
    found = Log(log)
    scenario = found.note.loaded_scenario(log).varied(**changes)
    folder.mkdir()
    replayed = replay(found, scenario, folder)
    return replayed, read_errors(folder, scenario.rate_hz)


@pytest.fixture(scope="module")
def imported(drive, tmp_path_factory):
    path = tmp_path_factory.mktemp("imported") / "drive.log"
    return importing.write(reading.read(drive.folder / "drive.yaml"), path)


def test_increments_without_errors_navigate_to_the_millimetre(drive, tmp_path, imported):
    # what the filter does not touch is what the strapdown makes of the increments
    own = tmp_path / "own.toml"
    own.write_text("[estimator]\nenabled = false\n")
    alone = importing.write(
        reading.read(drive.folder / "drive.yaml"), tmp_path / "alone.log", own_scenario=own
    )
    navigation = np.loadtxt(drive.folder / "navigation.nav")
    clock = navigation[:, 1] - navigation[0, 1] + alone.scenario.navigation_epoch / 100
    np.savetxt(
        tmp_path / "alone.log.truth.csv",
        np.column_stack([clock, navigation[:, 2:5]]),
        fmt="%.12f",
        delimiter=",",
        header="time_s,latitude_deg,longitude_deg,height_m",
        comments="",
    )
    replayed, errors = navigated(tmp_path / "alone.log", tmp_path / "out")
    assert replayed.why_no_truth is None
    assert replayed.firmware["epochs_navigated"] >= 100 * 59
    assert len(errors) > 500
    assert np.abs(errors.position_east_m).max() < 1e-3
    assert np.abs(errors.position_north_m).max() < 1e-3


def test_fixes_aid_the_navigation(imported, tmp_path):
    replayed, errors = navigated(imported.file, tmp_path / "out")
    sources = replayed.firmware["estimator"]["sources"]
    assert sources["gnss_position"]["used"] > 150
    assert 0.5 < sources["gnss_position"]["nis"] < 1.6
    assert 0.5 < sources["gnss_velocity"]["nis"] < 1.6
    late = errors.time_s > 20
    assert np.sqrt(np.mean(errors.position_east_m[late] ** 2)) < 0.35
    assert np.sqrt(np.mean(errors.position_north_m[late] ** 2)) < 0.35
    assert np.abs(errors.heading_deg[late]).max() < 0.2
    _, alone = navigated(imported.file, tmp_path / "alone", estimator__enabled=False)
    assert np.abs(alone.position_east_m).max() > 2 * np.abs(errors.position_east_m).max()


def test_csv_gives_the_same_as_kf_gins(drive, tmp_path, imported):
    attitude = np.radians(drive.truth[0, 8:11])
    recording = reading.read(drive.folder, "csv")
    start = float(recording.increments.time_s[0])
    path = tmp_path / "drive.log"
    importing.write(recording, path, start_s=start, attitude=attitude)
    ours, theirs = Log(path), Log(imported.file)
    sync = load().frame_id("SENSOR_2")

    def data(log):
        found = [piece.frames[piece.frames["can_id"] == sync]["data"] for piece in log.pieces()]
        return np.concatenate(found)

    one, other = data(ours), data(theirs)
    assert len(one) > 5000
    assert np.array_equal(one[: len(other)], other[: len(one)])


def test_the_note_says_what_it_is(imported):
    note = read_note(imported.file)
    assert note.origin == "vehicle"
    assert note.truth == "drive.log.truth.csv"
    scenario = note.loaded_scenario(imported.file)
    assert scenario.gyros.angle_random_walk_deg_per_sqrt_h == pytest.approx(0.003)
    noise = 0.03 / 60 / 9.80665e-6
    assert scenario.accelerometers.white_noise_ug_per_sqrt_hz == pytest.approx(noise)
    assert scenario.estimator.heading_sigma_arcsec == pytest.approx(72)
    assert scenario.mode == "strapdown"


def test_an_attitude_that_nobody_gives_is_found(drive):
    recording = reading.read(drive.folder, "csv")
    state = beginning.find(recording)
    true = drive.truth[0, 8:11]
    found = np.degrees(state.attitude)
    assert found[:2] == pytest.approx(true[:2], abs=0.1)
    assert (found[2] - true[2] + 180) % 360 - 180 == pytest.approx(0.0, abs=3.0)
    assert "heading by the course over ground" in state.notes[0]


def test_more_sensors_need_their_axes(drive, tmp_path):
    table = np.genfromtxt(drive.folder / "increments.csv", delimiter=",", names=True)[:1000]
    angle = np.column_stack([table[f"dtheta_b_{axis}_rad"] for axis in "xyz"])
    velocity = np.column_stack([table[f"dv_b_{axis}_mps"] for axis in "xyz"])
    slanted = np.array([1, 1, 1]) / np.sqrt(3)
    columns = [table["time_s"], *angle.T, angle @ slanted, *velocity.T, velocity @ slanted]
    names = ["time_s", *(f"gyro_{k}_dtheta_rad" for k in range(1, 5))]
    names += [f"accelerometer_{k}_dv_mps" for k in range(1, 5)]
    folder = tmp_path / "four"
    folder.mkdir()
    np.savetxt(
        folder / "increments.csv",
        np.column_stack(columns),
        fmt="%.17g",
        delimiter=",",
        header=",".join(names),
        comments="",
    )
    (folder / "gnss.csv").write_bytes((drive.folder / "gnss.csv").read_bytes())
    recording = reading.read(folder)
    attitude = np.radians(drive.truth[0, 8:11])
    with pytest.raises(VehicleError, match=r"say in \[rimu\] of a --scenario where they point"):
        importing.write(recording, tmp_path / "four.log", attitude=attitude)
    own = tmp_path / "own.toml"
    own.write_text('[rimu]\ngeometry = "orthogonal-plus-one"\n')
    found = importing.write(recording, tmp_path / "four.log", own, attitude=attitude)
    assert len(found.scenario.rimu.gyros) == 4


def test_a_vehicle_that_moves_is_refused(drive, tmp_path):
    moving = drive.truth[np.argmax(np.hypot(drive.truth[:, 5], drive.truth[:, 6])), 1]
    with pytest.raises(VehicleError, match=r"moves at .* give a time at which it stands"):
        importing.write(
            reading.read(drive.folder / "drive.yaml"), tmp_path / "x.log", start_s=float(moving)
        )


@pytest.mark.pictures
def test_the_command_imports_and_replays(drive, tmp_path, run):
    log = tmp_path / "drive.blf"
    summary = run("import", drive.folder / "drive.yaml", log, "--duration", 20)
    assert summary["fixes"] >= 18
    assert summary["rate_hz"] == 100
    assert Path(summary["truth"]).is_file()
    again = run("replay", log, "--firmware", "--out", tmp_path / "out")
    assert again["recording"]["no_truth"] is None
    assert again["recording"]["rms_error"]["position_m"]["east"] < 1.0
    assert json.loads((tmp_path / "out" / "summary.json").read_text()) == again


@pytest.mark.pictures
def test_aided_stands_beside_unaided(imported, tmp_path, run):
    out = tmp_path / "out"
    words = ("replay", imported.file, "--firmware", "--out", out)
    found = run(
        *words, "--set", "estimator.gate=6", "--beside", "estimator.enabled=false estimator.gate=7"
    )
    aided, unaided = found["beside"]
    assert aided["settings"] == "estimator.gate=6"
    assert aided["is_error"]
    assert aided["rms_level_m"] < unaided["rms_level_m"]
    assert unaided["estimator"] is None
    assert unaided["navigation_sha256"] != found["navigation_sha256"]
    assert (out / "beside.png").stat().st_size > 10_000
    alone = json.loads((out / "beside-1" / "summary.json").read_text())
    assert alone["navigation_sha256"] == unaided["navigation_sha256"]
    assert (
        run(*words, "--set", "estimator.enabled=false")["navigation_sha256"]
        == (unaided["navigation_sha256"])
    )


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("estimator.gate", "not KEY=VALUE"),
        ("estimator.gatw=3", "did you mean gate"),
        ("rate_hz=200", "a recording has its own rate"),
    ],
)
def test_a_setting_that_is_none_is_told(imported, setting, words):
    ended = CliRunner().invoke(
        rrins, ["replay", str(imported.file), "--firmware", "--set", setting]
    )
    assert ended.exit_code == 3
    assert words in ended.stderr
    ended = CliRunner().invoke(rrins, ["replay", str(imported.file), "--set", setting])
    assert ended.exit_code == 2


@pytest.mark.skipif(not DATA, reason="set RRINS_VEHICLE_DATA to NaveGo's examples/synthetic-data")
def test_published_data_navigate(tmp_path):
    folder = Path(DATA)
    imus = sorted(folder.glob("imu*.mat"))
    recording = reading.read(folder, imu=imus[-1] if len(imus) > 1 else None)
    importing.write(recording, tmp_path / "published.log")
    _, errors = navigated(tmp_path / "published.log", tmp_path / "out")
    late = errors.time_s > 100
    sigma = float(np.median(recording.fixes.place_sigma))
    assert np.sqrt(np.mean(errors.position_east_m[late] ** 2)) < sigma / 2
    assert np.sqrt(np.mean(errors.position_north_m[late] ** 2)) < sigma / 2
