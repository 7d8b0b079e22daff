"""A vehicle whose truth is known: a simulated drive, written as the files of other programs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.vehicle.fused import fused_of_scenario
from rrins.host_tools.vehicle.navigator_files import write

DRIVE = {
    "mode": "strapdown",
    "duration_s": 60,
    "rate_hz": 100,
    "rimu": {"geometry": "orthogonal"},
    "motion": {"kind": "drive", "duration_s": 120},
    "firmware": {"height_channel": "free"},
    "gyros": {"bias_dph": [5.0, -4.0, 3.0]},
    "accelerometers": {"bias_ug": [300.0, -200.0, 100.0]},
}


@dataclass(frozen=True)
class Drive:
    folder: Path
    truth: np.ndarray  # week, seconds, latitude, longitude, height, velocity, roll, pitch, yaw


def _with_fixes(folder, truth):
    """Write fixes of 0.5 m and 0.05 m/s at 1 Hz, in both formats."""
    rng = np.random.default_rng(7)
    whole = np.isclose(truth[:, 1] % 1.0, 0.0, atol=1e-6) | np.isclose(truth[:, 1] % 1.0, 1.0)
    rows = truth[whole]
    metres = rng.normal(0.0, 0.5, (len(rows), 3))
    scale = 111_200.0 * np.array([1.0, np.cos(np.radians(rows[0, 2]))])
    place = rows[:, 2:5] + np.column_stack([metres[:, :2] / scale, metres[:, 2]])
    velocity = rows[:, 5:8] + rng.normal(0.0, 0.05, (len(rows), 3))
    sigma = np.full((len(rows), 3), 0.5)
    np.savetxt(
        folder / "gnss.txt",
        np.column_stack([rows[:, 1], place, sigma, velocity, sigma / 10]),
        fmt="%.3f %.11f %.11f" + " %.5f" * 10,
    )
    header = (
        "time_s,latitude_deg,longitude_deg,height_m,"
        "velocity_east_mps,velocity_north_mps,velocity_up_mps"
    )
    enu = velocity[:, [1, 0, 2]] * [1, 1, -1]
    np.savetxt(
        folder / "gnss.csv",
        np.column_stack([rows[:, 1], place, enu]),
        fmt="%.11f",
        delimiter=",",
        header=header,
        comments="",
    )


@pytest.fixture(scope="session")
def drive(tmp_path_factory):
    """Return the folder of a drive of a minute, as CSV and as files of KF-GINS."""
    folder = tmp_path_factory.mktemp("vehicle")
    scenario = Scenario.model_validate(DRIVE)
    for kind in ("kf-gins", "csv"):
        write(fused_of_scenario(scenario), scenario.period_ns, folder, kind, "b")
    truth = np.loadtxt(folder / "truth.nav")
    _with_fixes(folder, truth)
    first = truth[0]
    (folder / "drive.yaml").write_text(
        f"""# as KF-GINS has it
imupath: "./somewhere/imu.txt"
gnsspath: "gnss.txt"   # beside
starttime: {first[1]}
endtime: -1
initpos: [ {first[2]:.12f}, {first[3]:.12f}, {first[4]:.6f} ]
initvel: [ 0.0, 0.0, 0.0 ]
initatt: [ {first[8]:.9f}, {first[9]:.9f}, {first[10]:.9f} ]
initposstd: [ 0.5, 0.5, 0.5 ]
initvelstd: [ 0.01, 0.02, 0.03 ]
initattstd: [ 0.01, 0.01, 0.02 ]
imunoise:
  arw: [0.003, 0.003, 0.003]
  vrw: [0.03, 0.03, 0.03]
  gbstd: [6, 6, 6]
  abstd: [36, 36, 36]  # mGal
  gsstd: [300.0, 300.0, 300.0]
  asstd: [200.0, 200.0, 200.0]
  corrtime: 4.0
antlever: [ 0.0, 0.0, 0.0 ]
"""
    )
    return Drive(folder, truth)
