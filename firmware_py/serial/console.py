"""The line console: a technician queries the navigation computer from a terminal program.

Each poll reads a few bytes and answers at most one command, so its work is bounded and it never
waits. It changes modes as a MODE_COMMAND would.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from importlib import metadata
from typing import Protocol

from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.modes.modes import Mode, ModeRequest
from rrins.firmware_py.core.records.redundancy_records import (
    ReadmissionOrder,
    ReadmissionState,
    SensorKind,
)
from rrins.firmware_py.loop import Firmware
from rrins.firmware_py.serial import readout
from rrins.firmware_py.serial.line_editor import LineEditor

PROMPT = b"rrins> "

_BYTES_A_POLL = 64
_TEST_S = 60  # of a sensor before it is readmitted
_LARGEST_OUTPUT = 8192  # bytes that a slow terminal has not read yet

_REQUESTS = {
    "standby": ModeRequest.STANDBY,
    "align": ModeRequest.ALIGN,
    "strapdown": ModeRequest.NAVIGATE_STRAPDOWN,
    "rotating": ModeRequest.NAVIGATE_ROTATING,
}
_NAVIGATION = (Mode.NAVIGATION_STRAPDOWN, Mode.NAVIGATION_ROTATING)


class ConsolePort(Protocol):
    """A byte stream, as the console needs it (`rrins.firmware_py.serial.port.SerialPort`)."""

    def is_attached(self) -> bool:
        """Return whether a terminal is connected."""

    def read(self, limit: int) -> bytes:
        """Return at most `limit` received bytes, without waiting."""

    def write(self, data: bytes) -> int:
        """Write as much as possible without waiting; return the number of bytes."""


class Switch(Protocol):
    """The NMEA output, as the console switches it."""

    is_on: bool

    def describe(self) -> str:
        """Return its port and its counters, in one line."""


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
        """Read what was typed, answer at most one line of it, write as much as the port accepts."""
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
            line = self._editor.feed(self._typed.popleft())
            self._show(bytes(self._editor.echo))
            self._editor.echo.clear()
            if line is not None:
                self._say(self.answer(line))
                self._show(PROMPT)
                break
        if self._output:
            del self._output[: self._port.write(bytes(self._output))]

    def _forget(self) -> None:
        """Reset for the next user."""
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
        """Queue output; drop it when a terminal that does not read has filled the queue."""
        if len(self._output) + len(data) <= _LARGEST_OUTPUT:
            self._output += data

    def answer(self, line: str) -> list[str]:
        """Execute a command line; return the lines of the answer."""
        words = line.lower().split()
        unconfirmed, self._unconfirmed = self._unconfirmed, None
        if unconfirmed is not None:
            if words == ["yes"]:
                return self._ask_for(unconfirmed)
            return ["cancelled"]
        if not words:
            return []
        self.commands += 1
        name, arguments = words[0], words[1:]
        takes_some = {"mode": self._mode, "nmea": self._switch_nmea, "readmit": self._readmit}
        if name in takes_some:
            return takes_some[name](arguments)
        if name in READOUTS or name in ("help", "version"):
            if arguments:
                return [f"{name}: takes no arguments"]
            return self._read_out(name)
        return [f"{name}: unknown command; 'help' lists the commands"]

    def _read_out(self, name: str) -> list[str]:
        if name == "help":
            return list(_HELP)
        if name == "version":
            return [self._version]
        return READOUTS[name](self._firmware)

    def _mode(self, arguments: list[str]) -> list[str]:
        """Request a mode, as an operator on the bus would; ask for confirmation where needed."""
        if len(arguments) != 1 or arguments[0] not in _REQUESTS:
            return [f"mode: expected one of {', '.join(_REQUESTS)}"]
        request, mode = _REQUESTS[arguments[0]], self._firmware.mode
        if mode == Mode.SHUTDOWN:
            return ["mode: only switching off and on leaves SHUTDOWN"]
        if mode == Mode.FAULT and request != ModeRequest.STANDBY:
            return ["mode: only 'mode standby' leaves FAULT"]
        if mode in _NAVIGATION and request == ModeRequest.ALIGN:
            return ["mode: navigating; type 'mode standby' first"]
        if mode in _NAVIGATION and request == ModeRequest.STANDBY:
            self._unconfirmed = request
            return ["this ends the navigation; type 'yes' to confirm"]
        if mode != Mode.NAVIGATION_ROTATING and request == ModeRequest.NAVIGATE_ROTATING:
            self._unconfirmed = request
            return ["this turns the table; type 'yes' to confirm"]
        return self._ask_for(request)

    def _ask_for(self, request: ModeRequest) -> list[str]:
        modes = self._firmware.ram[0].modes
        modes.request = ModeRequest.NONE  # so that a repeated request counts
        modes.requested = request
        return [f"requested {request.name}; 'status' shows the mode"]

    def _readmit(self, arguments: list[str]) -> list[str]:
        """Order a sensor that is left out to be tested and used again, or stop the test."""
        redundancy = self._firmware.ram[0].redundancy
        if not redundancy.enabled:
            return ["readmit: redundant sensors are not compared"]
        readmission = redundancy.readmission
        if arguments == ["stop"]:
            readmission.order = ReadmissionOrder.STOP
            return ["requested; 'redundancy' shows what came of it"]
        kinds = [kind.name.lower() for kind in SensorKind]
        is_anew = arguments[2:] == ["anew"]
        known = len(arguments) >= 2 and arguments[0] in kinds and (is_anew or not arguments[2:])
        if not known or not arguments[1].isdecimal() or not 1 <= int(arguments[1]) <= SENSOR_GROUPS:
            return ["readmit: expected stop, or gyro or accelerometer, its number, and maybe anew"]
        if readmission.state == ReadmissionState.TESTING:
            return ["readmit: a sensor is being tested; 'readmit stop' ends that"]
        readmission.order_kind = kinds.index(arguments[0])
        readmission.order_sensor = int(arguments[1])
        readmission.order_anew = is_anew
        readmission.order_s = _TEST_S
        readmission.order = ReadmissionOrder.TEST
        return [f"requested, a test of {_TEST_S} s; 'redundancy' shows what comes of it"]

    def _switch_nmea(self, arguments: list[str]) -> list[str]:
        if self._nmea is None:
            return ["nmea: there is no NMEA port"]
        if arguments in (["on"], ["off"]):
            self._nmea.is_on = arguments == ["on"]
        elif arguments:
            return ["nmea: expected on or off"]
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
    "redundancy": readout.redundancy,
    "calibration": readout.calibration,
}
"""Commands that only read, by name."""

_HELP = (
    "status        mode, fault, position in the scheme, time, load",
    "nav           position, velocity, attitude",
    "sensors       measurements of each gyro and accelerometer in the last epoch",
    "axes          angle, rate, state and command of the turntable's axes",
    "faults        counters since power-on",
    "redundancy    parity of the sensors, which are left out, the test of one",
    "calibration   when the sensors were calibrated, and whether that still holds",
    "version       firmware version",
    "mode NAME     request standby, align, strapdown or rotating",
    "readmit gyro|accelerometer NUMBER [anew]",
    "              test a sensor that is left out, and use it again if it passes;",
    "              anew: with constants learned anew; 'readmit stop' ends the test",
    "nmea [on|off] show the NMEA output, or switch it on or off",
    "help          this list",
)
