"""The line console: a technician with a terminal program asks the navigation computer.

It polls its port, takes a few bytes and answers one command at most at a time, so that its work is
bounded, and never waits. What it changes, it changes as a MODE_COMMAND would.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from importlib import metadata
from typing import Protocol

from firmware_py import readout
from firmware_py.line_editor import LineEditor
from firmware_py.loop import Firmware
from firmware_py.modes import Mode, ModeRequest

PROMPT = b"rrins> "

_BYTES_A_POLL = 64
_LARGEST_OUTPUT = 8192  # bytes; what a slow terminal has not taken yet

_REQUESTS = {
    "standby": ModeRequest.STANDBY,
    "align": ModeRequest.ALIGN,
    "strapdown": ModeRequest.NAVIGATE_STRAPDOWN,
    "rotating": ModeRequest.NAVIGATE_ROTATING,
}
_NAVIGATION = (Mode.NAVIGATION_STRAPDOWN, Mode.NAVIGATION_ROTATING)


class ConsolePort(Protocol):
    """A byte stream, as the console needs it (`firmware_py.serial_port.SerialPort`)."""

    def is_attached(self) -> bool:
        """Return whether there is somebody at the other side."""

    def read(self, limit: int) -> bytes:
        """Return what has come, `limit` bytes at most, without waiting."""

    def write(self, data: bytes) -> int:
        """Write as much as is taken at once; return how many bytes."""


class Switch(Protocol):
    """The NMEA output, as the console switches it."""

    is_on: bool

    def describe(self) -> str:
        """Return where it goes and what became of it, in one line."""


class Console:
    """A console on a port.

    Parameters
    ----------
    firmware : Firmware
    port : ConsolePort
    nmea : Switch, optional
        The NMEA output, if there is one.

    Attributes
    ----------
    commands : int
        Lines answered so far.
    """

    def __init__(self, firmware: Firmware, port: ConsolePort, nmea: Switch | None = None) -> None:
        self._firmware = firmware
        self._port = port
        self._nmea = nmea
        self._version = _version()
        self._editor = LineEditor()
        self._typed: deque[int] = deque()
        self._output = bytearray()
        self._is_greeted = False
        self._unconfirmed: ModeRequest | None = None
        self.commands = 0

    def poll(self) -> None:
        """Take what has been typed, answer one line of it at most, write what the port takes."""
        if not self._port.is_attached():
            self._forget()
            return
        if not self._is_greeted:
            self._is_greeted = True
            self._say([f"{self._version}; 'help' lists the commands"])
            self._output += PROMPT
        if not self._typed:
            self._typed.extend(self._port.read(_BYTES_A_POLL))
        while self._typed:
            line = self._editor.take(self._typed.popleft())
            self._show(bytes(self._editor.echo))
            self._editor.echo.clear()
            if line is not None:
                self._say(self.answer(line))
                self._show(PROMPT)
                break
        if self._output:
            del self._output[: self._port.write(bytes(self._output))]

    def _forget(self) -> None:
        """Begin anew for whoever comes next."""
        if self._is_greeted:
            self._is_greeted = False
            self._editor = LineEditor()
            self._typed.clear()
            self._output.clear()
            self._unconfirmed = None

    def _say(self, lines: list[str]) -> None:
        for line in lines:
            self._show(line.encode("ascii", "replace") + b"\r\n")

    def _show(self, data: bytes) -> None:
        """Queue output; what a terminal that takes nothing has no room for is lost to it."""
        if len(self._output) + len(data) <= _LARGEST_OUTPUT:
            self._output += data

    def answer(self, line: str) -> list[str]:
        """Do what a line says and return the lines of the answer."""
        words = line.lower().split()
        unconfirmed, self._unconfirmed = self._unconfirmed, None
        if unconfirmed is not None:
            if words == ["yes"]:
                return self._ask_for(unconfirmed)
            return ["not done"]
        if not words:
            return []
        self.commands += 1
        name, arguments = words[0], words[1:]
        takes_one = {"mode": self._mode, "nmea": self._switch_nmea}
        if name in takes_one:
            return takes_one[name](arguments)
        if name in READOUTS or name in ("help", "version"):
            if arguments:
                return [f"{name}: takes nothing after it"]
            return self._read_out(name)
        return [f"{name}: no such command; 'help' lists them"]

    def _read_out(self, name: str) -> list[str]:
        if name == "help":
            return list(_HELP)
        if name == "version":
            return [self._version]
        return READOUTS[name](self._firmware)

    def _mode(self, arguments: list[str]) -> list[str]:
        """Ask for a mode, as an operator on the bus would; first ask back where it costs much."""
        if len(arguments) != 1 or arguments[0] not in _REQUESTS:
            return [f"mode: wants one of {', '.join(_REQUESTS)}"]
        request, mode = _REQUESTS[arguments[0]], self._firmware.mode
        if mode == Mode.SHUTDOWN:
            return ["mode: SHUTDOWN is left by switching off and on only"]
        if mode == Mode.FAULT and request != ModeRequest.STANDBY:
            return ["mode: only 'mode standby' leaves FAULT"]
        if mode in _NAVIGATION and request == ModeRequest.ALIGN:
            return ["mode: navigating; 'mode standby' first"]
        if mode in _NAVIGATION and request == ModeRequest.STANDBY:
            self._unconfirmed = request
            return ["this ends the navigation; 'yes' does it"]
        if mode != Mode.NAVIGATION_ROTATING and request == ModeRequest.NAVIGATE_ROTATING:
            self._unconfirmed = request
            return ["this turns the table; 'yes' does it"]
        return self._ask_for(request)

    def _ask_for(self, request: ModeRequest) -> list[str]:
        state = self._firmware.ram[0]["modes"]
        state["request"] = ModeRequest.NONE  # so that the same is acted on again
        state["requested"] = request
        return [f"asked for {request.name}; 'status' tells the mode"]

    def _switch_nmea(self, arguments: list[str]) -> list[str]:
        if self._nmea is None:
            return ["nmea: there is no NMEA port"]
        if arguments in (["on"], ["off"]):
            self._nmea.is_on = arguments == ["on"]
        elif arguments:
            return ["nmea: wants on or off"]
        return [self._nmea.describe()]


def _version() -> str:
    try:
        return f"RRINS firmware {metadata.version('rrins')}"
    except metadata.PackageNotFoundError:
        return "RRINS firmware"


READOUTS: dict[str, Callable[[Firmware], list[str]]] = {
    "status": readout.status,
    "nav": readout.navigation,
    "sensors": readout.sensors,
    "axes": readout.axes,
    "faults": readout.faults,
}
"""Commands that only read, by name."""

_HELP = (
    "status        mode, fault, position in the scheme, time, load",
    "nav           position, velocity, attitude",
    "sensors       what each gyro and accelerometer measured in the last epoch",
    "axes          angle, rate, state and command of the turntable's axes",
    "faults        counters since power-on",
    "version       of the firmware",
    "mode NAME     ask for standby, align, strapdown or rotating",
    "nmea [on|off] the NMEA output: where it goes, switch it",
    "help          this list",
)
