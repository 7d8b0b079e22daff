"""The report of a study: one self-contained HTML page, and its picture."""

from __future__ import annotations

import math
from pathlib import Path

from rrins.host_tools.drawing.page import REPORT, write_report
from rrins.host_tools.redundancy.monte_carlo import PATIENCE_S
from rrins.host_tools.redundancy.pictures import delays_figure, label_of
from rrins.host_tools.redundancy.survey import WITHIN_S, Study
from rrins.host_tools.redundancy.theory import HALF, LEARNED_S, MOST, WAYS
from rrins.host_tools.rounding import NOTHING, coarse, rounded

WORDS = {
    "alarm": "one fails",
    "standing": "which, at rest",
    "parity": "which, in motion",
}
"""Words of a table for knowledge about a fault; the keys are `theory.WAYS`."""


def given(value: float | None) -> str:
    """Return a figure that was chosen, such as a step that was tried: no digits are added to it."""
    return f"{value:,.10g}" if value is not None and math.isfinite(value) else NOTHING


def delay(seconds: float | None) -> str:
    """Return a delay, no finer than a millisecond."""
    return rounded(seconds, 1) if seconds is not None and seconds < 0.01 else coarse(seconds)


def pair(half: float, most: float) -> str:
    """Return the figure of half of the cases and that of 95 %."""
    return f"{coarse(half)} / {coarse(most)}" if math.isfinite(half) else NOTHING


def write(folder: Path, study: Study, runs: int, title: str) -> list[Path]:
    """Write report and picture to a folder; return their paths, the report first.

    A report of other content that is there is moved into the folder `previous`.

    Raises
    ------
    RehearsalError
        When they cannot be written.
    """
    return write_report(
        folder,
        "rrins.host_tools.redundancy",
        {"delays": delays_figure(study.surveys)},
        keeps=(REPORT,),
        filters={"coarse": coarse, "given": given},
        title=title,
        surveys=study.surveys,
        sizes=study.sizes,
        runs=runs,
        ways=WAYS,
        words=WORDS,
        within_s=WITHIN_S,
        learned_s=LEARNED_S,
        patience_s=PATIENCE_S,
        quantiles=(HALF, MOST),
        pair=pair,
        label_of=label_of,
        at=lambda group, size: int(abs(group.sizes - size).argmin()),
    )
