"""The closest of the choices that the paper leaves open."""

from __future__ import annotations

import math

import pytest

from rrins.host_tools.experiments.sections import FigureRow
from rrins.host_tools.experiments.variants import closest, distance, with_closest


def rows(*pairs):
    return [
        FigureRow("static", "a", f"q{k}", "m", paper, ours, "settings")
        for k, (paper, ours) in enumerate(pairs)
    ]


def ours(*values):
    return rows(*((None, value) for value in values))


def test_the_distance_is_the_mean_square_of_the_logarithms():
    assert distance([2.0, 8.0], [2.0, 1.0]) == pytest.approx(math.log(8) / math.sqrt(2))
    assert distance([0.5], [1.0]) == distance([2.0], [1.0])


def test_one_variant_is_chosen_for_all_figures_of_a_case():
    # Each of the first two hits one figure exactly; the third is nearer to both together.
    variants = {"a": [1.0, 100.0], "b": [100.0, 1.0], "c": [3.0, 3.0]}
    assert closest([1.0, 1.0], [10.0, 10.0], variants) == "c"
    told = with_closest(
        rows((1.0, 10.0), (1.0, 10.0)), {name: ours(*values) for name, values in variants.items()}
    )
    for row in told:
        assert row.note == (
            "settings; closest of 3 variants over the 2 figures of this case: c, 3 m (ratio 3)"
        )


def test_where_none_is_closer_none_is_named():
    variants = {"a": ours(1.0, 1000.0), "b": ours(90.0, 1.0)}
    told = with_closest(rows((1.0, 10.0), (1.0, 1.0)), variants)
    assert told[0].note == "settings; none of 2 variants over the 2 figures of this case is closer"
    assert told[1].note == "settings"


def test_figures_that_the_paper_lacks_do_not_count():
    variants = {"a": ours(1.0, 9.0, 1.0), "b": ours(1e9, 2.0, 1.0)}
    told = with_closest(rows((None, 10.0), (1.0, 10.0), (1.0, 1.0)), variants)
    assert told[0].note == "settings"
    assert "over the 2 figures of this case: b, 2 m (ratio 2)" in told[1].note
