"""Fixtures for serial lines: a short scenario, a reader of pseudo-terminals."""

from __future__ import annotations

import os
import select

import pytest

SCENARIO = """
duration_s = 3
seed = 11
[site]
latitude_deg = -33.8568
longitude_deg = 151.2153
height_m = 58.5
[body]
roll_deg = 1.25
pitch_deg = -2.5
heading_deg = 217.4
[gyros]
bias_dph = 100
[accelerometers]
bias_ug = [100000, 50000, -70000, 20000]
[turntable]
inner = { acceleration_limit_dps2 = 100 }
outer = { acceleration_limit_dps2 = 100 }
[firmware]
alignment_s = 0.5
turn_rate_dps = 30
scheme = [{axis = "inner", angle_deg = 20}, {axis = "outer", angle_deg = -20}]
"""
"""Sensors so bad that the solution moves off at some m/s."""


@pytest.fixture(scope="session")
def scenario(tmp_path_factory):
    path = tmp_path_factory.mktemp("serial") / "own.toml"
    path.write_text(SCENARIO, encoding="utf-8")
    return path


class Terminal:
    """A person's end of a pseudo-terminal."""

    def __init__(self, path):
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
        self.text = ""

    def type(self, text):
        os.write(self.fd, text.encode())

    def wait_for(self, words, timeout_s=120):
        """Read until `words` have come; return what came since the last call, up to them."""
        poll = select.poll()
        poll.register(self.fd, select.POLLIN)
        while words not in self.text:
            assert poll.poll(timeout_s * 1000), f"{words!r} never came: {self.text!r}"
            self.text += os.read(self.fd, 4096).decode("ascii")
        before, found, self.text = self.text.partition(words)
        return before + found

    def close(self):
        os.close(self.fd)


@pytest.fixture
def terminal():
    """Open terminals; close them in the end."""
    opened = []

    def opener(path):
        opened.append(Terminal(path))
        return opened[-1]

    yield opener
    for one in opened:
        one.close()
