"""Motions to test with, each built once; a navigator without errors that follows them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from rrins.firmware_py.core.maths.earth import radii
from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.records.memory import Ins
from rrins.host_tools.hardware.settings import body_to_navigation
from rrins.host_tools.motion.build import build, load_recording
from rrins.host_tools.motion.export import write_motion
from rrins.host_tools.scenario.motion import Motion
from rrins.host_tools.scenario.tables import Body, Site

PERIOD_NS = 5_000_000
M_PER_DEG = 111_000.0


def _make(folder=Path(), period_ns=PERIOD_NS, body=None, **keys):
    return build(Motion(**keys), Site(), body or Body(), period_ns, Path(folder))


@pytest.fixture(scope="session")
def make():
    """Build a motion of keys of the table `[motion]`."""
    return _make


@pytest.fixture(scope="session")
def drive():
    return _make(kind="drive", body=Body(heading_deg=30))


@pytest.fixture(scope="session")
def sway():
    return _make(kind="sway", body=Body(heading_deg=30, roll_deg=1, pitch_deg=-1))


@pytest.fixture(scope="session")
def exported(tmp_path_factory, drive):
    """Return the lines of a short recording of the drive at 4 Hz, per ending."""
    folder = tmp_path_factory.mktemp("exported")
    lines = {}
    for ending in ("csv", "pos"):
        write_motion(drive, folder / f"drive.{ending}", 4.0, 150.0)
        lines[ending] = tuple((folder / f"drive.{ending}").read_text().splitlines())
    return lines


@pytest.fixture
def write(tmp_path):
    """Write lines to a file of the test's folder; return the file."""

    def writer(lines, name="own.pos"):
        path = tmp_path / name
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path

    return writer


@pytest.fixture
def record(write):
    """Write positions (east, north in m) at 4 Hz as CSV; return the file."""

    def recorder(east, north, up=None, step_s=0.25, **columns):
        up = np.zeros_like(east) if up is None else up
        names = ["time_s", "latitude_deg", "longitude_deg", "height_m", *columns]
        table = [
            np.arange(len(east)) * step_s,
            40 + north / M_PER_DEG,
            116 + east / (M_PER_DEG * math.cos(math.radians(40))),
            up,
            *columns.values(),
        ]
        rows = [",".join(f"{v:.12f}" for v in row) for row in np.transpose(table)]
        return write([",".join(names), *rows], "own.csv")

    return recorder


@pytest.fixture
def load():
    """Return a file's recording, mended, as `[motion]` keys say."""

    def loader(path, **keys):
        return load_recording(Motion(kind="file", path=str(path), **keys), Path())

    return loader


@njit
def _navigate(ins, dtheta, dv, dt, every, out):
    for k in range(len(dtheta)):
        strapdown.update(ins, dtheta[k], dv[k], dt, strapdown.HEIGHT_FREE)
        if (k + 1) % every == 0:
            row = (k + 1) // every - 1
            out[row, 0], out[row, 1], out[row, 2] = ins.latitude, ins.longitude, ins.height
            out[row, 3:] = ins.velocity_n


def increments(trajectory, period_ns):
    """Return the body's increments of each epoch: the polynomials' exact integrals."""
    per_piece = trajectory.knot_ns // period_ns
    edges = np.arange(per_piece + 1)[:, None] / per_piece
    powers = np.arange(1, 9)
    integrals = (edges[1:] ** powers - edges[:-1] ** powers) / powers
    found = trajectory.pieces[:, :6] @ integrals.T * (trajectory.knot_ns * 1e-9)
    found = found.transpose(0, 2, 1).reshape(-1, 6)
    return np.ascontiguousarray(found[:, :3]), np.ascontiguousarray(found[:, 3:])


@pytest.fixture(scope="session")
def followed():
    """Return how far a navigator without errors comes off a trajectory: east, north, up in m."""

    def follow(trajectory, period_ns=PERIOD_NS):
        ins = np.zeros(1, dtype=Ins.dtype)[0]
        start = trajectory.at(np.array([0.0]))[0]
        C_b_n = body_to_navigation(*start[12:15])
        strapdown.initialise(ins, C_b_n, *start[6:9])
        dtheta, dv = increments(trajectory, period_ns)
        every = 1_000_000_000 // period_ns
        out = np.zeros((len(dtheta) // every, 6))
        _navigate(ins, dtheta, dv, period_ns * 1e-9, every, out)
        truth = trajectory.at(np.arange(1, len(out) + 1) * 1.0)
        meridian, prime = radii(start[6])
        off = out[:, :3] - truth[:, 6:9]
        off[:, 0] *= meridian
        off[:, 1] *= prime * np.cos(start[6])
        return off[:, [1, 0, 2]]

    return follow
