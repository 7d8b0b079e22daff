"""The parity is what no vector explains, and leaving a sensor out follows from it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from rrins.firmware_py.core.records.memory import Fusion, Ram
from rrins.firmware_py.core.records.redundancy_records import ABSOLUTE, Parity
from rrins.firmware_py.core.redundancy import parity as parities
from rrins.firmware_py.core.sensors.calibration import input_axes

ANGLES_DEG = st.tuples(st.floats(0, 180), st.floats(0, 360))
TETRAHEDRON_DEG = ((180.0, 0.0), *((np.degrees(np.arccos(1 / 3)), 120.0 * k) for k in range(3)))


def compared(axes_deg, weight=1.0, sensors=None):
    """Return the fusion and the parity of a set of sensors."""
    count = len(axes_deg)
    fusion = np.zeros(1, Fusion.dtype)[0]
    fusion["count"] = count
    fusion["H"][:count] = input_axes(axes_deg)
    fusion["weight"][:count] = weight
    parity = np.zeros(1, Parity.dtype)[0]
    parity["white_variance"][:count] = 1.0
    everything = (1 << count) - 1 if sensors is None else sensors
    parities.compare(parity, fusion, everything, 200, np.empty((3, 3)))
    return fusion, parity


@given(st.lists(ANGLES_DEG, min_size=4, max_size=8), st.data())
def test_of_any_geometry_no_vector_is_in_the_parity_and_noise_is_as_large_as_said(axes_deg, data):
    H, m = input_axes(tuple(axes_deg)), len(axes_deg)
    assume(np.linalg.cond(H) < 20)
    weight = np.array(data.draw(st.lists(st.floats(0.2, 5), min_size=m, max_size=m)))
    _, parity = compared(tuple(axes_deg), weight)
    projector = parity["projector"][:m, :m]
    assert projector @ H == pytest.approx(np.zeros((m, 3)), abs=1e-12)
    assert projector @ projector == pytest.approx(projector, abs=1e-12)
    assert parity["second_variance"][:m] == pytest.approx(
        np.diag(projector @ projector.T), abs=1e-12
    )
    assert parity["redundant"]


@given(st.lists(ANGLES_DEG, min_size=4, max_size=8), st.data())
def test_the_vector_without_a_sensor_follows_from_its_residual(axes_deg, data):
    H, m = input_axes(tuple(axes_deg)), len(axes_deg)
    out = data.draw(st.integers(0, m - 1))
    others = [k for k in range(m) if k != out]
    assume(np.linalg.cond(H[others]) < 20 and np.linalg.cond(H) < 20)
    z = np.array(data.draw(st.lists(st.floats(-1, 1), min_size=m, max_size=m)))
    _, parity = compared(tuple(axes_deg))
    with_all = np.linalg.lstsq(H, z)[0]
    residual = (parity["projector"][:m, :m] @ z)[out]
    expected = np.linalg.lstsq(H[others], z[others])[0]
    assert with_all + parity["leave_out"][out] * residual == pytest.approx(expected, abs=1e-9)


def test_a_fault_on_one_of_four_shows_as_half_and_of_three_not_at_all():
    _, parity = compared(TETRAHEDRON_DEG)
    projector = parity["projector"][:4, :4]
    along = projector[:, 2] / np.sqrt(np.diag(projector))  # along each direction, fault of 1
    assert np.abs(along) == pytest.approx([0.5] * 4, abs=1e-12)
    _, parity = compared(TETRAHEDRON_DEG, sensors=0b1011)
    assert not parity["redundant"]


def test_two_parallel_sensors_check_each_other_and_no_others():
    _, parity = compared(((90, 0), (90, 90), (0, 0), (0, 0)))
    assert np.diag(parity["projector"][:4, :4]) == pytest.approx([0, 0, 0.5, 0.5], abs=1e-12)


def test_windows_shorter_than_a_second_find_a_step_at_once_and_forgive_the_unknown():
    fusion, parity = compared(TETRAHEDRON_DEG)
    parity["epoch_factor"] = 6.0
    parity["parity"]["seconds"] = parities.LEARNED_S
    vector, other, z = np.zeros(3), np.zeros(3), np.zeros(16)
    regressors = parities.regress(parity, fusion, vector, other, 0.0, 0.005)
    assert regressors == ABSOLUTE + 4
    assert parities.take(parity, fusion, z, vector, regressors, True) == 0.0
    z[1] = 14 * np.sqrt(1 / 200)  # half of it is in the parity
    vector = fusion["gain"][:, :4] @ z[:4]
    assert parities.take(parity, fusion, z, vector, regressors, True) > 1.0
    parity["parity"]["covariance"][0, 0] = 1e12  # the constant is not known
    assert parities.take(parity, fusion, z, vector, regressors, True) < 1.0


def test_the_ram_has_both_kinds():
    assert {"gyros", "accelerometers"} <= set(Ram.dtype["redundancy"].names)
