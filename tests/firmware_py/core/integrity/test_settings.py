"""The shares of the risk: as many standard deviations as the tables of the normal law say."""

from __future__ import annotations

import math
from statistics import NormalDist

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.firmware_py.core.integrity.settings import deviations


@pytest.mark.parametrize(("risk", "expected"), [(0.3173105, 1.0), (0.0026998, 3.0), (1e-7, 5.3267)])
def test_deviations_are_those_of_the_normal_law(risk, expected):
    assert deviations(risk) == pytest.approx(expected, abs=1e-4)


@given(st.floats(0.0, 8.0))
def test_the_tail_that_the_bounds_assume_is_never_smaller_than_the_true_one(factor):
    assert 2.0 * NormalDist().cdf(-factor) <= math.exp(-0.5 * factor * factor)
