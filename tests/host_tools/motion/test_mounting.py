"""A body that is mounted askew: the same motion, seen from another frame."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.host_tools.hardware.settings import body_to_navigation
from rrins.host_tools.motion.drive import synthetic_drive
from rrins.host_tools.motion.mounting import mounted
from rrins.host_tools.motion.trajectory import (
    ATTITUDE,
    OMEGA_IB_B,
    PLACE,
    SPECIFIC_FORCE_B,
    VELOCITY_N,
)

BASE = np.array([math.radians(40), math.radians(116), 40.0, 0.02, -0.01, 2.5])
TIMES = np.arange(0, 60, 0.07)
HEADING, PITCH = math.radians(1.5), math.radians(-0.8)


@pytest.fixture(scope="module")
def vehicle():
    return synthetic_drive(60, 3, BASE, 5_000_000)


def test_vectors_are_the_same_in_the_navigation_frame(vehicle):
    body = mounted(vehicle, HEADING, PITCH).at(TIMES)
    for own, other in zip(vehicle.at(TIMES), body, strict=True):
        C_v_n, C_b_n = body_to_navigation(*own[ATTITUDE]), body_to_navigation(*other[ATTITUDE])
        for vector in (OMEGA_IB_B, SPECIFIC_FORCE_B):
            np.testing.assert_allclose(C_b_n @ other[vector], C_v_n @ own[vector], atol=1e-12)
        ahead = [math.sin(HEADING) * math.cos(PITCH), math.cos(HEADING) * math.cos(PITCH),
                 math.sin(PITCH)]  # fmt: skip
        np.testing.assert_allclose(C_b_n @ ahead, C_v_n[:, 1], atol=1e-13)


def test_the_way_is_the_same_and_the_heading_does_not_leap(vehicle):
    body = mounted(vehicle, HEADING, PITCH)
    for channels in (PLACE, VELOCITY_N):
        np.testing.assert_array_equal(body.pieces[:, channels], vehicle.pieces[:, channels])
    headings = body.at(TIMES)[:, ATTITUDE][:, 2]
    assert np.abs(np.diff(headings)).max() < 0.1
    still = ~vehicle.pieces[:, :, 1:].any(axis=(1, 2))
    assert still.any()
    assert not body.pieces[still, :, 1:].any()
