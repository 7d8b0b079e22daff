"""Options of the diagnostic commands, and the tester that they use."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from rrins.firmware_py.diagnostics.access import DEFAULT_SECRET
from rrins.host_tools.cli.options import (
    FILE,
    POSITIVE,
    Command,
    Option,
    bus_options,
    flag,
    option,
    together,
)
from rrins.host_tools.diag.target import DEFAULT_TIMEOUT_S, Target
from rrins.host_tools.diag.tester import Tester
from rrins.host_tools.errors import DiagError
from rrins.host_tools.files import content_of

_LARGEST_SECRET = 1 << 16  # bytes

_bus_options = together(
    bus_options,
    option(
        "--transport",
        "ISO-TP by can-isotp on any bus, or by kernel sockets on socketcan.",
        ("library", "kernel"),
        "library",
    ),
    option("--timeout timeout_s", "Response timeout in seconds.", POSITIVE, DEFAULT_TIMEOUT_S),
)
_BUS_NAMES = ("interface", "channel", "bitrate", "transport", "timeout_s")
_security_options = together(
    flag("--security", "Unlock protected services (SecurityAccess)."),
    option(
        "--secret-file",
        "File with the computer's secret, if not the default.",
        FILE,
        envvar="RRINS_SECRET_FILE",
    ),
)


def _secret(path: Path | None) -> bytes:
    if path is None:
        return DEFAULT_SECRET
    try:
        return content_of(path, _LARGEST_SECRET).strip()
    except OSError as error:
        raise DiagError(f"--secret-file {path}: cannot be read: {error.strerror}") from error


@contextlib.contextmanager
def _opened(
    ctx: click.Context, bus: dict[str, Any], security: bool, secret_file: Path | None
) -> Iterator[Tester]:
    """Yield the shell's tester, or a new one for this command."""
    kept = ctx.find_object(Tester)
    if kept is None:
        with Tester(Target(**bus), security, _secret(secret_file)) as tester:
            yield tester
        return
    for name in (*bus, "secret_file"):
        if ctx.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE:
            option = "--" + name.removesuffix("_s").replace("_", "-")
            raise click.UsageError(f"{option} belongs to the shell command itself")
    kept.conversation.is_securing |= security
    yield kept


def _with_tester(options: Option, command: Command) -> Command:
    @click.pass_context
    @functools.wraps(command)
    def run(ctx: click.Context, /, **given: Any) -> None:
        security, secret_file = given.pop("security", False), given.pop("secret_file", None)
        bus = {name: given.pop(name) for name in _BUS_NAMES}
        with _opened(ctx, bus, security, secret_file) as tester:
            command(tester, **given)

    return options(run)


def with_tester(command: Command) -> Command:
    """Add the bus options to a command, and pass it a `Tester` as its first argument."""
    return _with_tester(_bus_options, command)


def with_securing_tester(command: Command) -> Command:
    """Do the same as `with_tester`, and add the options of SecurityAccess."""
    return _with_tester(together(_security_options, _bus_options), command)
