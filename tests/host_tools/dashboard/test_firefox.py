"""The page in Firefox, over its WebDriver BiDi; skipped without `firefox-esr` and `Xvfb`.

WebGL needs a display: headless Firefox draws none in software. With Debian:
`apt-get install --no-install-recommends firefox-esr xvfb libegl1 libgl1 libgl1-mesa-dri libpci3`.
"""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import subprocess
import threading
import time
from urllib.parse import urlsplit

import pytest
from websockets.sync.client import connect

from tests.host_tools.dashboard.test_page import changed

needs_firefox = pytest.mark.skipif(
    not (shutil.which("firefox-esr") and shutil.which("Xvfb")),
    reason="there is no firefox-esr, or no Xvfb",
)
pytestmark = [pytest.mark.browser, needs_firefox]


class Firefox:
    """A Firefox with one page."""

    def __init__(self, socket):
        self.socket = socket
        self.events = []
        self.number = 0
        self.call("session.new", capabilities={})
        wanted = ["log.entryAdded", "network.beforeRequestSent"]
        self.call("session.subscribe", events=wanted)
        self.page = self.call("browsingContext.getTree")["contexts"][0]["context"]

    def call(self, method, **params):
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "method": method, "params": params}))
        while True:
            message = json.loads(self.socket.recv(timeout=120))
            if message.get("id") == self.number:
                assert message["type"] == "success", message
                return message["result"]
            self.events.append(message)

    def of(self, method):
        return [event["params"] for event in self.events if event.get("method") == method]

    def value(self, expression):
        target = {"context": self.page}
        done = self.call(
            "script.evaluate", expression=expression, target=target, awaitPromise=False
        )
        return done["result"].get("value")

    def picture(self, selector):
        """Return a picture of an element as PNG."""
        script = f"JSON.stringify(document.querySelector('{selector}').getBoundingClientRect())"
        box = json.loads(self.value(script))
        clip = {"type": "box"} | {key: box[key] for key in ("x", "y", "width", "height")}
        shot = self.call("browsingContext.captureScreenshot", context=self.page, clip=clip)
        return base64.b64decode(shot["data"])


@pytest.fixture
def display():
    """Return the number of a display in memory."""
    reading, writing = os.pipe()
    words = ["Xvfb", "-displayfd", str(writing), "-screen", "0", "1400x900x24"]
    server = subprocess.Popen(words, pass_fds=(writing,), stderr=subprocess.DEVNULL)
    os.close(writing)
    with os.fdopen(reading) as numbers:
        yield f":{numbers.readline().strip()}"
    server.terminate()
    server.wait()


@pytest.fixture
def firefox(display, tmp_path):
    environment = os.environ | {"DISPLAY": display, "HOME": str(tmp_path)}
    environment["LIBGL_ALWAYS_SOFTWARE"] = "1"
    (tmp_path / "user.js").write_text('user_pref("webgl.force-enabled", true);\n')
    words = ["firefox-esr", "--no-remote", "--profile", tmp_path, "--remote-debugging-port", "0"]
    process = subprocess.Popen(words, env=environment, stderr=subprocess.PIPE, text=True)
    for line in process.stderr:
        found = re.search(r"WebDriver BiDi listening on (ws://\S+)", line)
        if found:
            break
    else:
        pytest.fail(f"Firefox ended with {process.wait()}")
    reader = threading.Thread(target=process.stderr.read, daemon=True)
    reader.start()
    with connect(f"{found[1]}/session", max_size=None) as socket:
        yield Firefox(socket)
    process.terminate()
    process.wait()
    reader.join()
    process.stderr.close()


def until(is_so, seconds=120):
    end = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < end, "it never came to be"
        time.sleep(0.05)


def test_the_page_lives_in_firefox(firefox, rehearsal):
    firefox.call("browsingContext.navigate", context=firefox.page, url=rehearsal.url, wait="none")
    until(lambda: firefox.value("document.body?.dataset.mode") == "NAVIGATION_ROTATING")
    names = ("#plot-position", "#plot-angles", "#scene")
    before = {name: firefox.picture(name) for name in names}
    until(lambda: all(changed(before[name], firefox.picture(name)) > 0.001 for name in names))
    asked = {urlsplit(e["request"]["url"]).netloc for e in firefox.of("network.beforeRequestSent")}
    assert asked == {urlsplit(rehearsal.url).netloc}
    assert [entry["text"] for entry in firefox.of("log.entryAdded")] == []
