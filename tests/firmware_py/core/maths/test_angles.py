"""An angle's cosine and sine are those of its value, whatever it was before."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from rrins.firmware_py.core.maths.angles import Angle, turn_to

ANGLES = st.sampled_from([0.0, -0.0, math.pi / 2]) | st.floats(-100.0, 100.0)


@given(st.lists(ANGLES, min_size=1, max_size=5))
def test_an_angle_knows_its_cosine_and_sine(values):
    angle = Angle.zeros()[0]
    for value in values:
        turn_to(angle, value)
        assert (angle.value, angle.cosine) == (value, math.cos(value))
        assert angle.sine == math.sin(value)
