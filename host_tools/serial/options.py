"""Command-line options of the firmware's serial lines."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

import click

from firmware_py.nmea import DEFAULT_UTC, SENTENCES
from firmware_py.serial_lines import SerialSettings
from firmware_py.serial_port import PortName, SerialPortError, parse_port

NMEA_BAUD = 38400
"""Of NMEA 0183-HS; the plain 4800 is too slow for a set at 2 Hz."""

CONSOLE_BAUD = 115200


class _Port(click.ParamType[PortName]):
    """A serial device, a pseudo-terminal, or a file."""

    name = "PORT"

    def __init__(self, default_baud: int, takes_files: bool) -> None:
        self._default_baud = default_baud
        self._takes_files = takes_files

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> PortName:
        if isinstance(value, PortName):
            return value
        try:
            port = parse_port(value, self._default_baud)
        except SerialPortError as error:
            self.fail(str(error), param, ctx)
        if port.kind == "file" and not self._takes_files:
            self.fail("a console wants a serial device or a pseudo-terminal", param, ctx)
        return port


class _Utc(click.ParamType[datetime]):
    """A time of day and date in UTC, ISO 8601."""

    name = "TIME"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> datetime:
        if isinstance(value, datetime):
            return value
        try:
            time = datetime.fromisoformat(value)
        except ValueError:
            self.fail(f"{value!r} is no time such as 2026-01-01T00:00:00Z", param, ctx)
        time = time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)
        if not 1980 <= time.year < 2080:
            self.fail(f"{value}: the two digits of the year mean 1980 to 2079", param, ctx)
        return time


class _Sentences(click.ParamType[tuple[str, ...]]):
    """Names of sentences, with commas between them."""

    name = "NAME,…"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        if isinstance(value, tuple):
            return value
        names = tuple(value.upper().replace(" ", "").split(","))
        for name in names:
            if name not in SENTENCES:
                self.fail(f"{name!r} is none of {', '.join(SENTENCES)}", param, ctx)
        return names


_NMEA_OPTIONS = (
    click.option(
        "--nmea",
        type=_Port(NMEA_BAUD, takes_files=True),
        help="NMEA 0183 output to DEVICE[:BAUD], pty[:LINK] or file:PATH.",
    ),
    click.option(
        "--nmea-rate",
        "nmea_rate_hz",
        type=click.IntRange(1, 10),
        default=1,
        show_default=True,
        help="Sets of sentences a second.",
    ),
    click.option(
        "--nmea-sentences",
        type=_Sentences(),
        default=",".join(SENTENCES),
        show_default=True,
        help="What is in a set.",
    ),
    click.option(
        "--utc",
        type=_Utc(),
        default=f"{DEFAULT_UTC:%Y-%m-%dT%H:%M:%SZ}",
        show_default=True,
        help="Time of epoch 0, for NMEA.",
    ),
)
_CONSOLE_OPTION = click.option(
    "--console",
    type=_Port(CONSOLE_BAUD, takes_files=False),
    help="Line console on DEVICE[:BAUD] or pty[:LINK].",
)


def nmea_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of the NMEA output."""
    for option in reversed(_NMEA_OPTIONS):
        command = option(command)
    return command


def serial_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of the NMEA output and of the console."""
    return nmea_options(_CONSOLE_OPTION(command))


def settings_of(options: dict[str, Any]) -> SerialSettings:
    """Take the serial options out of a command's and return what they mean."""
    names = ("nmea", "nmea_rate_hz", "nmea_sentences", "utc", "console")
    return SerialSettings(**{name: options.pop(name) for name in names if name in options})


def arguments_of(settings: SerialSettings) -> tuple[str, ...]:
    """Return the command line that stands for the settings."""
    arguments: list[str] = []
    if settings.nmea is not None:
        arguments += ["--nmea", settings.nmea.text, "--nmea-rate", str(settings.nmea_rate_hz)]
        arguments += ["--nmea-sentences", ",".join(settings.nmea_sentences)]
        arguments += ["--utc", settings.utc.isoformat()]
    if settings.console is not None:
        arguments += ["--console", settings.console.text]
    return tuple(arguments)
