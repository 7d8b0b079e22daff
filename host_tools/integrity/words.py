"""Figures as the tables of this room show them."""

from __future__ import annotations

import math

from rrins.host_tools.campaigns.statistics import Estimate


def percent(share: Estimate, has_interval: bool = True) -> str:
    """Return a share in percent, and its interval."""
    if not math.isfinite(share.value):
        return "–"
    text = f"{100 * share.value:.3g}"
    return f"{text} ({100 * share.low:.3g} to {100 * share.high:.3g})" if has_interval else text
