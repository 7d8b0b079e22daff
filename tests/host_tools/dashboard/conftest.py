"""Dashboards as processes, and a Chromium to look at them."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import tempfile
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.processes import Fork

CHROMIUM = shutil.which("chromium")
ARGUMENTS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",  # the processor does it cheaper by itself
]

SCENARIO = """
title = "Four gyros on a ship at her moorings"
duration_s = 6000
navigate_at_s = 0.5

[motion]
kind = "sway"

[firmware]
alignment_s = 0.5
turn_rate_dps = 20
stand_s = 4
scheme = "8-position"

[gyros]
angle_random_walk_deg_per_sqrt_h = 0.002
bias_dph = [0.02, -0.01, 0.03, -0.02]

[accelerometers]
white_noise_ug_per_sqrt_hz = 20
bias_ug = 50
"""


class Served:
    """A dashboard under way."""

    def __init__(self, arguments, folder, environment):
        self.process = Fork(
            ["rrins", "dashboard", *arguments, "--port", "0"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            cwd=folder,
            env=environment,
        )
        self.said = []
        for line in self.process.stderr:
            self.said.append(line.rstrip())
            found = re.search(r"dashboard at (http://\S+);", line)
            if found:
                self.url = found[1]
                break
        else:
            raise AssertionError(f"no dashboard: {self.said}")
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        with self.process.stderr as lines:
            for line in lines:
                self.said.append(line.rstrip())

    def stop(self):
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(120)


@contextmanager
def _serving(*arguments, folder=None, runtime=None):
    """Run a dashboard with channels of its own, or with those of another one's folder."""
    with tempfile.TemporaryDirectory(prefix="rrins-") as own:
        runtime = runtime or own
        environment = os.environ | {"XDG_RUNTIME_DIR": runtime}
        served = Served([str(one) for one in arguments], folder or own, environment)
        served.runtime = runtime
        try:
            yield served
        finally:
            if served.process.poll() is None and served.stop() != 0:
                pytest.fail(f"ended with {served.process.returncode}: {served.said}")


@pytest.fixture(scope="session")
def serving():
    """Return what runs a dashboard in a `with`."""
    return _serving


@pytest.fixture(scope="session")
def scenario(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenario") / "turning.toml"
    path.write_text(SCENARIO)
    return path


@pytest.fixture(scope="module")
def rehearsal(scenario):
    """Return a dashboard that rehearses for ten minutes; the tests of a file share it."""
    with _serving(scenario, "--speed", "10") as served:
        yield served


@pytest.fixture(scope="session")
def recording(scenario, tmp_path_factory):
    """Return a recording of a minute in which a gyro fails after 20 s."""
    folder = tmp_path_factory.mktemp("recording")
    fault = '[[faults]]\nkind = "gyro_bias"\nsensor = 2\nbias_dph = 20\nat_s = 20\n'
    path = folder / "failing.toml"
    path.write_text(scenario.read_text().replace("6000", "60") + fault)
    log = folder / "bus.blf"
    words = ["rehearse", path, "--record", log, "--out", folder / "out", "--json"]
    with Fork(["rrins", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as done:
        _, said = done.communicate()
    assert done.returncode == 0, said
    return log


@pytest.fixture(scope="module")
def chromium():
    """Return a Chromium; skip without one, unless it is required.

    Playwright leaves an event loop running in this thread, in which `asyncio.run` then fails: it
    ends with the file.
    """
    if CHROMIUM is None:
        if os.environ.get("RRINS_REQUIRE_BROWSER") == "1":
            pytest.fail("there is no chromium")
        pytest.skip("there is no chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield browser
        browser.close()


class Seen:
    """A page, and what it complained of and asked for."""

    def __init__(self, chromium, url, script="", **options):
        self.context = chromium.new_context(
            **({"viewport": {"width": 1280, "height": 800}} | options)
        )
        self.context.add_init_script(script)
        self.page = self.context.new_page()
        self.complaints = []
        self.requests = []
        self.page.on("console", self._hear)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("websocket", lambda socket: self.requests.append(socket.url))
        self.page.goto(url, wait_until="commit", timeout=120_000)

    def _hear(self, message):
        if message.type in ("error", "warning") and "GPU stall" not in message.text:
            self.complaints.append(message.text)

    def wait(self, selector, timeout_s=150):
        from playwright.sync_api import TimeoutError as Waited

        try:
            self.page.wait_for_selector(selector, timeout=1000 * timeout_s, state="attached")
        except Waited:
            state = self.page.evaluate("({...document.body.dataset})")
            raise AssertionError(
                f"no {selector}: {state}, banner {self.text('#banner')!r}, {self.complaints}"
            ) from None

    def text(self, selector):
        return self.page.inner_text(selector)

    def picture(self, selector):
        return self.page.locator(selector).screenshot()

    def close(self):
        self.context.close()


@pytest.fixture
def open_page(chromium):
    opened = []

    def opener(url, **options):
        opened.append(Seen(chromium, url, **options))
        return opened[-1]

    yield opener
    for one in opened:
        one.close()


@pytest.fixture
def pictures():
    return Path(__file__).parents[3] / "docs" / "pictures"
