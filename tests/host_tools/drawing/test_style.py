"""Titles of pictures: any text, drawn as it stands."""

from __future__ import annotations

import io
import warnings

import numpy as np
import pytest

from rrins.host_tools.drawing.style import give_title, new_figure


def drawn(text, on_axes=False):
    figure = new_figure(4.0, 1.0)
    give_title(figure.add_subplot() if on_axes else figure, text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure.savefig(io.BytesIO(), format="png")
    return np.asarray(figure.canvas.buffer_rgba())


@pytest.mark.parametrize("on_axes", [False, True])
@pytest.mark.parametrize(
    "text",
    [
        "$\\frac{$",
        "a $x$ b $y$",
        "cell\0here",
        "name\udcff.csv",
        "测试",
        "two\nlines",
        "\x1b[31m",
        "",
    ],
)
def test_any_text_is_a_title(text, on_axes):
    drawn(text, on_axes)


def test_dollar_signs_are_drawn():
    assert not np.array_equal(drawn("$x$"), drawn("x"))
    assert np.array_equal(drawn("\0"), drawn("\N{REPLACEMENT CHARACTER}"))
