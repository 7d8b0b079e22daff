"""Vectors in general."""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats


@compiled
def copy(out: Floats, values: Floats) -> None:
    """Copy as many values as `out` has; arrays of any shape, contiguous as those of records are.

    ``out[:] = values`` would allocate: numba makes a copy first if the two may overlap.
    """
    for i in range(out.size):
        out.flat[i] = values.flat[i]
