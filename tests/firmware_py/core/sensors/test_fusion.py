"""Weighted least squares against numpy's, for any geometry and any sensors left out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from rrins.firmware_py.core.records.memory import Fusion
from rrins.firmware_py.core.sensors.calibration import condition_number, input_axes, largest_gain
from rrins.firmware_py.core.sensors.fusion import (
    CONDITION_LIMIT,
    GAIN_LIMIT,
    WEIGHT_RATIO_LIMIT,
    fuse,
    prepare,
)
from rrins.host_tools.scenario.geometry import GEOMETRIES

ANGLES_DEG = st.tuples(st.floats(0, 180), st.floats(0, 360))
TRUTH = np.array([0.3, -0.2, 0.7])


def fusion_of(H, weight=None):
    fusion = np.zeros(1, dtype=Fusion.dtype)[0]
    fusion["count"] = len(H)
    fusion["H"][: len(H)] = H
    fusion["weight"][: len(H)] = 1.0 if weight is None else weight
    return fusion


def gain(H, weight):
    """Return the gain of all sensors, or None when it cannot be computed."""
    fusion = fusion_of(H, weight)
    prepare(fusion, (1 << len(H)) - 1, np.empty((3, 3)))
    return fusion["gain"][:, : len(H)] if fusion["solvable"] else None


def fused(fusion, valid, measured):
    """Return the fused vector, or None when the sensors do not suffice."""
    padded, out, work = np.full(16, 1e9), np.full(3, 7.0), np.empty((3, 3))
    padded[: len(measured)] = measured
    if fuse(fusion, valid, padded, out, work):
        return out
    assert (out == 7.0).all()
    return None


def tetrahedron(tools):
    return input_axes(tools.settings().gyro_axes_deg)


@pytest.mark.slow
@given(st.data(), st.lists(ANGLES_DEG, min_size=3, max_size=16))
def test_any_geometry_weights_and_mask_give_numpys_solution(data, axes_deg):
    H, m = input_axes(tuple(axes_deg)), len(axes_deg)
    weight = np.array(data.draw(st.lists(st.floats(0.1, 10), min_size=m, max_size=m)))
    measured = np.array(data.draw(st.lists(st.floats(-1, 1), min_size=m, max_size=m)))
    valid = data.draw(st.integers(0, 2**m - 1))
    used = np.array([valid >> k & 1 == 1 for k in range(m)])
    assume(used.sum() >= 3)
    root = np.sqrt(weight[used])[:, None]
    assume(np.linalg.cond(root * H[used]) < 50)
    expected = np.linalg.lstsq(root * H[used], root[:, 0] * measured[used])[0]
    assert fused(fusion_of(H, weight), valid, measured) == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize("valid", [0b0000, 0b0001, 0b0011, 0b1010])
def test_two_sensors_do_not_suffice(tools, valid):
    H = tetrahedron(tools)
    assert fused(fusion_of(H), valid, H @ TRUTH) is None


@pytest.mark.parametrize("name", GEOMETRIES)
def test_too_few_sensors_leave_the_gain_that_the_filter_uses(name):
    """By rounding alone, the determinant of two sensors may be positive, and the gain 1e16."""
    H = input_axes(GEOMETRIES[name])
    fusion = fusion_of(H)
    prepare(fusion, (1 << len(H)) - 1, np.empty((3, 3)))
    before = fusion["gain"].copy()
    for valid in range(1 << len(H)):
        if valid.bit_count() < 3:
            assert fused(fusion, valid, H @ TRUTH) is None
            assert (fusion["gain"] == before).all()


def test_axes_in_one_plane_do_not_suffice():
    H = input_axes(((90.0, 0.0), (90.0, 50.0), (90.0, 100.0), (90.0, 250.0)))
    assert fused(fusion_of(H), 0b1111, H @ TRUTH) is None


def test_sensors_that_come_back_are_used_again(tools):
    H = tetrahedron(tools)
    fusion = fusion_of(H)
    assert fused(fusion, 0b0011, H @ TRUTH) is None
    assert fused(fusion, 0b1111, H @ TRUTH) == pytest.approx(TRUTH)
    assert fused(fusion, 0b0111, np.r_[(H @ TRUTH)[:3], 1e6]) == pytest.approx(TRUTH)
    assert fused(fusion, 0b1111, H @ TRUTH) == pytest.approx(TRUTH)


def test_any_axes_and_weights_that_are_accepted_give_a_left_inverse():
    generator = np.random.default_rng(3)
    fused_ones = 0
    for _ in range(2000):
        m = generator.integers(3, 17)
        flat = generator.normal(size=(m, 3)) * [1, *10 ** generator.uniform(-2.5, 0, 2)]
        turned = flat @ np.linalg.qr(generator.normal(size=(3, 3)))[0]
        H = turned / np.linalg.norm(turned, axis=1)[:, None]
        weight = 10 ** generator.uniform(-9, 9, m)
        if condition_number(H) <= CONDITION_LIMIT and largest_gain(H, weight) <= GAIN_LIMIT:
            fused_ones += 1
            assert np.abs(gain(H, weight) @ H - np.eye(3)).max() < 1e-12
        elif condition_number(H) > CONDITION_LIMIT:
            assert gain(H, weight) is None
    assert fused_ones > 1000


def test_weights_beyond_any_number_have_no_gain(tools):
    H = tetrahedron(tools)
    assert gain(H, [1e300, 1e-20, 1e-20, 1.0]) is None
    assert gain(H, [WEIGHT_RATIO_LIMIT, 1.0, 1.0, 1.0]) is not None


@pytest.mark.parametrize("half_angle_deg", [0.3, 0.5, 1.0, 54.7, 89.7, 89.9])
def test_axes_are_fused_up_to_a_condition_number(half_angle_deg):
    H = input_axes(tuple((half_angle_deg, 90.0 * k) for k in range(4)))
    # HᵀH of the cone is diag(2 s², 2 s², 4 c²).
    s, c = np.sin(np.radians(half_angle_deg)), np.cos(np.radians(half_angle_deg))
    expected = np.sqrt(4 * (1 / s**2 + 1 / (4 * c**2)))
    assert condition_number(H) == pytest.approx(expected)
    assert (gain(H, [1.0] * 4) is not None) == (expected <= CONDITION_LIMIT)
