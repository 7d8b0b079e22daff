"""How commands declare options, and the options that several commands share."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrins.host_tools.cli.completion import complete_scenarios
from rrins.host_tools.drawing.saving import FORMATS, pictures_as

if TYPE_CHECKING:
    from rrins.host_tools.bus.address import Address

Command = Callable[..., Any]
"""A function that click turns into a command."""

Option = Callable[[Command], Command]
"""A decorator that adds one or more options to a command."""

DEFAULT_SCENARIO = "rimu_rotating"
EMBEDDED = "rrins"
DEFAULT_CHANNEL = "rrins0"

PATH = click.Path(path_type=Path)
FILE = click.Path(dir_okay=False, path_type=Path)
FOLDER = click.Path(file_okay=False, path_type=Path)


class Number(click.FloatRange):
    """A finite number within limits; `nan` is beyond any limit."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class Picture(click.Path):
    """A file for a picture, in the format that its ending names."""

    def __init__(self) -> None:
        super().__init__(dir_okay=False, path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return the path."""
        path = Path(str(super().convert(value, param, ctx)))
        if path.suffix.lower().removeprefix(".") not in FORMATS:
            self.fail(f"{str(value)!r} ends in none of .{', .'.join(FORMATS)}", param, ctx)
        return path


class Speed(click.ParamType[float | None]):
    """1 for real time; another factor, or `max` for none."""

    name = "1|N|max"

    def __init__(self, least: float = 0.0) -> None:
        self._least = least

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float | None:
        """Return the factor."""
        if value == "max" or value is None:
            return None
        try:
            speed = float(value)
        except ValueError:
            self.fail(f"{value!r} is neither a number nor 'max'", param, ctx)
        if not 0 < speed < 1e9 or speed < self._least:
            self.fail(f"{value} is not greater than {self._least:g}", param, ctx)
        return speed


NOT_NEGATIVE = Number(min=0)
POSITIVE = Number(min=0, min_open=True)


def option(names: str, help: str, kind: Any = None, default: Any = None, **more: Any) -> Option:
    """Return an option.

    Parameters
    ----------
    names : str
        Its flag, then the name of the command's parameter if it differs.
    help : str
        Line of the help.
    kind : optional
        Type; a sequence of words is a choice.
    default : optional
        Default, which the help shows.
    **more : optional
        As for `click.option`.
    """
    if isinstance(kind, Sequence):
        kind = click.Choice(kind)
    if default is not None:
        more = {"default": default, "show_default": True} | more
    return click.option(*names.split(), type=kind, help=help, **more)


def flag(names: str, help: str) -> Option:
    """Return an option without a value."""
    return click.option(*names.split(), is_flag=True, help=help)


def many(names: str, help: str, metavar: str | None = None, kind: Any = None) -> Option:
    """Return an option that can be repeated."""
    return option(names, help, kind, metavar=metavar, multiple=True)


def together(*options: Option) -> Option:
    """Return one decorator that applies several, in order."""

    def decorate(command: Command) -> Command:
        for one in reversed(options):
            command = one(command)
        return command

    return decorate


def gathered(name: str, kind: type, *options: Option) -> Option:
    """Return options whose values reach the command as one argument: a dataclass of this kind."""
    keys = [field.name for field in fields(kind)]

    def decorate(command: Command) -> Command:
        @functools.wraps(command)
        def run(*arguments: Any, **given: Any) -> Any:
            values = {key: given.pop(key) for key in keys if key in given}
            return command(*arguments, **given, **{name: kind(**values)})

        return together(*options)(run)

    return decorate


@dataclass(frozen=True)
class Bus:
    """The bus as the options name it."""

    interface: str
    channel: str | None
    bitrate: int | None

    def __str__(self) -> str:
        named = self.channel or (DEFAULT_CHANNEL if self.interface == EMBEDDED else None)
        return self.interface if named is None else f"{self.interface}:{named}"

    def address(self) -> Address:
        """Return the bus; on the embedded one without a channel, `DEFAULT_CHANNEL`."""
        from rrins.host_tools.runs.side import address_of

        return address_of(self.interface, self.channel, self.bitrate)


BIT_RATE = click.IntRange(1, 1_000_000_000)
PORT = click.IntRange(0, 65_535)

interface_option = option("--interface", "python-can interface name.", None, EMBEDDED)
bitrate_option = option("--bitrate", "Bit rate, if the interface sets it.", BIT_RATE)
channel_option = option("--channel", f"Channel of the interface.  [default: {DEFAULT_CHANNEL}]")
bus_options = together(interface_option, channel_option, bitrate_option)
bus_option = gathered("bus", Bus, bus_options)
embedded_channel_option = option("--channel", "Channel of the embedded bus.", None, DEFAULT_CHANNEL)
timestamps_option = option(
    "--timestamps",
    "Time of frames of the embedded bus: simulated, or seconds since 1970.",
    ("bus", "unix"),
    "bus",
)
json_option = flag("--json as_json", "Print one JSON object.")

scenario_argument = click.argument(
    "scenario", default=DEFAULT_SCENARIO, metavar="[SCENARIO]", shell_complete=complete_scenarios
)
duration_option = option("--duration duration_s", "Navigate for this many seconds.", POSITIVE)
free_duration_option = option("--duration duration_s", "Navigate for this many seconds.", float)
"""Checked by the scenario."""
noise_seed_option = option("--seed", "Seed of the sensor noise.", int)


def _choose_format(context: click.Context, _: click.Parameter, form: str) -> None:
    context.with_resource(pictures_as(form))


format_option = option(
    "--format", "Format of the pictures.", FORMATS, FORMATS[0], expose_value=False,
    callback=_choose_format,
)  # fmt: skip
"""Of every command that writes pictures with names of its own."""

results_option = together(
    option("--out", "Folder for the results.  [default: out/SCENARIO]", FOLDER), format_option
)
record_option = option("--record", "Record the bus to this file.", FILE)

rimu_option = option(
    "--rimu geometry", "Built-in geometry, or TOML file with the sensor axes.", metavar="GEOMETRY"
)


workers_option = option(
    "--workers", "Threads.  [default: one for each processor]", click.IntRange(1, 4096)
)


def seed_option(of_what: str) -> Option:
    """Return the option for a seed that is 1 if not given."""
    return option("--seed", f"Seed of {of_what}.", click.IntRange(0), 1)
