"""Results of an experiment: rows of figures next to the paper's, distributions, plots."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from rrins.host_tools.files import JsonObject
from rrins.host_tools.rounding import alike, rounded

FACTOR = 2.0
"""Our figure and the paper's differ if one is more than this many times the other."""

BAND_SEEDS = 20
"""From this many seeds on, 5-95 % percentiles describe the spread; of fewer, their range does.

One of 20 is 5 %: the percentiles of fewer seeds would say more than the seeds do.
"""


@dataclass(frozen=True)
class FigureRow:
    """A figure of the paper and ours.

    Attributes
    ----------
    case, quantity, unit : str
    paper, ours : float or None
        None if there is none.
    """

    experiment: str  #: as on the command line: static, rotating, experiment, drive, scheme
    case: str
    quantity: str
    unit: str
    paper: float | None
    ours: float | None
    note: str = ""  #: settings, spread, and for a row that differs the closest variant

    @property
    def ratio(self) -> float | None:
        """Our figure over the paper's."""
        if not self.paper or self.ours is None:
            return None
        return self.ours / self.paper

    @property
    def differs(self) -> bool:
        """Whether our figure and the paper's differ by more than `FACTOR`."""
        ratio = self.ratio
        return ratio is not None and not 1 / FACTOR <= ratio <= FACTOR

    def values(self) -> JsonObject:
        """Return the row as plain values."""
        return asdict(self)


@dataclass(frozen=True)
class Distribution:
    """The distribution of a quantity over the seeds, and the paper's figure."""

    values: tuple[float, ...]
    paper: float | None = None

    @classmethod
    def of(cls, values: ArrayLike, paper: float | None = None) -> Distribution:
        """Return the distribution of the given values."""
        return cls(tuple(float(v) for v in np.asarray(values)), paper)

    def quantile(self, percent: float) -> float:
        """Return a percentile of the values."""
        return float(np.percentile(self.values, percent))

    @property
    def median(self) -> float:
        """The median."""
        return self.quantile(50)

    @property
    def below(self) -> int | None:
        """Number of values below the paper's."""
        if self.paper is None:
            return None
        return int(np.sum(np.asarray(self.values) < self.paper))

    @property
    def spread(self) -> tuple[float, float]:
        """The 5th and the 95th percentile; of fewer than `BAND_SEEDS` values their range."""
        low, high = (5, 95) if len(self.values) >= BAND_SEEDS else (0, 100)
        return self.quantile(low), self.quantile(high)

    @property
    def spread_words(self) -> str:
        """The kind of `spread`, with the number of seeds."""
        count = len(self.values)
        if count >= BAND_SEEDS:
            return f"the 5-95 % band of {count} seeds"
        return f"the range of {count} seed{'s' if count > 1 else ''}"

    @property
    def holds(self) -> bool:
        """Whether the paper's figure lies within the spread."""
        low, high = self.spread
        return self.paper is not None and low <= self.paper <= high

    @property
    def band(self) -> str:
        """The spread's limits in words."""
        low, high = self.spread
        return " to ".join(alike((low, high)))

    def words(self) -> str:
        """Return the spread, the number of seeds and the paper's place in words.

        A figure outside is stated as a multiple of the limit next to it.
        """
        text = f"median; {self.spread_words}: {self.band}"
        if self.paper is None:
            return text
        low, high = self.spread
        if self.holds:
            place = "inside"
        elif self.paper < low:
            place = f"below, {rounded(self.paper / low)} of the lower limit"
        else:
            place = f"above, {rounded(self.paper / high)} times the upper limit"
        return (
            f"{text}; the paper's figure lies {place}; {self.below} of {len(self.values)} below it"
        )


@dataclass(frozen=True)
class PictureGrid:
    """Distributions of several quantities for several cases."""

    caption: str
    columns: tuple[str, ...]
    #: a case and its distribution of each quantity
    rows: tuple[tuple[str, tuple[Distribution, ...]], ...]


@dataclass(frozen=True)
class Picture:
    """A picture of the report."""

    name: str
    """File name without ending."""
    caption: str
    figure: Figure


@dataclass
class Section:
    """An experiment of the report."""

    experiment: str
    title: str
    seeds: int = 0
    """Over how many seeds its medians and spreads are; 0 for none."""
    settings: list[str] = field(default_factory=list)
    """Attitude, duration, rate, seeds of the runs."""
    open_points: list[str] = field(default_factory=list)
    """Points that the paper leaves open, and our choice."""
    findings: list[str] = field(default_factory=list)
    rows: list[FigureRow] = field(default_factory=list)
    open_rows: int | None = None
    """Rows that the page shows before the rest is unfolded; None for all."""
    grids: list[PictureGrid] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
