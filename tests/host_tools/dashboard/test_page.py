"""The page in a real browser. RRINS_WRITE_DOCS=1 keeps the pictures of the guide."""

from __future__ import annotations

import io
import os
import re
import signal
import struct
import time
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image

pytestmark = pytest.mark.browser

LARGE = {"width": 1920, "height": 1080}


def pixels(picture):
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), dtype=np.int16)


def changed(before, after):
    """Return the share of the pixels that differ."""
    a, b = pixels(before), pixels(after)
    return 1.0 if a.shape != b.shape else float(np.mean(np.abs(a - b).max(axis=2) > 12))


def until(is_so, seconds=150, rest=time.sleep):
    end = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < end, "it never came to be"
        rest(0.1)


def ask(page, button, answer):
    """Click until it is done, as one does whose machine stood still; return the answers."""
    answers = []
    for _ in range(4):
        page.click(button)
        page.wait_for_selector(f"{answer}.done, {answer}.refused", timeout=150_000)
        answers.append(page.inner_text(answer))
        if page.locator(f"{answer}.done").count():
            break
    return answers


def has_residual(page, row):
    """Have residuals read again and again, though the machine stood still; return what is there."""
    page.check("#again")
    return page.locator(f"#residuals {row}").count() > 0


def seconds_of(text):
    """Return a time of the page in seconds: 0:12.5, 1:02:03.0."""
    total = 0.0
    for part in text.split(":"):
        total = 60 * total + float(part)
    return total


def navigating(open_page, served, **options):
    seen = open_page(served.url, **options)
    seen.wait("body[data-phase=running]", 150)  # it may compile
    seen.wait("body[data-mode=NAVIGATION_ROTATING]", 150)
    return seen


def test_the_page_lives_and_asks_nobody_else(open_page, rehearsal):
    seen = navigating(open_page, rehearsal)
    until(lambda: seen.text("#angles").startswith("inner") and "–" not in seen.text("#angles"))
    names = ("#plot-position", "#plot-angles", "#plot-parity", "#scene")
    before, angles = {name: seen.picture(name) for name in names}, seen.text("#angles")
    until(lambda: seen.text("#angles") != angles)
    until(lambda: all(changed(before[name], seen.picture(name)) > 0.001 for name in names))
    assert seen.text("#title") == "Four gyros on a ship at her moorings"
    assert seen.page.locator(".chip[data-sensor]").count() == 8
    assert "SYNC" in seen.text("#tab-bus")
    own = urlsplit(rehearsal.url).netloc
    assert {urlsplit(url).netloc for url in seen.requests} == {own}
    assert seen.complaints == []


def test_a_fault_by_form_shows_everywhere_and_goes_again(open_page, rehearsal):
    seen, beside = navigating(open_page, rehearsal), navigating(open_page, rehearsal)
    page = seen.page
    page.keyboard.press("f")
    page.click(".fault[data-kind=gyro_bias] > button")
    page.fill("input[name=sensor]", "3")
    page.fill("input[name=bias_dph]", "20")
    page.click("#inject")
    seen.wait(".answer.done")
    assert "gyro_bias (sensor 3, bias_dph 20), " in seen.text(".answer.done")
    for one in (seen, beside):
        one.wait('.chip[data-sensor^="G"][data-state="suspect"]')
        one.wait("#events li:has-text('the gyros disagree')")
    parity = seen.page.locator("#plot-parity .legend b").first
    until(lambda: float(parity.inner_text().split()[0]) > 1)
    assert re.search(r"→ G[1-4], \d+ s$", parity.inner_text())
    page.keyboard.press("w")
    assert "the gyros disagree" in seen.text("#tab-troubles")
    page.keyboard.press("c")
    answers = ask(page, "#read-codes", "#tab-codes .answer")
    assert page.locator("#tab-codes summary").count() > 0, answers
    for gyro in range(1, 5):  # of four, all residuals are as large
        until(lambda row=f"tr.trouble:has-text('G{gyro}')": has_residual(page, row))
    assert page.locator("#residuals tr:has-text('A1'):not(.trouble)").count() == 1
    page.keyboard.press("f")
    page.click("text=Clear all faults")
    seen.wait(".answer.done:has-text('all faults are removed')")
    page.fill("input[name=sensor]", "9")
    page.click("#inject")
    seen.wait(".answer.refused:has-text('no such axis or sensor')")
    assert seen.complaints == beside.complaints == []


def test_pause_and_speed_are_confirmed(open_page, rehearsal):
    seen = navigating(open_page, rehearsal)
    page = seen.page
    page.keyboard.press("f")
    page.focus("input[name=sensor]")
    page.keyboard.press("Space")
    seen.wait("body[data-phase=paused]")
    until(lambda: seen.text("#speed") == "paused")
    time_then = seen.text("#time")
    page.click("#inject")
    seen.wait(".answer.refused:has-text('the rehearsal is paused')")
    assert seen.text("#time") == time_then
    page.keyboard.press("Space")  # does not press the button that has the focus
    seen.wait("body[data-phase=running]")
    assert page.locator(".answer.refused").count() == 1
    page.select_option("#drive select", "5")
    seen.wait("#events li:has-text('running at 5 × real time')")
    page.select_option("#drive select", "10")
    seen.wait("#events li:has-text('running at 10 × real time')")


def test_a_page_that_is_opened_late_has_the_history(open_page, rehearsal):
    seen = navigating(open_page, rehearsal)
    until(lambda: seconds_of(seen.text("#time")) > 30)
    histories = []

    def keep(payload):
        if isinstance(payload, bytes) and payload[0] == 2:
            histories.append(payload)

    seen.page.on("websocket", lambda socket: socket.on("framereceived", keep))
    seen.page.reload()
    until(lambda: histories, rest=lambda s: seen.page.wait_for_timeout(1000 * s))  # hears meanwhile
    columns, count = struct.unpack_from("<2xHI", histories[0])
    times = np.frombuffer(histories[0], "<f8", count, 8)
    assert columns > 30
    assert count > 50
    assert times[0] < 5
    assert times[-1] > 30
    seen.wait("#events li:has-text('navigation with rotation')")


def test_keys_and_themes(open_page, rehearsal):
    seen = navigating(open_page, rehearsal, color_scheme="light")
    page = seen.page
    light = pixels(seen.picture("#plot-angles")).mean()
    page.keyboard.press("t")
    assert pixels(seen.picture("#plot-angles")).mean() < light - 80
    page.keyboard.press("3")
    assert page.get_attribute("[data-span=Infinity]", "aria-pressed") == "true"
    page.keyboard.press("h")
    assert page.get_attribute("#hold", "aria-pressed") == "true"
    page.keyboard.press("h")
    page.keyboard.press("b")
    page.click("#tab-bus td:has-text('GYRO_REDUNDANCY')")
    page.click("#tab-bus .detail td:has-text('parity_ratio')")
    seen.wait(".over-time:not([hidden])")
    seen.wait(".bits i.one")
    seen.wait(".signals path[d*=L]")
    page.keyboard.press("?")
    seen.wait("dialog[open]")
    page.keyboard.press("Escape")
    page.keyboard.press("c")
    page.reload()
    seen.wait("#tab-codes:not([hidden])")
    assert page.get_attribute("[data-span=Infinity]", "aria-pressed") == "true"
    assert seen.complaints == []


def test_plots_are_chosen_enlarged_and_saved(open_page, rehearsal):
    seen = navigating(open_page, rehearsal)
    page = seen.page
    page.click("#choose")
    page.click("#choice label:has-text('Attitude')")
    page.keyboard.press("Escape")
    page.wait_for_selector("#plot-attitude", state="hidden")
    page.click("#plot-angles button[title^=enlarge]")
    box = page.locator("#plot-angles").bounding_box()
    assert (box["width"], box["height"]) > (1200, 700)
    for kind, begins in (
        ("PNG", b"\x89PNG"),
        ("SVG", b"<svg"),
        ("CSV", b"time_s,inner_deg,outer_deg"),
    ):
        page.click("#plot-angles button[title^=save]")
        with page.expect_download() as saving:
            page.click(f"#save button:has-text('{kind}')")
        assert saving.value.suggested_filename == f"table_angles.{kind.lower()}"
        assert Path(saving.value.path()).read_bytes().startswith(begins)
    page.keyboard.press("Escape")
    assert page.locator("#plot-angles").bounding_box()["height"] < 400
    assert seen.complaints == []


OVERFLOWS = """() => {
  const seen = (e) => e.checkVisibility() && !e.closest("svg, .uplot, dialog");
  const name = (e) => `${e.tagName}.${e.className} ${e.textContent.slice(0, 40)}`;
  const right = (e) => e.getBoundingClientRect().right;
  const wide = document.documentElement.clientWidth;
  const all = [...document.querySelectorAll("body, body *")].filter(seen);
  const cut = all.filter((e) => {
    const hides = getComputedStyle(e).overflowX !== "visible";
    return (hides && e.scrollWidth > e.clientWidth + 1) || right(e) > wide + 1;
  });
  const common = (a, b) => ({
    left: Math.max(a.left, b.left), right: Math.min(a.right, b.right),
    top: Math.max(a.top, b.top), bottom: Math.min(a.bottom, b.bottom),
  });
  const shown = (rect, e) => {  // what no ancestor scrolls away
    for (let p = e; p; p = p.parentElement)
      if (getComputedStyle(p).overflowY !== "visible")
        rect = common(rect, p.getBoundingClientRect());
    return rect;
  };
  const range = document.createRange();
  const texts = all.flatMap((e) => [...e.childNodes].flatMap((node) => {
    if (node.nodeType !== Node.TEXT_NODE || !node.data.trim()) return [];
    range.selectNodeContents(node);
    return [...range.getClientRects()].map((rect) => [e, shown(rect, e)]);
  }));
  const overlapping = texts.filter(([e, a], k) => texts.slice(k + 1).some(([, b]) => {
    const both = common(a, b);
    return both.right - both.left > 2 && both.bottom - both.top > 3;
  }));
  return [...cut, ...overlapping.map(([e]) => e)].map(name);
}"""


def test_nothing_is_cut_or_overlaps_at_any_size(open_page, rehearsal):
    page = navigating(open_page, rehearsal).page
    for width, height in ((390, 844), (1024, 1366), (1280, 800), (1920, 1080)):
        page.set_viewport_size({"width": width, "height": height})
        for tab in "bfcw":
            page.keyboard.press(tab)
            until(lambda: page.evaluate(OVERFLOWS) == [], rest=lambda s: page.wait_for_timeout(100))


def test_stop_and_start_again(open_page, serving, scenario):
    with serving(scenario, "--speed", "0", "--duration", "3000") as served:
        seen = navigating(open_page, served)
        seen.page.click("text=Stop")
        seen.wait("body[data-phase=ended]")
        assert "stopped; position error at the end" in seen.text("#banner")
        seen.page.click("text=Start")
        seen.wait("body[data-phase=running]")
        seen.wait("body[data-mode=NAVIGATION_ROTATING]")
        assert seen.complaints == []


def test_a_server_that_is_killed_is_missed(open_page, serving, recording):
    with serving(recording) as served:
        seen = open_page(served.url)
        seen.wait("body[data-link=up]")
        served.process.send_signal(signal.SIGKILL)
        served.process.wait()
        seen.wait("body[data-link=lost]")
        assert "The server does not answer" in seen.text("#banner")


def test_a_recording_is_played_back(open_page, serving, recording):
    with serving(recording) as served:
        seen = open_page(served.url)
        seen.wait("body[data-phase=running]")
        time_then = seen.text("#time")
        until(lambda: seen.text("#time") != time_then)
        seen.page.click("#events li:has-text('the gyros disagree')")
        seen.wait('.chip[data-state="suspect"]')
        seen.page.keyboard.press("p")
        seen.wait("body[data-phase=paused]")
        at_s = seconds_of(seen.text("#time"))
        assert 20 < at_s < 45
        seen.page.keyboard.press("ArrowLeft")
        until(lambda: seconds_of(seen.text("#time")) < at_s - 5)
        assert not seen.page.is_visible("#drive")
        _drag_from_a_quarter_to_three(seen, "#plot-angles .u-over")
        assert _far_ends(seen, [0, 10, 11, 1000], 9.5, 11.5) == [
            {"at": 0, "next": 1, "time": 9.5, "share": 0.95},
            {"at": 3, "next": 2, "time": 11.5, "share": pytest.approx(988.5 / 989)},
        ]
        assert _far_ends(seen, [8, 10, 11, 13], 9.5, 11.5) == []
        angles = "[0, 180, 310, 320, 360, -180, null, 1080.5]"  # broken where they wrap
        turned = [0, 180, 310, None, 0, 180, None, 0.5]
        assert _of(seen, "charts.js", f"turned({angles})") == turned
        assert _of(seen, "plots.js", "merged([[10, 20], [30, 40], [14, 18], [39, 42]])") == [
            [10, 20],
            [30, 42],
        ]
        assert _of(seen, "charts.js", "labels([-0.1])") == ["-0.1"]
        assert _of(seen, "charts.js", "labels([0, 50, 100])") == ["0", "50", "100"]
        ages = "[0.005, 2.34, 812, 11160].map(page.span)"
        assert _of(seen, "parts.js", ages, "") == ["5 ms", "2.3 s", "812 s", "3.1 h"]
        parities = "[0.17, 40.95].map(page.parityWords)"
        assert _of(seen, "parts.js", parities, "") == ["0.17", "40.95 or more"]
        # A hurried tour is beyond the end of its step when it asks how far the navigation was off.
        store = (
            "{ at: () => 2, column: (name) => (name === 'error_east_m' ? [0, 3, 0] : [0, 4, 0]) }"
        )
        assert (
            _of(seen, "tour.js", f"Tour.prototype.error.call({{ store: {store} }}, 300)")
            == "5.00 m"
        )
        assert seen.complaints == []


def _drag_from_a_quarter_to_three(seen, selector):
    """Drag in a plot: the view is then half of what it was, in all plots."""
    shown = "uPlot.sync('time').plots.filter((plot) => plot.root.offsetParent)"
    scale = f"{shown}.map((plot) => plot.scales.x.max - plot.scales.x.min)"
    before = seen.page.evaluate(scale)
    box = seen.page.locator(selector).bounding_box()
    mouse, y = seen.page.mouse, box["y"] + box["height"] / 2
    mouse.move(box["x"] + box["width"] / 4, y)
    mouse.down()
    mouse.move(box["x"] + box["width"] / 2, y)
    mouse.move(box["x"] + 3 * box["width"] / 4, y)
    mouse.up()
    assert seen.page.evaluate(scale) == pytest.approx([b / 2 for b in before], rel=0.02)
    seen.page.mouse.dblclick(box["x"] + box["width"] / 2, y)
    assert seen.page.evaluate(scale) == pytest.approx(before)


def _of(seen, file, call, of="page."):
    """Return what a function of the page returns."""
    return seen.page.evaluate(f"import('./{file}').then((page) => {of}{call})")


def _far_ends(seen, *arguments):
    """Return which points a plot moves to its edge: dashes on a line far outside take seconds."""
    return _of(seen, "plots.js", f"farEnds(...{list(arguments)})")


WRITES = pytest.mark.skipif(
    os.environ.get("RRINS_WRITE_DOCS") != "1", reason="writes the pictures of the guide"
)


def keep(page, path):
    """Keep a picture of a page, small."""
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    palette = picture.quantize(200, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    palette.save(path, optimize=True)
    assert path.stat().st_size < 300_000


@WRITES
def test_pictures_of_the_guide(open_page, serving, tmp_path, pictures):
    log = tmp_path / "bus.blf"
    with serving("rimu_rotating", "--speed", "20", "--record", log, folder=tmp_path) as served:
        seen = navigating(open_page, served, color_scheme="light", viewport=LARGE)
        page = seen.page
        until(lambda: seconds_of(seen.text("#time")) > 460, 120)
        page.keyboard.press("f")
        page.fill("input[name=bias_dph]", "20")
        page.click("#inject")
        seen.wait('.chip[data-state="excluded"]')
        until(lambda: seconds_of(seen.text("#time")) > 590, 120)
        page.keyboard.press("3")
        time.sleep(1)
        keep(page, pictures / "dashboard.png")
        page.keyboard.press("t")
        page.keyboard.press("b")
        page.set_viewport_size({"width": 1280, "height": 800})
        time.sleep(1)
        keep(page, pictures / "dashboard_dark.png")
        page.click("text=Stop")
        seen.wait("body[data-phase=ended]")
    with serving(log, folder=tmp_path) as served:
        seen = open_page(served.url, color_scheme="light", viewport=LARGE)
        seen.page.click("#events li:has-text('left out')")
        time.sleep(2)
        keep(seen.page, pictures / "dashboard_playback.png")
