"""The line console: keystrokes in, lines out, never more than one command at a time."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.firmware_py.core.modes.modes import FirmwareFault, Mode, ModeRequest, fail
from rrins.firmware_py.serial.console import PROMPT, READOUTS, Console
from rrins.firmware_py.serial.line_editor import LONGEST_LINE, LineEditor


class Terminal:
    """A port with a person at it."""

    def __init__(self):
        self.typed = bytearray()
        self.shown = bytearray()
        self.is_there = True
        self.room = 10**9

    def is_attached(self):
        return self.is_there

    def read(self, limit):
        data = bytes(self.typed[:limit])
        del self.typed[:limit]
        return data

    def write(self, data):
        self.shown += data[: self.room]
        return min(len(data), self.room)


@pytest.fixture
def desk(tools):
    """A console on a bench, with a person at its terminal."""
    bench, terminal = tools.Bench(), Terminal()
    nmea = SimpleNamespace(is_on=True)
    nmea.describe = lambda: f"nmea {'on' if nmea.is_on else 'off'}"
    console = Console(bench.firmware, terminal, nmea)

    def ask(text):
        """Type text, poll until all of it has been taken, return what came back."""
        terminal.typed += text.encode()
        terminal.shown.clear()
        polls = len(text) + 2
        for _ in range(polls):
            console.poll()
        return terminal.shown.decode("ascii")

    console.poll()
    return SimpleNamespace(bench=bench, terminal=terminal, console=console, nmea=nmea, ask=ask)


def typed(text):
    """Return the lines that an editor makes of some bytes, and its echo."""
    editor = LineEditor()
    lines = [editor.feed(byte) for byte in text]
    return [line for line in lines if line is not None], bytes(editor.echo)


@pytest.mark.parametrize(
    ("keys", "lines"),
    [
        (b"one\rtwo\ntwo\r\nthree\r", ["one", "two", "two", "three"]),
        (b"\r\r\n\n", ["", "", ""]),
        (b"naw\x7f\x7fav\r", ["nav"]),
        (b"\x08\x08x\x08\x08ok\r", ["ok"]),
        (b"wrong\x15right\r", ["right"]),
        (b"half\x03whole\r", ["", "whole"]),
        (b"a\x1b[Ab\x1bOCc\x1b[1;5Dd\r", ["abcd"]),
        (b"a\x00\x01\t\xff\xc3\xa9b\r", ["ab"]),
    ],
)
def test_lines_of_keystrokes(keys, lines):
    assert typed(keys)[0] == lines


def test_echo_follows_the_keystrokes():
    assert typed(b"ab\x7fc\r")[1] == b"ab\b \bc\r\n"
    assert typed(b"abc\x15")[1] == b"abc" + b"\b \b" * 3
    assert typed(b"a\x03")[1] == b"a^C\r\n"


def test_a_long_line_ends_in_the_bell():
    lines, echo = typed(b"x" * 500 + b"\r")
    assert lines == ["x" * LONGEST_LINE]
    assert echo.count(b"\a") == 500 - LONGEST_LINE


def test_greeting_prompt_and_echo(desk):
    assert desk.terminal.shown.startswith(b"RRINS firmware ")
    assert desk.terminal.shown.endswith(b"\r\n" + PROMPT)
    assert desk.ask("vers") == "vers"
    assert desk.ask("ion\r").startswith("ion\r\nRRINS firmware ")
    assert desk.ask("\r") == f"\r\n{PROMPT.decode()}"


def test_help_names_every_command(desk):
    answer = desk.ask("help\r")
    for name in (*READOUTS, "help", "version", "mode", "nmea"):
        assert f"\n{name}" in answer


@pytest.mark.parametrize(
    "words", ["foo", "status now", "mode", "mode up", "mode align now", "nmea 1"]
)
def test_what_it_does_not_know_costs_one_line(desk, words):
    answer = desk.console.answer(words)
    assert len(answer) == 1
    assert answer[0].startswith(words.split()[0])
    assert desk.bench.state["modes"]["requested"] == ModeRequest.NONE


def states(tools):
    """Return firmware in all the modes that readouts meet."""
    bench = tools.Bench()
    yield bench.firmware
    bench.run_to(Mode.STANDBY)
    yield bench.firmware
    bench.run_to(Mode.NAVIGATION_ROTATING, ModeRequest.NAVIGATE_ROTATING)
    bench.step()
    yield bench.firmware
    bench.state["sequencer"]["homing"] = True
    bench.state["sequencer"]["not_following"] = True
    bench.state["assembly"]["axis_state"] = 15
    bench.step([])
    yield bench.firmware
    fail(bench.ram[0], FirmwareFault.SENSORS_LOST)
    yield bench.firmware


@pytest.mark.parametrize("name", READOUTS)
def test_readouts_fit_a_terminal_in_every_mode(tools, name):
    for firmware in states(tools):
        lines = READOUTS[name](firmware)
        assert lines
        for line in lines:
            assert line.isascii()
            assert len(line) < 80


def test_readouts_tell_the_values(desk):
    desk.bench.run_to(Mode.NAVIGATION_STRAPDOWN, ModeRequest.NAVIGATE_STRAPDOWN)
    assert "mode    NAVIGATION_STRAPDOWN" in desk.ask("status\r")
    assert "sync    held" in desk.ask("status\r")
    assert "latitude     +40.000000000 deg" in desk.ask("nav\r")
    desk.bench.step(desk.bench.frames()[:-3])  # the last sensor and both axes are lost
    assert "    4  missing" in desk.ask("sensors\r")
    assert "+0.00000     +0.00000  HOLDING   HOLD" in desk.ask("axes\r")
    assert "missing_frames       3" in desk.ask("faults\r")


def test_nav_says_when_there_is_no_navigation(desk):
    assert "not navigating: POWER_ON" in desk.ask("nav\r")


def settle(bench, epochs=3):
    for _ in range(epochs):
        bench.step()


def test_a_mode_is_asked_for_as_a_mode_command_asks(desk):
    desk.bench.run_to(Mode.STANDBY)
    assert "requested NAVIGATE_STRAPDOWN" in desk.ask("mode strapdown\r")
    desk.bench.run_to(Mode.NAVIGATION_STRAPDOWN)
    assert desk.bench.state["modes"]["request"] == ModeRequest.NAVIGATE_STRAPDOWN


def test_what_costs_much_wants_a_yes(desk):
    desk.bench.run_to(Mode.NAVIGATION_STRAPDOWN, ModeRequest.NAVIGATE_STRAPDOWN)
    for request, warning, reached in (
        ("rotating", "this turns the table", Mode.NAVIGATION_ROTATING),
        ("standby", "this ends the navigation", Mode.STANDBY),
    ):
        before = desk.bench.mode
        assert warning in desk.ask(f"mode {request}\r")
        assert "cancelled" in desk.ask("nav\r")
        settle(desk.bench)
        assert desk.bench.mode == before
        desk.ask(f"mode {request}\r")
        assert "requested" in desk.ask("yes\r")
        settle(desk.bench)
        assert desk.bench.mode == reached
        assert "unknown command" in desk.ask("yes\r")


def test_the_console_outlasts_an_operator_who_repeats_himself(desk):
    bench = desk.bench
    bench.run_to(Mode.NAVIGATION_STRAPDOWN, ModeRequest.NAVIGATE_STRAPDOWN)
    desk.ask("mode rotating\r")
    desk.ask("yes\r")
    for _ in range(5):
        bench.step(request=ModeRequest.NAVIGATE_STRAPDOWN)
    assert bench.mode == Mode.NAVIGATION_ROTATING
    bench.step(request=ModeRequest.STANDBY)
    assert bench.mode == Mode.STANDBY


def test_it_says_what_a_mode_does_not_allow(desk):
    bench = desk.bench
    bench.run_to(Mode.NAVIGATION_STRAPDOWN, ModeRequest.NAVIGATE_STRAPDOWN)
    assert "type 'mode standby' first" in desk.ask("mode align\r")
    fail(bench.ram[0], FirmwareFault.SENSORS_LOST)
    assert "only 'mode standby' leaves FAULT" in desk.ask("mode strapdown\r")
    desk.ask("mode standby\r")
    settle(bench, 1)
    assert bench.mode == Mode.SELF_TEST
    bench.step(request=ModeRequest.SHUTDOWN)
    assert "leaves SHUTDOWN" in desk.ask("mode standby\r")


def test_a_readmission_is_ordered(desk):
    assert desk.ask("redundancy\r").count("are not compared") == 1
    assert desk.ask("readmit gyro 2\r").count("are not compared") == 1
    state = desk.bench.state.redundancy
    state["enabled"] = True
    state.gyros["excluded"] = 0b0010
    assert "\ngyros           -                 -        2         no" in desk.ask("redundancy\r")
    for words in ("", "gyro", "gyro two", "gyro 17", "gyro 2 now", "axis 1"):
        assert "readmit: expected" in desk.ask(f"readmit {words}\r")
    assert "a test of 60 s" in desk.ask("readmit accelerometer 3 anew\r")
    order = state.readmission
    assert (order.order, order.order_kind, order.order_sensor, order.order_s) == (1, 1, 3, 60)
    assert order.order_anew
    order["state"], order["sensor"], order["kind"], order["wanted_s"] = 1, 3, 1, 60
    assert "is being tested" in desk.ask("readmit gyro 2\r")
    assert "readmit accelerometer 3: TESTING, 0 of 60 s" in desk.ask("redundancy\r")
    desk.ask("readmit stop\r")
    assert order.order == 2


def test_nmea_is_switched(desk):
    assert "nmea off" in desk.ask("nmea off\r")
    assert not desk.nmea.is_on
    assert "nmea on" in desk.ask("nmea on\r")
    assert desk.nmea.is_on
    assert "nmea on" in desk.ask("nmea\r")
    without = Console(desk.bench.firmware, Terminal())
    assert without.answer("nmea off") == ["nmea: there is no NMEA port"]


def test_one_poll_answers_one_command(desk):
    desk.terminal.typed += b"help\r" * 40
    before = 0
    for _ in range(50):
        desk.console.poll()
        assert desk.console.commands - before <= 1
        before = desk.console.commands
    assert before == 40


def test_a_terminal_that_takes_nothing_costs_no_memory(desk):
    desk.terminal.room = 0
    desk.ask("help\r" * 200)
    assert desk.terminal.shown == b""
    desk.terminal.room = 10**9
    assert len(desk.ask("")) <= 8192
    assert "mode " in desk.ask("status\r")


def test_who_comes_next_finds_a_fresh_console(desk):
    desk.bench.run_to(Mode.NAVIGATION_STRAPDOWN, ModeRequest.NAVIGATE_STRAPDOWN)
    desk.ask("mode standby\rsta")
    desk.terminal.is_there = False
    desk.console.poll()
    desk.terminal.is_there = True
    desk.terminal.shown.clear()
    desk.console.poll()
    assert desk.terminal.shown.startswith(b"RRINS firmware")
    assert "yes: unknown command" in desk.ask("yes\r")


@pytest.mark.slow
@given(st.binary(max_size=300))
def test_no_keystrokes_break_it(tools, keys):
    terminal = Terminal()
    console = Console(tools.Bench().firmware, terminal)
    terminal.typed += keys
    for _ in range(len(keys) + 2):
        console.poll()
    assert not terminal.typed
    assert terminal.shown.isascii()
