"""Fused increments for other navigators: frames, signs, files, and another navigator's opinion."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pyarrow.csv
import pyarrow.parquet
import pytest
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from rrins.host_tools.errors import FirmwareFaultError, RehearsalError
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.vehicle.body_increments import Derotator
from rrins.host_tools.vehicle.fused import FusedIncrements, fused_of_scenario
from rrins.host_tools.vehicle.navigator_files import forward_right_down, write

OMEGA = 7.292115e-5
DT = 0.005
QUICK = {"turn_rate_dps": 30, "stand_s": 5, "alignment_s": 0.5}
TURNING = {
    "duration_s": 60,
    "body": {"heading_deg": 30.0, "roll_deg": 2.0, "pitch_deg": -3.0},
    "firmware": QUICK,
}
DRIVING = {
    "duration_s": 180,
    "motion": {"kind": "drive"},
    "altimeter": {},
    "firmware": QUICK | {"height_channel": "damped"},
}


def scenario_of(case):
    return Scenario.model_validate(case)


def written(folder, case, kind="csv", frame="b"):
    scenario = scenario_of(case)
    return write(fused_of_scenario(scenario), scenario.period_ns, folder, kind, frame)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Return a function that gives the folder of a format for a case."""
    done = {}

    def folder_of(case, kind, frame="b"):
        key = (id(case), kind, frame)
        if key not in done:
            done[key] = tmp_path_factory.mktemp("increments")
            written(done[key], case, kind, frame)
        return done[key]

    return folder_of


def read(path):
    """Return a table of CSV; each number to the last bit."""
    return pyarrow.csv.read_csv(path).to_pandas()


def vectors(table, name, unit):
    return table[[f"{name}_{axis}_{unit}" for axis in "xyz"]].to_numpy()


# Frames and signs


def test_the_body_at_rest_turns_with_the_earth_whatever_the_table_does(files):
    table = read(files(TURNING, "csv") / "increments.csv")
    dtheta, dv = vectors(table, "dtheta_b", "rad")[1:], vectors(table, "dv_b", "mps")[1:]
    latitude = math.radians(40.3554)
    about_z, about_x, about_y = (
        Rotation.from_rotvec(axis)
        for axis in ([0, 0, -math.radians(30)], [math.radians(-3), 0, 0], [0, math.radians(2), 0])
    )
    C_n_b = (about_z * about_x * about_y).inv()
    rate_b = C_n_b.apply([0, OMEGA * math.cos(latitude), OMEGA * math.sin(latitude)])
    up_b = C_n_b.apply([0, 0, 1])
    seconds = DT * len(dtheta)
    # Encoders of 24 bits leave 0.04″ at most, and nothing that grows.
    assert dtheta.sum(axis=0) == pytest.approx(rate_b * seconds, abs=4e-7)
    gravity = np.linalg.norm(dv.sum(axis=0)) / seconds
    assert gravity == pytest.approx(9.8017, abs=1e-3)
    assert dv.sum(axis=0) == pytest.approx(up_b * gravity * seconds, abs=3e-5)
    assert np.abs(dtheta - rate_b * DT).max() < 1e-6
    assert not table["bridged"].any()


def test_the_sensors_own_frame_has_the_turning_and_the_angles(files):
    table = read(files(TURNING, "csv", "s") / "increments.csv")
    dtheta = vectors(table, "dtheta_s", "rad")
    inner = np.radians(table["inner_deg"].to_numpy())
    outer = table["outer_deg"].to_numpy()
    first_turn = np.flatnonzero(outer != 0)[0]
    assert inner[first_turn - 1] == pytest.approx(math.pi, abs=1e-6)
    turned = dtheta[1:first_turn, 2].sum()
    assert turned == pytest.approx(math.pi, abs=1e-3)  # and the Earth's rate
    truth = read(files(TURNING, "csv", "s") / "truth.csv")
    assert truth["heading_deg"].to_numpy() == pytest.approx(30.0)


def test_a_turn_of_the_table_in_a_turning_body_is_taken_out():
    # Increments of both frames by closed forms: constant rates of the body and of the inner axis.
    rate_b, axis_rate, force_b = np.array([0.02, -0.03, 0.05]), 0.5, np.array([0.4, -0.2, 9.8])
    count = 400
    rows = FusedIncrements.zeros(count)
    nodes, weights = np.polynomial.legendre.leggauss(6)
    for k in range(count):
        angle = axis_rate * (k + (nodes - 1) / 2) * DT
        c, s = np.cos(angle), np.sin(angle)
        for name, vector in (("dtheta_s", rate_b), ("dv_s", force_b)):
            x, y, z = vector
            turned = np.array([c * x + s * y, c * y - s * x, np.full_like(c, z)])
            rows[name][k] = turned @ weights * DT / 2
        rows["dtheta_s"][k, 2] += axis_rate * DT
        rows["inner_deg"][k] = math.degrees(axis_rate * k * DT)
    dtheta_b, dv_b = Derotator().of_body(rows)
    assert dtheta_b[2:] == pytest.approx(np.tile(rate_b * DT, (count - 2, 1)), abs=3e-12)
    assert dv_b[2:] == pytest.approx(np.tile(force_b * DT, (count - 2, 1)), abs=1e-9)


# Files


def test_forward_right_down():
    assert forward_right_down(np.array([[1.0, 2.0, 3.0]])).tolist() == [[2.0, 1.0, -3.0]]


def test_rows_begin_with_the_initial_state_and_have_times_of_power_on(tmp_path):
    result = written(tmp_path / "deep" / "er", TURNING)
    assert [path.name for path in result.files] == ["increments.csv", "truth.csv", "navigation.csv"]
    tables = [read(path) for path in result.files]
    assert {len(table) for table in tables} == {60 * 200 + 1} == {result.rows}
    for table in tables:
        assert table["time_s"].to_numpy() == pytest.approx(table["epoch"].to_numpy() * DT)
        assert (np.diff(table["epoch"]) == 1).all()
    assert (result.begins_s, result.ends_s) == pytest.approx(tables[0]["time_s"].iloc[[0, -1]])
    truth, navigation = tables[1].iloc[0], tables[2].iloc[0]
    assert navigation["latitude_deg"] == truth["latitude_deg"] == 40.3554
    for name in ("roll_deg", "pitch_deg", "heading_deg"):
        assert navigation[name] == pytest.approx(truth[name], abs=1e-5)


def test_parquet_is_the_same_to_the_bit(files):
    folder, text = files(TURNING, "parquet"), files(TURNING, "csv")
    for name in ("increments", "truth", "navigation"):
        table = pyarrow.parquet.read_table(folder / f"{name}.parquet").to_pandas()
        pd.testing.assert_frame_equal(
            table, read(text / f"{name}.csv"), check_exact=True, check_dtype=False
        )


def test_kf_gins_is_forward_right_down_and_north_east_down(files):
    folder = files(DRIVING, "kf-gins")
    table = read(files(DRIVING, "csv") / "increments.csv")
    truth = read(files(DRIVING, "csv") / "truth.csv")
    imu, states = np.loadtxt(folder / "imu.txt"), np.loadtxt(folder / "truth.nav")
    assert imu.shape == (len(table), 7)
    assert states.shape == (len(table), 11)
    assert imu[:, 0] == pytest.approx(table["time_s"])
    for k, (name, axis, sign) in enumerate((n, a, s) for n in ("dtheta", "dv") for a, s in
                                           (("y", 1), ("x", 1), ("z", -1))):  # fmt: skip
        unit = "rad" if name == "dtheta" else "mps"
        assert (imu[:, 1 + k] == sign * table[f"{name}_b_{axis}_{unit}"]).all()
    assert imu[:, 6].mean() == pytest.approx(-9.8 * DT, rel=1e-2)
    assert (states[:, 0] == 0).all()
    assert states[:, 1] == pytest.approx(table["time_s"])
    names = ("latitude_deg", "longitude_deg", "height_m")
    assert states[:, 2:5] == pytest.approx(truth[list(names)].to_numpy())
    for k, (name, sign) in enumerate((("north", 1), ("east", 1), ("up", -1))):
        assert states[:, 5 + k] == pytest.approx(sign * truth[f"velocity_{name}_mps"])
    angles = truth[["roll_deg", "pitch_deg", "heading_deg"]].to_numpy()
    assert states[:, 8:] == pytest.approx(angles)
    assert np.ptp(states[:, 10]) > 20, "the drive turns"


def matrix_of_psins(att):
    """Return Cnb of att = [pitch; roll; yaw], as PSINS' a2mat documents it (3-1-2)."""
    pitch, roll, yaw = att
    return (
        Rotation.from_rotvec([0, 0, yaw])
        * Rotation.from_rotvec([pitch, 0, 0])
        * Rotation.from_rotvec([0, roll, 0])
    ).as_matrix()


def test_psins_has_its_struct(files):
    trj = loadmat(files(DRIVING, "psins") / "trj.mat", struct_as_record=False)["trj"][0, 0]
    table = read(files(DRIVING, "csv") / "increments.csv")
    truth = read(files(DRIVING, "csv") / "truth.csv")
    count = len(table) - 1
    assert trj.imu.shape == (count, 7)
    assert trj.avp.shape == (count, 10)
    assert trj.avp0.shape == (9, 1)
    assert trj.ts[0, 0] == pytest.approx(DT)
    expected = np.column_stack(
        [vectors(table, "dtheta_b", "rad"), vectors(table, "dv_b", "mps"), table["time_s"]]
    )
    assert (trj.imu == expected[1:]).all()
    avp = np.vstack([np.append(trj.avp0[:, 0], table["time_s"].iloc[0]), trj.avp])
    assert avp[:, 9] == pytest.approx(table["time_s"])
    velocity = truth[[f"velocity_{name}_mps" for name in ("east", "north", "up")]]
    assert avp[:, 3:6] == pytest.approx(velocity.to_numpy())
    assert np.degrees(avp[:, 6:8]) == pytest.approx(
        truth[["latitude_deg", "longitude_deg"]].to_numpy()
    )
    for k in (0, count // 2, count):
        heading, pitch, roll = np.radians(truth.loc[k, ["heading_deg", "pitch_deg", "roll_deg"]])
        ours = (
            Rotation.from_rotvec([0, 0, -heading])
            * Rotation.from_rotvec([pitch, 0, 0])
            * Rotation.from_rotvec([0, roll, 0])
        )
        assert matrix_of_psins(avp[k, :3]) == pytest.approx(ours.as_matrix(), abs=1e-9)


# Another navigator


@pytest.mark.slow
@pytest.mark.parametrize(("case", "bound_m"), [(TURNING, 5e-5), (DRIVING, 5e-4)])
def test_pyins_navigates_as_we_do(files, case, bound_m):
    strapdown = pytest.importorskip("pyins.strapdown", reason="pip install python-ins")
    from pyins import transform

    folder = files(case, "pyins")
    imu, truth, ours = (
        read(folder / f"{name}.csv").set_index("time")
        for name in ("imu", "trajectory", "navigation")
    )
    integrator = strapdown.Integrator(truth.iloc[0], with_altitude="motion" in case)
    theirs = integrator.integrate(strapdown.compute_increments_from_imu(imu, "increment"))
    for other in (ours, truth):
        apart = transform.compute_state_difference(theirs, other)
        assert np.hypot(apart["north"], apart["east"]).max() < bound_m
        assert apart[["roll", "pitch", "heading"]].abs().to_numpy().max() < 1e-4
    if "motion" in case:
        assert np.hypot(truth["VN"], truth["VE"]).max() > 5


# What is refused


def test_the_sensors_frame_is_for_tables_only(tmp_path):
    with pytest.raises(RehearsalError, match="--frame s: pyins knows no table"):
        written(tmp_path, TURNING, "pyins", "s")


def test_faults_on_the_wire_need_a_recording(tmp_path):
    case = TURNING | {"faults": [{"kind": "drop", "probability": 0.5}]}
    with pytest.raises(RehearsalError, match="need frames; rehearse the scenario with --record"):
        written(tmp_path, case)


def test_a_firmware_that_never_navigated_leaves_no_file(tmp_path):
    case = {"duration_s": 1, "faults": [{"kind": "gyro_absent"}]}
    with pytest.raises(FirmwareFaultError, match="never navigated"):
        written(tmp_path, case)
    assert list(tmp_path.iterdir()) == []


def test_what_follows_a_gap_is_left_out(tmp_path):
    requests = [(1, "NAVIGATE_STRAPDOWN"), (4, "STANDBY"), (5, "NAVIGATE_STRAPDOWN")]
    case = {
        "duration_s": 8,
        "firmware": {"alignment_s": 0.5},
        "operator": [{"at_s": at_s, "request": request} for at_s, request in requests],
    }
    result = written(tmp_path, case)
    assert result.ends_s == pytest.approx(4, abs=0.1)
    table = read(tmp_path / "increments.csv")
    assert (np.diff(table["epoch"]) == 1).all()
