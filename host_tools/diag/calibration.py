"""`rrins diag calibration`: the calibration file."""

from __future__ import annotations

import os
import zlib
from pathlib import Path

import click

from firmware_py.diagnostics import image
from firmware_py.diagnostics.image import ImageError, Parameters
from host_tools.diag import calibration_file, show
from host_tools.diag.options import json_option, with_securing_tester, with_tester
from host_tools.diag.tester import Tester
from host_tools.errors import DiagError


@click.group()
def calibration() -> None:
    """Pull the calibration file from the computer, or push one."""


class _File(click.Path):
    """A path with one of the endings that are known."""

    def __init__(self) -> None:
        super().__init__(dir_okay=False, path_type=Path)

    def convert(
        self,
        value: str | os.PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> Path:
        path = Path(str(value))
        if path.suffix not in (calibration_file.TOML, calibration_file.RAW):
            self.fail(f"{value}: ends neither with .toml nor with .rrca", param, ctx)
        return path


def _decoded(file: bytes) -> Parameters:
    try:
        return image.decode(file)
    except ImageError as error:
        raise DiagError(f"calibration pull: what came is no calibration file: {error}") from error


@calibration.command()
@click.argument("file", type=_File())
@click.option("--settings", is_flag=True, help="With the settings, not the sensors only; of .toml.")
@click.option("--force", is_flag=True, help="Replace a file that is there.")
@json_option
@with_tester
def pull(tester: Tester, file: Path, settings: bool, force: bool, as_json: bool) -> None:
    """Write the computer's calibration into a new FILE.

    .toml: what the firmware can be given at start, too. .rrca: the bytes that the computer keeps,
    with all settings.
    """
    pulled = tester.pull()
    parameters = _decoded(pulled)
    is_raw = file.suffix == calibration_file.RAW
    text = calibration_file.to_toml(parameters, settings)
    calibration_file.write(file, pulled if is_raw else text.encode(), force)
    _tell("pulled", file, pulled, parameters, as_json)


@calibration.command()
@click.argument("file", type=_File())
@json_option
@with_securing_tester
def push(tester: Tester, file: Path, as_json: bool) -> None:
    """Put a FILE into the computer's parameter memory; in force from the next reset on.

    A .toml changes what it names, a .rrca replaces everything. A file that is damaged or has a
    value beyond its limits is refused before anything is sent; the computer checks it once more.
    """
    current = _decoded(tester.pull())
    parameters = calibration_file.read(file, current)
    pushed = image.encode(parameters)
    tester.push(pushed)
    kept = _decoded(tester.pull())
    if any(kept[number] != values for number, values in parameters.items()):
        raise DiagError("calibration push: the computer has something else now; push again")
    _tell("pushed", file, pushed, parameters, as_json)
    show.note("in force from the next reset on (`rrins diag reset`)")


def _tell(done: str, file: Path, data: bytes, parameters: Parameters, as_json: bool) -> None:
    if as_json:
        show.as_json(
            {
                "file": str(file),
                done: len(data),
                "crc32": f"{zlib.crc32(data):08X}",
                "parameters": len(parameters),
            }
        )
    else:
        show.line(
            f"{done}: {len(parameters)} parameters, {len(data)} bytes, CRC {zlib.crc32(data):08X}; "
            f"{file}"
        )
