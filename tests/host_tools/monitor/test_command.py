"""`rrins monitor` as a process: with a terminal, with a pipe, without a bus."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import re
import select
import signal
import struct
import termios
import time
from fcntl import ioctl
from pathlib import Path

import can
import pytest
from click.testing import CliRunner

from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.cli.main import rrins
from tests.processes import Fork

COLOUR = re.compile(rb"\x1b\[(?:[0-9;]*;)?(?:3[0-8]|4[0-8]|9[0-7]|10[0-7])(?:;[0-9;]*)?m")


class Terminal:
    """A command on a pseudo-terminal of 80 x 24."""

    def __init__(self, *arguments, **environment):
        self._end, inner = pty.openpty()
        ioctl(inner, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        self._inner = inner
        self.settings = termios.tcgetattr(inner)
        self.process = Fork(
            ["rrins", "monitor", *arguments],
            stdin=inner,
            stdout=inner,
            stderr=inner,
            env={k: v for k, v in os.environ.items() if k != "NO_COLOR"} | environment,
        )
        self.sent = b""

    def read_until(self, wanted, timeout=120.0):
        """Read what is sent to the terminal until some text is among it."""
        deadline = time.monotonic() + timeout
        while wanted not in self.sent:
            left = deadline - time.monotonic()
            assert left > 0, self.sent[-2000:]
            if select.select([self._end], [], [], left)[0]:
                self.sent += os.read(self._end, 65536)

    def press(self, keys):
        os.write(self._end, keys)

    def finish(self):
        """Wait for the end; return the exit status."""
        while self.process.poll() is None:
            if select.select([self._end], [], [], 0.05)[0]:
                self.sent += os.read(self._end, 65536)
        while select.select([self._end], [], [], 0)[0]:
            self.sent += os.read(self._end, 65536)
        assert termios.tcgetattr(self._inner) == self.settings, "the terminal is not restored"
        assert b"\x1b[?1049l" in self.sent, "the screen before has not come back"
        return self.process.returncode

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        os.close(self._end)
        os.close(self._inner)


@pytest.fixture
def terminal():
    opened = []

    def start(*arguments, **environment):
        opened.append(Terminal(*arguments, **environment))
        return opened[-1]

    yield start
    for one in opened:
        one.close()


@pytest.fixture
def hardware(start):
    """A hardware process that waits for a firmware: a bus that is there, and silent."""
    process = start("hardware", "rimu_rotating", "--speed", "max", "--json", "--duration", "30")
    socket = Path(os.environ["XDG_RUNTIME_DIR"]) / "rrins" / "rrins0.sock"
    deadline = time.monotonic() + 120
    while not socket.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    yield process
    with contextlib.suppress(ProcessLookupError):
        process.process.terminate()
    process.process.communicate()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [((), "not running"), (("--interface", "socketcan"), "needs a --channel")],
)
def test_without_a_bus_it_is_one_line_and_status_4(arguments, words):
    result = CliRunner().invoke(rrins, ["monitor", "--once", *arguments])
    assert result.exit_code == 4
    assert result.stdout == ""
    assert len(result.stderr.splitlines()) == 1
    assert words in result.stderr


@pytest.mark.slow
def test_a_lockstep_run_is_seen_from_the_first_frame_to_the_last(start):
    """As fast as it goes, and nothing is missed."""
    options = ("rimu_rotating", "--speed", "max", "--json", "--duration", "150")
    hardware = start("hardware", *options, "--await-peer", "monitor")
    firmware = start("firmware", *options, "--attach-wait", "60")
    for _ in range(600):
        monitor = start("monitor", "--json", "--for", "60")
        status, out = monitor.finish()
        if status == 0:
            break
    found = json.loads(out)
    sent = sum(json.loads(side.finish()[1])["frames_sent"] for side in (hardware, firmware))
    assert found["gaps"] == 0
    assert found["frames"] == sent
    assert found["ended"] is not None
    assert found["firmware"]["mode"] == "NAVIGATION_ROTATING"
    assert all(message["lost"] == 0 for message in found["messages"])
    rates = {message["name"]: message["rate_hz"] for message in found["messages"]}
    assert rates["SENSOR_4"] == pytest.approx(200)
    assert rates["HEARTBEAT_FIRMWARE"] == pytest.approx(1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("environment", "keys", "has_colour"),
    [
        ({"TERM": "xterm-256color"}, b"q", True),
        ({"TERM": "xterm-256color", "NO_COLOR": "1"}, b"q", False),
        ({"TERM": "vt100"}, b"\x03", False),
    ],
)
def test_colour_is_for_terminals_that_have_it(terminal, environment, keys, has_colour):
    with RrinsBus("rrins0") as bus:  # hosted by a process of its own
        screen = terminal("--filter", "unknown", **environment)
        screen.read_until(b"WAITING FOR FRAMES")
        bus.send(can.Message(arbitration_id=0x001, is_extended_id=False, data=bytes(8)))
        screen.read_until(b"TROUBLES 1: unknown identifier 0x001")
        screen.press(keys)
        assert screen.finish() == 0
    assert bool(COLOUR.search(screen.sent)) is has_colour


@pytest.mark.slow
def test_it_says_at_once_what_it_waits_for_and_takes_pasted_text_as_a_filter(terminal):
    with RrinsBus("rrins0") as bus:
        screen = terminal(TERM="xterm")
        screen.read_until(b"connecting to rrins:rrins0")
        screen.read_until(b"WAITING FOR FRAMES")
        assert screen.sent.index(b"connecting to") < screen.sent.index(b"WAITING FOR FRAMES")
        bus.send(can.Message(arbitration_id=0x001, is_extended_id=False, data=bytes(8)))
        screen.press(b"\x1b[200~query\x1b[201~")
        screen.read_until(b"filter: ")
        screen.read_until(b"query")
        screen.press(b"\x03")
        assert screen.finish() == 0


def test_without_a_bus_the_screen_before_comes_back(terminal):
    screen = terminal("--channel", "nobody", TERM="xterm")
    screen.read_until(b"connecting to rrins:nobody")
    assert screen.finish() == 4
    assert screen.sent.rindex(b"\x1b[?1049l") < screen.sent.rindex(b"rrins: ")


@pytest.mark.slow
def test_the_screen_stays_when_the_bus_ends(hardware, terminal):
    screen = terminal(TERM="xterm")
    screen.read_until(b"WAITING FOR FRAMES")
    hardware.process.terminate()
    screen.read_until(b"THE BUS HAS ENDED")
    screen.process.send_signal(signal.SIGTERM)
    assert screen.finish() == 0
