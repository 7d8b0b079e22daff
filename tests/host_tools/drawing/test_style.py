"""What all pictures share: titles, lines of any length, axes of time, files."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import rrins.host_tools
from rrins.host_tools.drawing.saving import pictures_as, write_picture, write_pictures
from rrins.host_tools.drawing.style import (
    POINTS,
    finish,
    give_title,
    new_figure,
    thinned,
    time_axis,
)
from rrins.host_tools.errors import RehearsalError
from tests.conftest import warnings_as_errors


def drawn(text, on_axes=False):
    figure = new_figure(4.0, 1.0)
    give_title(figure.add_subplot() if on_axes else figure, text)
    with warnings_as_errors():
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
    assert sum("time_axis(" in text for text in texts) > 8
    assert others == {"time on the table / min", "time in the cycle / s"}


@pytest.mark.parametrize(
    ("end_s", "label", "step_s"),
    [
        (900.0, "s", None),
        (10_800.0, "s", None),
        (43_200.0, "h", 7200.0),
        (200_000.0, "h", 36_000.0),
    ],
)
def test_long_times_are_in_hours(end_s, label, step_s):
    axes = new_figure(9.0, 2.0).subplots()
    axes.plot([0.0, end_s], [0.0, 1.0])
    finish(axes, "")
    time_axis(axes)
    assert axes.get_xlabel() == f"time since navigation began / {label}"
    if step_s:
        assert np.diff(axes.get_xticks())[0] == step_s
        assert axes.xaxis.get_major_formatter()(7200.0) == "2"


def test_a_long_line_keeps_its_peaks_and_gaps():
    x = np.arange(1_000_001.0)
    y = np.zeros(len(x))
    y[[17, 654_321]] = 5.0, -7.0
    y[500_000:600_000] = np.nan
    times, values = thinned(x, y)
    assert len(times) <= POINTS + 2
    assert (values.max(where=~np.isnan(values), initial=0), np.nanmin(values)) == (5.0, -7.0)
    assert times[values == -7.0] == 654_321
    assert np.isnan(values[(times > 501_000) & (times < 599_000)]).all()
    assert np.isfinite(values[(times < 499_000) | (times > 601_000)]).all()
    assert np.all(np.diff(times) >= 0)
    assert (times[0], times[-1]) == (0.0, 1_000_000.0)
    assert len(thinned(x[:100], y[:100])[0]) == 100
    y[::2] = np.nan  # values of every other line of a file
    assert np.isfinite(thinned(x[:9999], y[:9999])[1][1:-1]).mean() > 0.99


@pytest.mark.pictures
@pytest.mark.parametrize(
    ("form", "begin"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF-")]
)
def test_a_picture_is_a_file_of_any_format(tmp_path, form, begin):
    def figure():
        found = new_figure(2.0, 1.0)
        found.subplots().plot([0.0, 1.0])
        return found

    with pictures_as(form):
        (path,) = write_pictures(tmp_path, {"run.1": figure()})
    assert path == tmp_path / f"run.1.{form}"
    data = path.read_bytes()
    assert data.startswith(begin)
    write_picture(path, figure())
    assert path.read_bytes() == data  # no date
    assert write_pictures(tmp_path, {"a": figure()}) == [tmp_path / "a.png"]
    if form == "png":
        image = Image.open(path)
        assert image.size == (400, 200)
        assert image.info["dpi"] == pytest.approx((200, 200), abs=0.01)


def test_no_other_format_is_written(tmp_path):
    with pytest.raises(RehearsalError, match=r"x\.doc: cannot be written: ends in none of \.png"):
        write_picture(tmp_path / "x.doc", new_figure(1.0, 1.0))
