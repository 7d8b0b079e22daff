"""Figures as the tables of this room show them."""

from __future__ import annotations

from rrins.host_tools.campaigns.statistics import Estimate
from rrins.host_tools.rounding import rounded, with_limits


def percent(share: Estimate, has_interval: bool = True) -> str:
    """Return a share in percent, and its interval."""
    if not has_interval:
        return rounded(100 * share.value)
    return with_limits(100 * share.value, 100 * share.low, 100 * share.high)
