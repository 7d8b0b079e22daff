"""The firmware's serial lines: NMEA output and console, called by a shell at their epochs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from firmware_py.console import Console
from firmware_py.loop import Firmware
from firmware_py.nmea import DEFAULT_UTC, SENTENCES, Fix, encode, fix_of
from firmware_py.serial_port import PortName, SerialPort, SerialPortError, open_port

CONSOLE_HZ = 50
"""How often the console looks for what has been typed."""

BITS_A_BYTE = 10
"""On a serial line: start bit, eight data bits, stop bit."""

Note = Callable[[str], None]
"""Called with a line that the user is to see."""


@dataclass(frozen=True)
class SerialSettings:
    """Which serial lines there are.

    Attributes
    ----------
    nmea, console : PortName or None
    nmea_rate_hz : int
        Sets of sentences a second; the firmware's rate is a multiple of it.
    nmea_sentences : tuple of str
        Names out of `firmware_py.nmea.SENTENCES`.
    utc : datetime
        The time that epoch 0 stands for, in UTC.
    """

    nmea: PortName | None = None
    nmea_rate_hz: int = 1
    nmea_sentences: tuple[str, ...] = tuple(SENTENCES)
    utc: datetime = DEFAULT_UTC
    console: PortName | None = None


NO_LINES = SerialSettings()
"""No serial line at all."""


class NmeaOutput:
    """Sends a set of sentences every so many epochs.

    Parameters
    ----------
    firmware : Firmware
    port : SerialPort
    settings : SerialSettings
    every : int
        Epochs from one set to the next.

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

    def take(self) -> None:
        """Send the set of this epoch, as far as the port has room for it."""
        if not self.is_on:
            return
        if self.port.is_attached():
            self.port.offer(encode(fix_of(self._ram, self._utc), self._names))
        else:
            self.port.unread += len(self._names)

    def describe(self) -> str:
        """Return where it goes and what became of it, in one line."""
        port = self.port
        state = ("on" if self.is_on else "off") if port.is_open else "lost"
        counts = f"sent {port.sent}, dropped {port.dropped}, unread {port.unread}"
        return f"nmea {state}: {port.name}, {counts}"


def _epochs_between(firmware: Firmware, rate_hz: int) -> int:
    """Return the epochs from one set of sentences to the next."""
    firmware_hz = 1_000_000_000 // firmware.period_ns
    if firmware_hz % rate_hz:
        fits = ", ".join(str(hz) for hz in range(1, 11) if firmware_hz % hz == 0)
        raise SerialPortError(
            f"--nmea-rate {rate_hz}: {firmware_hz} Hz is no multiple of it; take one of {fits}"
        )
    return firmware_hz // rate_hz


def _overload(settings: SerialSettings) -> str | None:
    """Return what to tell a user whose NMEA line is too slow for what is to go over it."""
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
        Told the names of the ports, and later which one was lost.

    Attributes
    ----------
    every : int
        Epochs after which `take` is to be called; 0 when there is no line.

    Raises
    ------
    SerialPortError
        When a port cannot be opened, or the rates do not fit.
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

    def take(self, epoch: int) -> None:
        """Do what is due in an epoch, a multiple of `every`."""
        if self._nmea is not None and epoch % self._nmea.every == 0:
            self._nmea.take()
        if self._console is not None and epoch % self._console_every == 0:
            self._console.poll()

    def statistics(self) -> dict[str, Any]:
        """Return what became of the lines, in plain values, as `serial`; empty without lines."""
        found: dict[str, Any] = {}
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
