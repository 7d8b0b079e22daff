"""Results of an experiment: rows of figures next to the paper's, distributions, plots."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from rrins.host_tools.files import JsonObject

FACTOR = 2.0
"""Our figure and the paper's differ if one is more than this many times the other."""


def figure(value: float | None) -> str:
    """Format a number for the tables: three digits, thousands separated."""
    if value is None:
        return "–"
    if value == 0 or 1e-3 <= abs(value) < 1e7:
        return f"{value:.3g}" if abs(value) < 1000 else f"{float(f'{value:.3g}'):,.0f}"
    return f"{value:.2e}"


@dataclass(frozen=True)
class FigureRow:
    """A figure of the paper and ours.

    Attributes
    ----------
    experiment : str
        As on the command line: static, rotating, experiment, drive, scheme.
    case, quantity, unit : str
    paper, ours : float or None
        None if there is none.
    note : str
        Settings, spread, and the reason for a difference if found.
    """

    experiment: str
    case: str
    quantity: str
    unit: str
    paper: float | None
    ours: float | None
    note: str = ""

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
    def percentile(self) -> float | None:
        """Share of the values below the paper's, in percent."""
        if self.paper is None:
            return None
        return 100.0 * float(np.mean(np.asarray(self.values) < self.paper))

    @property
    def holds(self) -> bool:
        """Whether the paper's figure lies between the 5th and the 95th percentile."""
        return self.paper is not None and self.quantile(5) <= self.paper <= self.quantile(95)

    @property
    def band(self) -> str:
        """The 5th and the 95th percentile in words."""
        return f"{figure(self.quantile(5))} to {figure(self.quantile(95))}"

    def words(self) -> str:
        """Return the band, the number of seeds and the paper's place in words."""
        text = f"median of {len(self.values)} seeds, 5-95 %: {self.band}"
        if self.percentile is None:
            return text
        place = "inside" if self.holds else "outside"
        return f"{text}; the paper's figure lies {place}, at percentile {self.percentile:.0f}"


@dataclass(frozen=True)
class PictureGrid:
    """Distributions of several quantities for several cases.

    Attributes
    ----------
    caption : str
    columns : tuple of str
    rows : tuple of (str, tuple of Distribution)
        A case and its distribution of each quantity.
    """

    caption: str
    columns: tuple[str, ...]
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
    settings: list[str] = field(default_factory=list)
    """What was run: attitude, duration, rate, seeds."""
    open_points: list[str] = field(default_factory=list)
    """What the paper leaves open, and our choice."""
    findings: list[str] = field(default_factory=list)
    rows: list[FigureRow] = field(default_factory=list)
    open_rows: int | None = None
    """How many rows the page shows before the rest is unfolded; None for all."""
    grids: list[PictureGrid] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
