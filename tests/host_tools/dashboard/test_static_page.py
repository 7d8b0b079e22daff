"""The page as static files: a rehearsal in the browser, the same as that of Python."""

from __future__ import annotations

import functools
import http.server
import threading
import time
from contextlib import contextmanager
from urllib.parse import urlsplit

import numpy as np
import pytest
from click.testing import CliRunner

from rrins.firmware_py.loop import Firmware
from rrins.host_tools.cli.bus.dashboard import dashboard
from rrins.host_tools.dashboard.quantities import NAMES
from rrins.host_tools.dashboard.static_page import write_static_page
from rrins.host_tools.dashboard.view import View
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.monitor.watch import Watch
from rrins.host_tools.runs.exchange import answer_epoch
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import load, text_of
from tests.host_tools.dashboard.test_firefox import display, firefox, needs_firefox, until
from tests.host_tools.dashboard.test_page import WRITES, keep, seconds_of

__all__ = ["display", "firefox"]  # fixtures

SCENARIO = """
title = "Four gyros at rest"
duration_s = 120

[gyros]
bias_dph = [0.1, 0.11, 0.12, 0.13]

[accelerometers]
bias_ug = [50, 55, 60, 65]

[firmware]
initial_attitude = "given"
alignment_s = 2
height_channel = "held"
turn_rate_dps = 2
stand_s = 10

[[faults]]
kind = "gyro_bias"
sensor = 2
bias_dph = 40
at_s = 100
"""
LISTENING = """
window.told = {}; window.heard = [];
const Own = window.Worker;
window.Worker = class extends Own {
  constructor(...words) {
    super(...words);
    this.addEventListener("message", ({ data }) => {
      if (typeof data !== "string") {
        window.row = Array.from(new Float32Array(data, 16), String);
        return;
      }
      const message = JSON.parse(data);
      window.told[message.kind] = message;
      if (message.kind !== "events") return;
      window.heard = [...(message.anew ? [] : window.heard), ...message.events];
    });
  }
};
"""
pytestmark = pytest.mark.timeout(1200)  # the machine code is compiled as a whole


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenario") / "failing.toml"
    path.write_text(SCENARIO)
    return path


@pytest.fixture(scope="module")
def page(path, tmp_path_factory):
    of_hours = path.with_name("hours.toml")  # sound, and not over while the machine stands still
    of_hours.write_text(
        SCENARIO.partition("[[faults]]")[0].replace("duration_s = 120", "duration_s = 36000")
    )
    return write_static_page(tmp_path_factory.mktemp("page"), [str(path), str(of_hours)])


@contextmanager
def served(page):
    """Yield the address of a plain web server that carries the folder."""

    class Silent(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *words):
            pass

    handler = functools.partial(Silent, directory=str(page.folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/"
        server.shutdown()


@pytest.fixture(scope="module")
def url(page):
    with served(page) as address:
        yield address


@pytest.fixture(scope="module")
def url_of_hours(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenario") / "hours.toml"
    path.write_text(text_of("rimu_rotating").replace("duration_s = 6000", "duration_s = 36000"))
    with served(write_static_page(tmp_path_factory.mktemp("hours"), [str(path)])) as address:
        yield address


@pytest.fixture(scope="module")
def of_python(path):
    """Return the view of the same rehearsal, run by Python, at its end."""
    scenario = load(str(path))
    hardware, firmware = (
        Hardware(hardware_settings(scenario)),
        Firmware(firmware_settings(scenario)),
    )
    watch, count = Watch(), 0
    view = View(watch, scenario)
    for epoch in range(scenario.epochs):
        sent = hardware.step(firmware.outbox, count)  # without the reports of its faults
        count = answer_epoch(firmware, hardware.outbox, sent, epoch)
        time_ns = epoch * hardware.period_ns
        watch.add_frames(hardware.outbox, sent, time_ns)
        watch.add_frames(firmware.outbox, count, time_ns)
        if epoch % 20 == 19:
            view.look()
    view.look()
    return view


def running(open_page, url):
    seen = open_page(url, script=LISTENING)
    seen.wait("body[data-phase=running]")
    return seen


@pytest.mark.browser
def test_it_rehearses_as_python_does(open_page, url, of_python):
    seen = running(open_page, url)
    seen.page.select_option("#drive select[aria-label=speed]", "0")
    seen.wait("body[data-phase=ended]")
    last = f"told.state.messages[0][6] === '{of_python.watch.state().messages[0].data.hex()}'"
    seen.page.wait_for_function(last, timeout=150_000)
    told, heard = seen.page.evaluate("told"), seen.page.evaluate("heard")
    row = np.array([float(value) for value in seen.page.evaluate("row")])
    wanted = of_python.told(of_python.state(False))
    for kind in ("sensors", "parity", "axes"):
        assert told["state"][kind] == {k: as_json(v) for k, v in wanted[kind].items()}
    rows = [[one[:2], one[3:]] for one in told["state"]["messages"]]
    assert rows == [[one[:2], one[3:]] for one in as_json(wanted["messages"])]
    texts = [one["text"] for one in told["state"]["troubles"]]
    injected = "injected into the hardware by rrins: 1 fault"
    assert texts == [*(one["text"] for one in wanted["troubles"]), injected]
    expected = [[e.time_s, e.text, e.weight] for e in of_python.log.events]
    assert [one for one in heard if one[2] != "order"][:-1] == expected
    own = [k for k, name in enumerate(NAMES) if name != "bus_load_percent"]
    np.testing.assert_allclose(row[own], of_python.row[own].astype(np.float32), 1e-6, 1e-9)
    assert {urlsplit(one).netloc for one in seen.requests} == {urlsplit(url).netloc}
    assert seen.complaints == []


@pytest.mark.browser
def test_a_fault_injected_there_is_found_there(open_page, url):
    seen = running(open_page, f"{url}?scenario=hours")
    seen.page.select_option("#drive select[aria-label=speed]", "5")
    # It has learned: minutes and seconds.
    begun = (
        "document.querySelector('#time').textContent.split(':').reduce((t, x) => 60 * t + +x) > 25"
    )
    seen.page.wait_for_function(begun, timeout=150_000)
    seen.page.click("#drive >> text=Pause")
    seen.page.click('[data-tab="control"]')
    seen.page.fill("#tab-control input[name=bias_dph]", "50")
    seen.page.click("#inject")
    seen.wait("#tab-control .answer.done")
    assert seen.text("#tab-control .answer").startswith("✓ gyro_bias (sensor 3, bias_dph 50), ")
    seen.page.click("#drive >> text=Go on")
    seen.wait('.chip[data-sensor="G3"]:has-text("excluded")')
    assert "gyro 3 left out, found by" in seen.text("#events")
    seen.page.click('[data-tab="troubles"]')
    assert "gyro 3 is left out" in seen.text("#tab-troubles")
    seen.page.click('[data-tab="control"]')
    seen.page.click("text=Clear all faults")
    seen.wait("#tab-control .answer.done:has-text('all faults are removed')")
    seen.page.fill("#tab-control input[name=sensor]", "9")
    seen.page.click("#inject")
    seen.wait("#tab-control .answer.refused")
    assert seen.complaints == []


@pytest.mark.browser
def test_the_folder_is_small(page):
    files = [path for path in page.folder.rglob("*") if path.is_file()]
    assert page.size == sum(path.stat().st_size for path in files) < 3e6


def as_json(value):
    """Return a value with lists for tuples."""
    return [as_json(one) for one in value] if isinstance(value, list | tuple) else value


def test_options_of_a_server_are_refused(tmp_path):
    done = CliRunner().invoke(dashboard, ["--static", str(tmp_path), "--port", "1"])
    assert done.exit_code == 2
    assert "--port: not with --static" in done.output


@pytest.mark.browser
@WRITES
def test_the_picture_of_the_guide(open_page, tmp_path, pictures):
    with served(write_static_page(tmp_path)) as url:
        seen = open_page(url, color_scheme="light", viewport={"width": 1280, "height": 800})
        seen.wait("body[data-phase=running]")
        seen.page.select_option("#drive select[aria-label=speed]", "10")
        until(lambda: seconds_of(seen.text("#time")) > 460)
        seen.page.keyboard.press("f")
        seen.page.fill("input[name=bias_dph]", "20")
        seen.page.click("#inject")
        seen.wait('.chip[data-state="excluded"]')
        seen.page.keyboard.press("3")
        until(lambda: seconds_of(seen.text("#time")) > 590)
        keep(seen.page, pictures / "static_page.png")


def first_plot_and_speed(value, begun_s):
    """Return the seconds to the first plot, and then how many times real time an hour takes."""
    drawn = "document.body?.dataset.phase === 'running' && /[1-9]/.test(time.textContent)"
    drawn += " && document.querySelectorAll('#plot-position canvas').length > 0"
    until(lambda: value(drawn))
    first_s = time.monotonic() - begun_s
    value("drive.querySelector('[aria-label=speed]').value = '0'")
    value("drive.querySelector('[aria-label=speed]').dispatchEvent(new Event('change'))")
    from_s, begun_s = seconds_of(value("time.textContent")), time.monotonic()
    until(lambda: seconds_of(value("time.textContent")) > from_s + 3600)
    to_s = seconds_of(value("time.textContent"))
    return first_s, (to_s - from_s) / (time.monotonic() - begun_s)


@pytest.mark.browser
@pytest.mark.soak
@pytest.mark.parametrize("browser", ["chromium", pytest.param("firefox", marks=needs_firefox)])
def test_the_first_plot_is_there_soon_and_a_rehearsal_is_fast(browser, request, url_of_hours):
    opener = request.getfixturevalue("open_page" if browser == "chromium" else "firefox")
    begun_s = time.monotonic()
    if browser == "chromium":
        value = opener(url_of_hours).page.evaluate
    else:
        value = opener.value
        opener.call("browsingContext.navigate", context=opener.page, url=url_of_hours, wait="none")
    first_s, speed = first_plot_and_speed(value, begun_s)
    print(f"{browser}: the first plot after {first_s:.1f} s, {speed:.0f} times real time")
    assert first_s < 2
    assert speed > 100


@pytest.mark.browser
@needs_firefox
def test_it_rehearses_in_firefox(firefox, url):
    firefox.call("browsingContext.navigate", context=firefox.page, url=url, wait="none")
    until(lambda: firefox.value("document.body?.dataset.mode") == "NAVIGATION_ROTATING")
    asked = {urlsplit(e["request"]["url"]).netloc for e in firefox.of("network.beforeRequestSent")}
    assert asked == {urlsplit(url).netloc}
    assert [entry["text"] for entry in firefox.of("log.entryAdded")] == []
