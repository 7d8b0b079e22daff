"""Titles of pictures: any text, drawn as it stands."""

from __future__ import annotations

import io
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import rrins.host_tools
from rrins.host_tools.drawing.style import SINCE_NAVIGATION, give_title, new_figure


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


def test_all_pictures_have_one_name_for_the_time_since_navigation_began():
    (folder,) = rrins.host_tools.__path__
    label = re.compile(r"""set_xlabel\(\s*f?["'](time[^"']*)["']""")
    texts = [path.read_text(encoding="utf-8") for path in Path(folder).rglob("*.py")]
    others = {name for text in texts for name in label.findall(text)}
    assert sum("set_xlabel(SINCE_NAVIGATION)" in text for text in texts) > 5
    assert others == {"time on the table / min", "time in the cycle / s"}
    assert SINCE_NAVIGATION == "time since navigation began / s"
