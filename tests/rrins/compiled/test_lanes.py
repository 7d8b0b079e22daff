"""Lanes: eight floats that compiled code computes with as with one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.compiled import lanes
from rrins.compiled.compilation import compiled
from rrins.compiled.lanes import larger, load, rounded, sign, spread, store, unchanged
from rrins.compiled.record import Floats


@compiled
def compute(rows: Floats) -> None:
    x, y = load(rows, 0), load(rows, 1)
    z = 2.0 * x - y / 3.0 + 1
    z += math.sqrt(abs(-x))
    store(rows, 2, z)
    store(rows, 3, sign(y))
    store(rows, 4, rounded(x))
    store(rows, 5, larger(x, y))
    store(rows, 6, unchanged(spread(4.0), abs(x), abs(y)))
    store(rows, 7, 5.0)


def test_each_lane_is_computed_as_a_float_is():
    rows = np.random.default_rng(1).normal(0.0, 3.0, (8, lanes.LANES))
    rows[1, ::2] = -rows[0, ::2]
    compute(rows)
    x, y = rows[:2]
    np.testing.assert_array_equal(rows[2], 2.0 * x - y / 3.0 + 1 + np.sqrt(np.abs(x)))
    np.testing.assert_array_equal(rows[3], np.sign(y))
    np.testing.assert_array_equal(rows[4], np.rint(x))
    np.testing.assert_array_equal(rows[5], np.maximum(x, y))
    np.testing.assert_array_equal(rows[6], np.where(np.abs(x) == np.abs(y), 5.0, 0.0))
    np.testing.assert_array_equal(rows[7], 5.0)


def test_plain_python_is_told_that_it_has_none():
    with pytest.raises(TypeError, match="load is for compiled code"):
        load(np.zeros((1, 8)), 0)
