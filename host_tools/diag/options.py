"""Options of the commands, and the tester that they work with."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click

from firmware_py.diagnostics.access import DEFAULT_SECRET
from host_tools.diag.target import DEFAULT_CHANNEL, DEFAULT_TIMEOUT_S, Target
from host_tools.diag.tester import Tester
from host_tools.errors import DiagError

_BUS = (
    click.option(
        "--interface", default="rrins", show_default=True, help="python-can interface name."
    ),
    click.option("--channel", help=f"Channel of the interface.  [default: {DEFAULT_CHANNEL}]"),
    click.option("--bitrate", type=click.IntRange(1), help="For interfaces that set it."),
    click.option(
        "--transport",
        type=click.Choice(("library", "kernel")),
        default="library",
        show_default=True,
        help="Who does ISO-TP: can-isotp on any bus, or the kernel's sockets on socketcan.",
    ),
    click.option(
        "--timeout",
        "timeout_s",
        type=click.FloatRange(min=0, min_open=True),
        default=DEFAULT_TIMEOUT_S,
        show_default=True,
        help="Seconds that an answer may take.",
    ),
)
_BUS_NAMES = ("interface", "channel", "bitrate", "transport", "timeout_s")
_SECURITY = (
    click.option("--security", is_flag=True, help="Unlock what changes the computer."),
    click.option(
        "--secret-file",
        type=click.Path(dir_okay=False, path_type=Path),
        envvar="RRINS_SECRET_FILE",
        help="File with the computer's secret, where it has one of its own.",
    ),
)

json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")


def _secret(path: Path | None) -> bytes:
    if path is None:
        return DEFAULT_SECRET
    try:
        return path.read_bytes().strip()
    except OSError as error:
        raise DiagError(f"--secret-file {path}: cannot be read: {error.strerror}") from error


@contextlib.contextmanager
def _opened(
    ctx: click.Context, bus: dict[str, Any], security: bool, secret_file: Path | None
) -> Iterator[Tester]:
    """Yield the shell's tester, or one for this command only."""
    kept = ctx.find_object(Tester)
    if kept is None:
        with Tester(Target(**bus), security, _secret(secret_file)) as tester:
            yield tester
        return
    for name in (*bus, "secret_file"):
        if ctx.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE:
            option = "--" + name.removesuffix("_s").replace("_", "-")
            raise click.UsageError(f"{option} is an option of the shell itself")
    kept.is_securing |= security
    yield kept


def _with_tester(
    options: tuple[Callable[..., Any], ...], command: Callable[..., Any]
) -> Callable[..., Any]:
    @click.pass_context
    @functools.wraps(command)
    def run(ctx: click.Context, /, **given: Any) -> Any:
        security, secret_file = given.pop("security", False), given.pop("secret_file", None)
        bus = {name: given.pop(name) for name in _BUS_NAMES}
        with _opened(ctx, bus, security, secret_file) as tester:
            return command(tester, **given)

    decorated: Callable[..., Any] = run
    for option in reversed(options):
        decorated = option(decorated)
    return decorated


def with_tester(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of the bus, and a `Tester` as its first argument."""
    return _with_tester(_BUS, command)


def with_securing_tester(command: Callable[..., Any]) -> Callable[..., Any]:
    """Likewise, with the options of SecurityAccess."""
    return _with_tester((*_SECURITY, *_BUS), command)
