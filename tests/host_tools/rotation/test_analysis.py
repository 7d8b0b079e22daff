"""Residual of each error after rotation: the paper's statements for every sensor and geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.firmware_py.core.settings import Scheme, Turn
from rrins.host_tools.hardware.earth import ROTATION_RATE
from rrins.host_tools.hardware.tables import Accelerometers, Gyros
from rrins.host_tools.hardware.units import DPH, STANDARD_GRAVITY
from rrins.host_tools.rotation.analysis import analyse
from rrins.host_tools.rotation.errors import BIAS, ERRORS, MEASF, MEIE, MESSF, sensors_of
from rrins.host_tools.scenario.geometry import GEOMETRIES
from rrins.host_tools.scenario.schemes import SCHEMES

from .conftest import of_paper, paper_rimu, si_sensors

X, Y, Z = range(3)
SIXTEEN = Scheme(turns=SCHEMES["16-position"])


def scheme(*turns, **settings_):
    return Scheme(turns=tuple(Turn(axis=a, angle_deg=d) for a, d in turns), **settings_)


def variation_of(name, geometry="tetrahedron", fused=False, **keywords):
    rimu = paper_rimu(geometry, fused)
    chosen = Scheme(turns=SCHEMES[name]) if isinstance(name, str) else name
    return analyse(chosen, rimu.gyros, rimu.accelerometers, **keywords)


def ratio(integrals):
    """Return residuals as shares of each error's largest excursion; an error of zero leaves 0."""
    largest = integrals.excursion.max(axis=-1, keepdims=True)
    return np.abs(integrals.residual) / np.where(largest == 0, 1.0, largest)


def assert_the_papers_result(variation):
    """Section 4.2, of all sensors: only z of the accelerometers' MESSF and MEIE is left."""
    assert ratio(variation.gyros).max() < 1e-12
    left = ratio(variation.accelerometers)
    assert left[:, [BIAS, MEASF]].max() < 1e-12
    assert left[:, [MESSF, MEIE]][..., [X, Y]].max() < 1e-12


@pytest.mark.parametrize("fused", [False, True])
@pytest.mark.parametrize("geometry", GEOMETRIES)
@pytest.mark.parametrize("name", ["16-position", "8-position"])
def test_section_4_2_for_every_sensor(name, geometry, fused):
    variation = variation_of(name, geometry, fused)
    assert_the_papers_result(variation)
    left = ratio(variation.accelerometers)
    assert (left[:, MESSF, Z].max(), left[:, MEIE, Z].max()) > (0.1, 0.0)


def test_of_sensor_3_every_error_moves_on_every_axis():
    """So that what vanishes is more than an error that was never there."""
    variation = variation_of("16-position")
    for integrals in (variation.gyros, variation.accelerometers):
        assert (integrals.excursion[2] > 1e-6).all()
    left = ratio(variation.accelerometers)
    assert left[2, [MESSF, MEIE], Z] == pytest.approx([1, 1], abs=1e-12)


directions = st.tuples(st.floats(0, 180), st.floats(-180, 180))
small = st.floats(-1e-3, 1e-3).filter(lambda value: value == 0 or abs(value) > 1e-9)
random_errors = st.tuples(*[small] * 5)


@pytest.mark.slow
@settings(max_examples=40)
@given(
    axes=st.lists(directions, min_size=1, max_size=3),
    data=st.data(),
    turn_rate_dps=st.floats(0.5, 30),
    stand_s=st.floats(0, 100),
)
def test_the_papers_result_holds_for_any_sensor_and_timing(axes, data, turn_rate_dps, stand_s):
    errors = list(zip(*(data.draw(random_errors) for _ in axes), strict=True))
    chosen = Scheme(turns=SCHEMES["16-position"], turn_rate_dps=turn_rate_dps, stand_s=stand_s)
    kinds = [si_sensors(kind, axes, *errors) for kind in ("gyro", "accelerometer")]
    variation = analyse(chosen, *kinds)
    # An axis within 1e-9 of a plane of symmetry feels almost nothing, and rounding shows.
    assert ratio(variation.gyros).max() < 1e-9
    left = ratio(variation.accelerometers)
    assert left[:, [BIAS, MEASF]].max() < 1e-9
    assert left[:, [MESSF, MEIE]][..., [X, Y]].max() < 1e-9


turns = st.lists(
    st.tuples(
        st.sampled_from(["inner", "outer"]),
        # Of a turn of a millionth of a degree nothing but rounding is left.
        st.one_of(
            st.sampled_from([-180.0, -90.0, 90.0, 180.0, 360.0]),
            st.floats(0.01, 720),
            st.floats(-720, -0.01),
        ),
    ),
    min_size=1,
    max_size=5,
)


@pytest.mark.slow
@settings(max_examples=40)
@given(
    turns=turns,
    axis=directions,
    errors=random_errors,
    latitude_deg=st.one_of(st.none(), st.floats(-90, 90)),
    turn_rate_dps=st.floats(0.5, 30),
)
def test_numbers_and_closed_form_agree_for_any_scheme(
    turns, axis, errors, latitude_deg, turn_rate_dps
):
    chosen = scheme(*turns, turn_rate_dps=turn_rate_dps, stand_s=3)
    kinds = [si_sensors(kind, (axis,), *errors) for kind in ("gyro", "accelerometer")]
    variation = analyse(chosen, *kinds, earth_latitude_deg=latitude_deg)
    for integrals in (variation.gyros, variation.accelerometers):
        largest = integrals.excursion.max(axis=-1, keepdims=True)
        difference = np.abs(integrals.residual - integrals.closed_form)
        assert (difference <= 1e-10 * largest + 1e-18).all()


def test_a_bias_that_stands_grows_with_time():
    bias = 0.1 * DPH
    variation = analyse(
        scheme(("inner", 0), stand_s=100),
        sensors_of("gyro", ((0, 0), (90, 0)), Gyros(bias_dph=0.1)),
        sensors_of("accelerometer", ((0, 0),), Accelerometers(scale_error_ppm=100)),
    )
    assert variation.gyros.residual[:, BIAS] == pytest.approx(
        np.array([[0, 0, 100 * bias], [100 * bias, 0, 0]])
    )
    assert variation.accelerometers.residual[0, MESSF] == pytest.approx(
        [0, 0, 1e-4 * STANDARD_GRAVITY * 100]
    )


def test_a_turning_point_between_samples_is_found():
    """The same, turned so that the largest value falls between two of the sampled angles."""
    variation = analyse(
        scheme(("inner", 180), stand_s=0, turn_rate_dps=7),
        sensors_of("gyro", ((90, 34.56789),), Gyros(bias_dph=1e-6 / DPH)),
        of_paper("accelerometer", ((0, 0),)),
    )
    rate, beta = math.radians(7), math.radians(34.56789)
    largest_x = max(1 - math.sin(beta), 2 * math.sin(beta))
    assert variation.gyros.excursion[0, BIAS, X] == pytest.approx(1e-6 / rate * largest_x, rel=1e-8)


def gimbal(inner_deg, outer_deg):
    i, o = math.radians(inner_deg), math.radians(outer_deg)
    Rx = np.array([[1, 0, 0], [0, math.cos(o), -math.sin(o)], [0, math.sin(o), math.cos(o)]])
    Rz = np.array([[math.cos(i), -math.sin(i), 0], [math.sin(i), math.cos(i), 0], [0, 0, 1]])
    return Rx @ Rz


@pytest.mark.parametrize("kind", ["gyro", "accelerometer"])
def test_the_whole_measurement_equation_gives_the_same(kind):
    """(16), (17) summed step by step, C_s_b differenced for the rate; the table as it is driven."""
    axes = GEOMETRIES["tetrahedron"]
    bias, symmetric, asymmetric = errors = 3e-7, 5e-5, -3e-5
    turns = (("inner", 90), ("outer", -120), ("inner", -45), ("outer", 200))
    sensors = [si_sensors(k, axes, *errors, 4e-5, -6e-5) for k in ("gyro", "accelerometer")]
    variation = analyse(scheme(*turns, turn_rate_dps=5, stand_s=2), *sensors)
    dt, inner, outer = 0.01, 0.0, 0.0
    total = np.zeros((4, 3))
    h = sensors[0].H
    true_axis = h + sensors[0].axis_error
    for axis, angle in turns:
        steps = round(abs(angle) / 5 / dt)
        for step in [angle / steps] * steps + [0.0] * round(2 / dt):
            before = gimbal(inner, outer)
            inner, outer = (inner + step, outer) if axis == "inner" else (inner, outer + step)
            after = gimbal(inner, outer)
            middle = (before + after) / 2
            if kind == "gyro":
                turned = before.T @ after
                felt = np.array([turned[2, 1], turned[0, 2], turned[1, 0]]) / dt
            else:
                felt = STANDARD_GRAVITY * middle[2]
            along = true_axis @ felt
            scale = 1 + symmetric + asymmetric * np.sign(along)
            error = scale * along + bias - h @ felt
            total += error[:, None] * (h @ middle.T) * dt
    integrals = variation.gyros if kind == "gyro" else variation.accelerometers
    ours = integrals.residual.sum(axis=1)
    assert ours == pytest.approx(total, abs=2e-3 * np.abs(integrals.excursion).max())


def test_the_earths_rate_stays_like_gravity():
    """Rotation leaves λ ω_ie in the plane that the Earth's rate lies in, and MESSF's x stays 0."""
    quiet = variation_of("16-position").gyros
    turning = variation_of("16-position", earth_latitude_deg=40.0).gyros
    assert ratio(quiet)[:, MESSF].max() < 1e-12
    left = turning.residual[:, MESSF].sum(axis=0)
    # Of all four sensors together: HᵀH = (4/3) I, so λ ω_ie (4/3) T on each axis.
    expected = 50e-6 * ROTATION_RATE * SIXTEEN.cycle_s * 4 / 3
    latitude = math.radians(40)
    assert left == pytest.approx(
        [0, expected * math.cos(latitude), expected * math.sin(latitude)], abs=1e-9 * expected
    )


def test_rows_name_every_sensor_error_and_axis():
    rows = variation_of("16-position", "dodecahedron").residual_rows()
    names = {(row.sensor_kind, row.sensor, row.error, row.axis) for row in rows}
    assert len(rows) == len(names) == 2 * 6 * len(ERRORS) * 3
    assert {row.unit for row in rows if row.sensor_kind == "gyro"} == {"rad"}
    assert {row.unit for row in rows if row.sensor_kind == "accelerometer"} == {"m/s"}


def test_curves_end_in_the_residual_and_follow_the_angles():
    variation = variation_of("16-position")
    assert variation.time_s[-1] == pytest.approx(1600)
    assert (np.diff(variation.time_s) > 0).all()
    assert variation.inner_deg.max() == 720
    assert (variation.outer_deg.min(), variation.outer_deg.max()) == (-180, 180)
    assert (variation.accelerometers.running[-1] == variation.accelerometers.residual).all()
