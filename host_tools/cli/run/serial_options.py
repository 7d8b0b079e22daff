"""Command-line options of the firmware's serial lines."""

from __future__ import annotations

from datetime import UTC, datetime

import click

from rrins.firmware_py.serial.port import PortName, SerialPortError, parse_port
from rrins.firmware_py.serial.settings import DEFAULT_UTC, SENTENCE_NAMES, SerialSettings
from rrins.host_tools.cli.options import gathered, option, together

NMEA_BAUD = 38400
"""That of NMEA 0183-HS; the standard 4800 is too slow for a set at 2 Hz."""

CONSOLE_BAUD = 115200


class _Port(click.ParamType[PortName]):
    """A serial device, a pseudo-terminal, or a file."""

    name = "PORT"

    def __init__(self, default_baud: int, takes_files: bool) -> None:
        self._default_baud = default_baud
        self._takes_files = takes_files

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> PortName:
        if isinstance(value, PortName):
            return value
        try:
            port = parse_port(str(value), self._default_baud)
        except SerialPortError as error:
            self.fail(str(error), param, ctx)
        if port.kind == "file" and not self._takes_files:
            self.fail("the console needs a serial device or a pseudo-terminal", param, ctx)
        return port


class _Utc(click.ParamType[datetime]):
    """A UTC date and time, ISO 8601."""

    name = "TIME"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> datetime:
        if isinstance(value, datetime):
            return value
        try:
            time = datetime.fromisoformat(str(value))
        except ValueError:
            self.fail(f"{value!r} is not a time such as 2026-01-01T00:00:00Z", param, ctx)
        time = time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)
        if not 1980 <= time.year < 2080:
            self.fail(f"{value}: the year must be from 1980 to 2079", param, ctx)
        return time


class _Sentences(click.ParamType[tuple[str, ...]]):
    """Comma-separated names of sentences."""

    name = "NAME,…"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        if isinstance(value, tuple):
            return value
        names = tuple(str(value).upper().replace(" ", "").split(","))
        for name in names:
            if name not in SENTENCE_NAMES:
                self.fail(f"{name!r} is not one of {', '.join(SENTENCE_NAMES)}", param, ctx)
        return names


_nmea = together(
    option(
        "--nmea",
        "NMEA 0183 output to DEVICE[:BAUD], pty[:LINK] or file:PATH.",
        _Port(NMEA_BAUD, takes_files=True),
    ),
    option("--nmea-rate nmea_rate_hz", "Sets of sentences per second.", click.IntRange(1, 10), 1),
    option("--nmea-sentences", "Sentences in a set.", _Sentences(), ",".join(SENTENCE_NAMES)),
    option("--utc", "UTC time of epoch 0, for NMEA.", _Utc(), f"{DEFAULT_UTC:%Y-%m-%dT%H:%M:%SZ}"),
)
_console = option(
    "--console",
    "Text console on DEVICE[:BAUD] or pty[:LINK].",
    _Port(CONSOLE_BAUD, takes_files=False),
)
nmea_options = gathered("serial", SerialSettings, _nmea)
"""The options of the NMEA output."""
serial_options = gathered("serial", SerialSettings, _nmea, _console)
"""The options of the NMEA output and of the console."""
