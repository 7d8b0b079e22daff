"""The firmware's serial lines: NMEA output and console, run by a shell at their epochs."""

from __future__ import annotations

import math
from collections.abc import Callable

from rrins.firmware_py.loop import Firmware
from rrins.firmware_py.serial.console import Console
from rrins.firmware_py.serial.nmea import Fix, encode, fix_of
from rrins.firmware_py.serial.port import SerialPort, SerialPortError, open_port
from rrins.firmware_py.serial.settings import SerialSettings

CONSOLE_HZ = 50
"""How often the console polls for input."""

BITS_A_BYTE = 10
"""On a serial line: start bit, eight data bits, stop bit."""

Note = Callable[[str], None]
"""Called with a line for the user."""

LineStatistics = dict[str, str | int]
"""Port and counters of a serial line."""


class NmeaOutput:
    """Sends a set of sentences periodically.

    Parameters
    ----------
    firmware : Firmware
    port : SerialPort
    settings : SerialSettings
    every : int
        Epochs between sets.

    Attributes
    ----------
    is_on : bool
    """

    def __init__(
        self, firmware: Firmware, port: SerialPort, settings: SerialSettings, every: int
    ) -> None:
        self._ram = firmware.ram
        self._utc = settings.utc
        self._names = settings.nmea_sentences
        self.port = port
        self.every = every
        self.is_on = True

    def write_sentences(self) -> None:
        """Send this epoch's set, as far as the port has room."""
        if not self.is_on:
            return
        if self.port.is_attached():
            self.port.offer(encode(fix_of(self._ram, self._utc), self._names))
        else:
            self.port.unread += len(self._names)

    def describe(self) -> str:
        """Return its port and its counters, in one line."""
        port = self.port
        state = ("on" if self.is_on else "off") if port.is_open else "lost"
        counts = f"sent {port.sent}, dropped {port.dropped}, unread {port.unread}"
        return f"nmea {state}: {port.name}, {counts}"


def _epochs_between(firmware: Firmware, rate_hz: int) -> int:
    """Return the number of epochs between sets of sentences."""
    firmware_hz = 1_000_000_000 // firmware.period_ns
    if firmware_hz % rate_hz:
        fits = ", ".join(str(hz) for hz in range(1, 11) if firmware_hz % hz == 0)
        raise SerialPortError(
            f"--nmea-rate {rate_hz}: {firmware_hz} Hz is not a multiple of it; use one of {fits}"
        )
    return firmware_hz // rate_hz


def _overload(settings: SerialSettings) -> str | None:
    """Return a warning if the NMEA line is too slow for its sentences, else None."""
    port = settings.nmea
    if port is None or port.kind != "device":
        return None
    longest = Fix(settings.utc, True, -89.0, -179.0, -9999.0, 2999.0, 0.5, -179.0, -89.0, 0.5)
    size = sum(len(each) for each in encode(longest, settings.nmea_sentences))
    needed = size * settings.nmea_rate_hz * BITS_A_BYTE
    if needed <= port.baud:
        return None
    return (
        f"{port.text}: {size} bytes {settings.nmea_rate_hz} times a second need {needed} baud; "
        "sentences will be dropped"
    )


class SerialLines:
    """The open serial lines of a firmware.

    Parameters
    ----------
    settings : SerialSettings
    firmware : Firmware
    note : callable
        Called with the names of the ports, and later with the port that was lost.

    Attributes
    ----------
    every : int
        Epochs between calls of `run`; 0 without lines.

    Raises
    ------
    SerialPortError
        When a port cannot be opened, or the rates are incompatible.
    """

    def __init__(self, settings: SerialSettings, firmware: Firmware, note: Note) -> None:
        self._nmea: NmeaOutput | None = None
        self._console: Console | None = None
        self._console_port: SerialPort | None = None
        self._console_every = max(1, 1_000_000_000 // firmware.period_ns // CONSOLE_HZ)
        self.every = 0
        try:
            self._open(settings, firmware, note)
        except BaseException:
            self.close()
            raise

    def _open(self, settings: SerialSettings, firmware: Firmware, note: Note) -> None:
        if settings.nmea is not None:
            self.every = _epochs_between(firmware, settings.nmea_rate_hz)
            port = open_port(settings.nmea, note)
            self._nmea = NmeaOutput(firmware, port, settings, self.every)
            note(f"NMEA on {port.name}, {settings.nmea_rate_hz} Hz")
            overload = _overload(settings)
            if overload is not None:
                note(overload)
        if settings.console is not None:
            self._console_port = open_port(settings.console, note)
            self._console = Console(firmware, self._console_port, self._nmea)
            self.every = math.gcd(self.every, self._console_every)
            note(f"console on {self._console_port.name}")

    def run(self, epoch: int) -> None:
        """Do what is due in an epoch that is a multiple of `every`."""
        if self._nmea is not None and epoch % self._nmea.every == 0:
            self._nmea.write_sentences()
        if self._console is not None and epoch % self._console_every == 0:
            self._console.poll()

    def statistics(self) -> dict[str, dict[str, LineStatistics]]:
        """Return the counters of the lines as plain values under `serial`; empty without lines."""
        found: dict[str, LineStatistics] = {}
        if self._nmea is not None:
            port = self._nmea.port
            found["nmea"] = {
                "port": port.name,
                "sent": port.sent,
                "dropped": port.dropped,
                "unread": port.unread,
            }
        if self._console is not None and self._console_port is not None:
            found["console"] = {
                "port": self._console_port.name,
                "commands": self._console.commands,
            }
        return {"serial": found} if found else {}

    def close(self) -> None:
        """Close the ports. Idempotent."""
        if self._nmea is not None:
            self._nmea.port.close()
        if self._console_port is not None:
            self._console_port.close()
