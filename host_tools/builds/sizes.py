"""The shares of a memory."""

from __future__ import annotations

from typing import Any

import numpy as np

_LISTED = 0.02
"""Share of the whole from which a field has a line of its own."""
REST = "all other fields"


def sizes_of(dtype: np.dtype[Any]) -> list[tuple[str, int]]:
    """Return fields with their bytes, the largest first, the small ones together at the end."""
    assert dtype.fields is not None
    sizes = {name: field[0].itemsize for name, field in dtype.fields.items()}
    least = _LISTED * dtype.itemsize
    large = sorted((item for item in sizes.items() if item[1] >= least), key=lambda item: -item[1])
    return [*large, (REST, dtype.itemsize - sum(size for _, size in large))]
