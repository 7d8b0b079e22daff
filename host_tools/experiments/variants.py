"""The choices that the paper leaves open, and which comes closest to the figures of a case.

One variant is chosen for a whole case, never one for each figure: with enough variants, some one
comes close to any single figure. The measure is the root mean square, over the figures of the
case, of the logarithm of our figure over the paper's. That a variant comes closest does not show
that the paper made its choice.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from rrins.host_tools.experiments.sections import FigureRow
from rrins.host_tools.rounding import rounded

_SMALLEST = 1e-12  # a figure of zero has no logarithm


def distance(ours: Sequence[float], paper: Sequence[float]) -> float:
    """Return the root mean square of ln(ours / paper) over figures of one length."""
    squares = [
        math.log(max(one, _SMALLEST) / other) ** 2 for one, other in zip(ours, paper, strict=True)
    ]
    return math.sqrt(sum(squares) / len(squares))


def closest(
    paper: Sequence[float], ours: Sequence[float], variants: Mapping[str, Sequence[float]]
) -> str | None:
    """Return the name of the variant closest to the paper; None if `ours` is as close.

    Parameters
    ----------
    paper, ours : sequence of float
        The figures of a case, in one order.
    variants : mapping of str to sequence of float
        The same figures for each variant.
    """
    name = min(variants, key=lambda one: distance(variants[one], paper))
    return name if distance(variants[name], paper) < distance(ours, paper) else None


def with_closest(
    rows: Sequence[FigureRow], variants: Mapping[str, Sequence[FigureRow]]
) -> list[FigureRow]:
    """Return the rows of a case; the note of each that differs also states the closest variant.

    Parameters
    ----------
    rows : sequence of FigureRow
        All figures of the case.
    variants : mapping of str to sequence of FigureRow
        The same figures of each variant.
    """
    known = [k for k, row in enumerate(rows) if row.paper and row.ours is not None]
    if not known:
        return list(rows)

    def figures(of: Sequence[FigureRow]) -> list[float]:
        return [of[k].ours or 0.0 for k in known]

    paper = [rows[k].paper or 0.0 for k in known]
    name = closest(paper, figures(rows), {one: figures(of) for one, of in variants.items()})
    over = f"{len(variants)} variants over the {len(known)} figures of this case"
    noted = list(rows)
    for k, row in enumerate(rows):
        if not row.differs:
            continue
        words = f"none of {over} is closer"
        if name is not None:
            assert row.paper
            value = variants[name][k].ours or 0.0
            words = f"closest of {over}: {name}, {rounded(value)} {row.unit} "
            words += f"(ratio {rounded(value / row.paper)})"
        noted[k] = replace(row, note=f"{row.note}; {words}")
    return noted
