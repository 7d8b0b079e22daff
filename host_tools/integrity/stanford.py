"""The Stanford diagram: how often which error stood beside which bound.

The Stanford diagram of satellite navigation; Tossaint et al., *Journal of Global Positioning
Systems* 6 (2007) 50. Both axes are logarithmic: bounds of a faulty unit span decades.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats
from rrins.firmware_py.core.records.integrity_records import BOUNDS

Counts = NDArray[np.int64]
"""Seconds by bound, error, and protection level; shape (3, BINS, BINS)."""

PER_DECADE: Final = 10
_DECADES: Final = 7


@dataclass(frozen=True)
class Scale:
    """The axes of one bound."""

    name: str
    unit: str
    size: float  #: of the unit, SI
    least: float  #: in the unit; smaller figures count as this

    @property
    def edges(self) -> Floats:
        """Edges of the bins, in the unit."""
        return self.least * 10.0 ** (np.arange(_DECADES * PER_DECADE + 1) / PER_DECADE)

    def bins(self, values: Floats) -> NDArray[np.int64]:
        """Return the bin of each value (SI); what is beyond is in the last."""
        with np.errstate(divide="ignore"):
            decade = np.log10(np.maximum(values / self.size / self.least, 1.0))
        return np.minimum(np.floor(decade * PER_DECADE), _BINS - 1).astype(np.int64)


_BINS: Final = _DECADES * PER_DECADE
SCALES: Final = (
    Scale("horizontal", "m", 1.0, 1e-2),
    Scale("vertical", "m", 1.0, 1e-2),
    Scale("heading", "°", np.pi / 180.0, 1e-5),
)
NAMES: Final = tuple(scale.name for scale in SCALES)


def no_counts() -> Counts:
    """Return an empty diagram."""
    return np.zeros((BOUNDS, _BINS, _BINS), np.int64)


def counts_of(error: Floats, bound: Floats) -> Counts:
    """Return the diagram of some seconds.

    Parameters
    ----------
    error, bound : array, shape (n, 3)
        Seconds whose bound is zero have none.
    """
    counts = no_counts()
    for k, scale in enumerate(SCALES):
        has_bound = bound[:, k] > 0
        places = scale.bins(error[has_bound, k]), scale.bins(bound[has_bound, k])
        np.add.at(counts[k], places, 1)
    return counts
