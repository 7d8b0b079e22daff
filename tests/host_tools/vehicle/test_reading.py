"""Meaning of other programs' files, in our axes and units."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.host_tools.vehicle import csv_folder, kf_gins, reading
from rrins.host_tools.vehicle.errors import VehicleError


def text(path, *rows):
    path.write_text("".join(" ".join(map(str, row)) + "\n" for row in rows))
    return path


def test_kf_gins_has_forward_right_down(tmp_path):
    imu = kf_gins.read_imu(
        text(tmp_path / "imu.txt", (10.0, 1, 2, 3, 4, 5, 6), (10.005, 1, 2, 3, 4, 5, -6))
    )
    assert imu.dtheta[0].tolist() == [2, 1, -3]  # right, forward, up
    assert imu.dv.tolist() == [[5, 4, -6], [5, 4, 6]]
    assert imu.interval_s == pytest.approx(0.005)
    nav = kf_gins.read_nav(
        text(
            tmp_path / "truth.nav",
            (2017, 10, 30, 114, 20, 1, 2, 3, 4, 5, 6),
            (2017, 11, 30, 114, 20, 1, 2, 3, 4, 5, 6),
        )
    )
    assert nav.velocity_n[0].tolist() == [2, 1, -3]  # east, north, up
    assert np.degrees(nav.attitude[0]) == pytest.approx([4, 5, 6])
    assert np.degrees(nav.place[0, :2]) == pytest.approx([30, 114])
    row = (10, 30, 114, 20, 0.1, 0.2, 0.3)
    fixes = kf_gins.read_gnss(text(tmp_path / "gnss.txt", row, (11, *row[1:])))
    assert fixes.place_sigma[0].tolist() == [0.2, 0.1, 0.3]
    assert fixes.velocity_n is None
    more = (1.0, 2.0, 3.0, 0.01, 0.02, 0.03)
    fixes = kf_gins.read_gnss(text(tmp_path / "posvel.txt", (*row, *more), (11, *row[1:], *more)))
    assert fixes.velocity_n[0].tolist() == [2, 1, -3]
    assert fixes.velocity_sigma[0].tolist() == [0.02, 0.01, 0.03]


def test_the_configuration_of_kf_gins_says_the_beginning_and_the_noise(drive):
    recording = reading.read(drive.folder / "drive.yaml")
    assert recording.kind == "kf-gins"
    beginning = recording.beginning
    assert np.degrees(beginning.attitude) == pytest.approx(drive.truth[0, 8:11], abs=1e-8)
    assert math.degrees(beginning.heading_sigma) == pytest.approx(0.02)
    assert beginning.velocity_sigma == 0.03
    assert recording.ends_s is None
    # 0.003 °/√h, 0.03 m/s/√h, 6 °/h, 36 mGal over a correlation of 4 h
    assert recording.gyros.white == pytest.approx(math.radians(0.003) / 60)
    assert recording.accelerometers.white == pytest.approx(0.03 / 60)
    assert recording.gyros.bias_sigma == pytest.approx(math.radians(6) / 3600)
    assert recording.accelerometers.bias_sigma == pytest.approx(36e-5)
    assert recording.gyros.bias_walk == pytest.approx(
        math.radians(6) / 3600 * math.sqrt(2 / (4 * 3600))
    )
    assert recording.accelerometers.scale_sigma == pytest.approx(200e-6)


@pytest.fixture
def matlab(tmp_path):
    """Write structures as NaveGo has them."""
    from scipy.io import savemat

    time = np.arange(0, 3, 0.01)
    ones, zeros = np.ones((len(time), 1)), np.zeros((len(time), 1))
    imu = {
        "t": time[:, np.newaxis],
        "wb": np.hstack([ones, 2 * ones, 3 * ones]),
        "fb": np.hstack([zeros, zeros, -9.8 * ones]),
        "arw": [8e-5, 8e-5, 8e-5],
        "vrw": [2e-4, 2e-4, 2e-4],
        "gb_sta": [3e-3, 3e-3, 3e-3],
        "ab_sta": [0.1, 0.1, 0.1],
        "gb_dyn": [3e-5, 3e-5, 3e-5],
        "ab_dyn": [1e-3, 1e-3, 1e-3],
        "gb_corr": [200, 200, 200],
        "ab_corr": [200, 200, 200],
        "ini_align": [0.1, 0.2, 0.3],
        "ini_align_err": [0.01, 0.02, 0.03],
    }
    place = {"lat": 0.7 * ones, "lon": -1.2 * ones, "h": 20 * ones}
    gnss = {
        "t": time[:, np.newaxis],
        **place,
        "vel": np.hstack([ones, 2 * ones, 3 * ones]),
        "stdm": [1, 2, 3],
        "stdv": [0.1, 0.2, 0.3],
        "larm": [0.5, 0.6, 0.7],
    }
    ref = {"t": time[:, np.newaxis], **place, "vel": gnss["vel"], "roll": zeros, "pitch": zeros}
    for name, value in (("imu1", imu), ("gnss", gnss), ("ref", ref | {"yaw": ones})):
        savemat(tmp_path / f"{name}.mat", {name: value})
    return tmp_path


def test_navego_has_rates_in_forward_right_down(matlab):
    recording = reading.read(matlab)
    assert recording.kind == "navego"
    assert recording.increments.dtheta[5] == pytest.approx([0.02, 0.01, -0.03])
    assert recording.increments.dv[5] == pytest.approx([0, 0, 0.098])
    assert recording.fixes.velocity_n[0].tolist() == [2, 1, -3]
    assert recording.fixes.place_sigma[0].tolist() == [2, 1, 3]
    assert recording.fixes.lever_arm_b == pytest.approx([0.6, 0.5, -0.7])
    assert recording.reference.attitude[0].tolist() == [0, 0, 1]
    assert recording.beginning.attitude == pytest.approx([0.1, 0.2, 0.3])
    assert recording.beginning.level_sigma == pytest.approx(0.02)
    assert recording.gyros.bias_sigma == pytest.approx(3e-3)
    assert recording.gyros.bias_walk == pytest.approx(3e-5 * math.sqrt(2 / 200))


def test_of_several_imus_one_has_to_be_named(matlab):
    (matlab / "imu2.mat").write_bytes((matlab / "imu1.mat").read_bytes())
    with pytest.raises(VehicleError, match=r"several could be the imu: .* --imu FILE"):
        reading.read(matlab)
    assert reading.read(matlab, imu=matlab / "imu2.mat").files[0].name == "imu2.mat"


def test_csv_reads_back_what_increments_wrote(drive):
    recording = reading.read(drive.folder, "csv")
    assert recording.axes_are_body
    assert recording.reference.attitude is not None
    same = kf_gins.read_imu(drive.folder / "imu.txt")
    assert recording.increments.dtheta == pytest.approx(same.dtheta, abs=1e-15)
    assert recording.increments.dv == pytest.approx(same.dv, abs=1e-15)
    assert recording.fixes.place_sigma[0].tolist() == [1.5, 1.5, 1.5]  # not said


def test_csv_of_more_sensors_has_a_column_for_each(tmp_path):
    names = [f"gyro_{k}_dtheta_rad" for k in (2, 1, 3, 4)]
    names += [f"accelerometer_{k}_dv_mps" for k in (1, 2, 3)]
    rows = [[0.01 * k, 2, 1, 3, 4, 5, 6, 7] for k in range(3)]
    lines = [",".join(["time_s", *names]), *(",".join(map(str, row)) for row in rows)]
    (tmp_path / "increments.csv").write_text("\n".join(lines) + "\n")
    increments, along_body = csv_folder.read_increments(tmp_path / "increments.csv")
    assert not along_body
    assert increments.dtheta[0].tolist() == [1, 2, 3, 4]
    assert increments.dv[0].tolist() == [5, 6, 7]


WRONG = {
    "words": ("imu.txt", "a b c\n", "is not a table of numbers"),
    "columns": ("imu.txt", "1 2 3\n2 3 4\n", "3 columns, 7 expected"),
    "time": ("imu.txt", "1 0 0 0 0 0 0\n1 0 0 0 0 0 0\n", "row 2: its time does not follow"),
    "nan": ("imu.txt", "1 0 0 0 0 0 0\n2 0 nan 0 0 0 0\n", "row 2: an increment is not a number"),
    "yaml": ("x.yaml", "key: 1\n", "it is not a configuration of KF-GINS"),
    "mat": ("x.mat", "no\n", "cannot be read as a .mat file"),
    "suffix": ("x.bin", "no\n", "its format is not known"),
    "csv": ("x.csv", "time_s,dtheta_b_x_rad\n1,2\n2,3\n", "no column dtheta_b_y_rad"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_read_is_told_in_one_line(tmp_path, case):
    name, content, words = WRONG[case]
    (tmp_path / name).write_text(content)
    with pytest.raises(VehicleError, match=words) as found:
        reading.read(tmp_path / name)
    assert "\n" not in str(found.value)
    assert name in str(found.value)


def test_a_file_in_other_units_is_refused(tmp_path):
    row = (10, 0.53, 1.99, 20, 0.1, 0.2, 0.3)
    assert kf_gins.read_gnss(text(tmp_path / "a.txt", row, (11, *row[1:])))
    row = (10, 114.0, 30.5, 20, 0.1, 0.2, 0.3)  # longitude first
    with pytest.raises(VehicleError, match="no place on Earth"):
        kf_gins.read_gnss(text(tmp_path / "b.txt", row, (11, *row[1:])))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("time_s,latitude_deg,längengrad\n0,1,2\n1,1,2\n".encode("latin-1"), "is not UTF-8 text"),
        (b"time_s,height_m,height_m\n0,1,2\n1,1,2\n", "two columns height_m"),
        (bytes(range(256)), "not CSV"),
    ],
)
def test_a_truth_that_is_not_text_is_one_line(tmp_path, content, words):
    path = tmp_path / "truth.csv"
    path.write_bytes(content)
    with pytest.raises(VehicleError, match=rf"truth\.csv: {words}") as caught:
        csv_folder.read_truth(path)
    assert str(caught.value).isprintable()
