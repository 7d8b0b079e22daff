"""When there are runs enough: ``p95 of horizontal_error_m within 10 %``.

It stops at the first look at which the interval is narrow enough (Chow and Robbins, Ann. Math.
Statist. 36 (1965) 457). Such an interval may be narrow by chance, and would have the truth too
rarely: looks are few, and the intervals of a campaign that it ends have the confidence `OF_LOOKS`,
with which they have the truth in 95 % of such campaigns.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.row import OUTPUTS
from rrins.host_tools.campaigns.statistics import Estimate, Sample, figure_of

FEWEST = 50
"""Runs with which a criterion is looked at first."""

_GROWTH = 1.1
"""From one look to the next."""

OF_LOOKS = 0.97
"""Confidence of the intervals at the looks, and of the one that it ends with."""

_SENTENCE = re.compile(r"\s*(?:(\w[\w.]*)\s+of\s+)?(\w+)\s+within\s+([\d.eE+-]+)\s*(%?)\s*\Z")
_SHORT = {"cep": ("median", "horizontal_error_m"), "cep50": ("median", "horizontal_error_m"),
          "r95": ("p95", "horizontal_error_m")}  # fmt: skip


@dataclass(frozen=True)
class Until:
    """A figure of a column, and how narrow its interval of 95 % confidence is to be.

    Attributes
    ----------
    figure, column : str
    """

    text: str  #: as a person wrote it
    figure: str
    column: str
    limit: float  #: half of the interval's width at most; in units of the column, or of the figure
    is_share: bool  #: whether of the figure

    @classmethod
    def parse(cls, text: str) -> Until:
        """Return the criterion of a sentence.

        Raises
        ------
        CampaignError
        """
        found = _SENTENCE.match(text)
        if found is None:
            raise CampaignError(
                f"until {text!r}: is not a criterion such as "
                '"p95 of horizontal_error_m within 10 %"'
            )
        figure, column, number, percent = found.groups()
        if figure is None:
            figure, column = _SHORT.get(column.lower(), ("", column))
        if figure_of(figure) is None:
            raise CampaignError(
                f"until {text!r}: there are p1 … p99, median, mean, sigma, cep, r95"
            )
        if column not in OUTPUTS:
            raise CampaignError(
                f"until {text!r}: no output {column}; there are {', '.join(OUTPUTS)}"
            )
        try:
            limit = float(number) * (0.01 if percent else 1.0)
        except ValueError:
            limit = math.nan
        if not 0.0 < limit < math.inf:
            raise CampaignError(f"until {text!r}: {number} is not a width")
        return cls(text, figure, column, limit, bool(percent))

    def estimate(self, values: Floats, block: int = 1) -> Estimate:
        """Return the figure of the first runs, so many of which are a block."""
        figure = figure_of(self.figure)
        assert figure is not None
        blocks = np.arange(len(values)) // block if block > 1 else None
        return figure(Sample(values, blocks, OF_LOOKS))

    def holds(self, values: Floats, block: int = 1) -> bool:
        """Return whether the interval is narrow enough."""
        found = self.estimate(values, block)
        limit = self.limit * abs(found.value) if self.is_share else self.limit
        return found.half_width <= limit

    def is_due(self, runs: int, block: int = 1) -> bool:
        """Return whether the criterion is looked at with so many runs: whole blocks."""
        if runs < FEWEST or runs % block:
            return False
        step = math.floor(math.log(runs / FEWEST) / math.log(_GROWTH) + 1e-9)
        return -(-math.ceil(FEWEST * _GROWTH**step - 1e-9) // block) * block == runs
