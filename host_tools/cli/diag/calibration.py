"""`rrins diag calibration`: pull and push the calibration file; its age, and its drift."""

from __future__ import annotations

import os
import zlib
from pathlib import Path

import click

from rrins.firmware_py.diagnostics import calibration_image
from rrins.firmware_py.diagnostics.calibration_image import ImageError, Parameters
from rrins.firmware_py.diagnostics.redundancy_identifiers import CALIBRATION_STATUS
from rrins.host_tools.cli.diag.options import with_securing_tester, with_tester
from rrins.host_tools.cli.group import Group
from rrins.host_tools.cli.options import flag, json_option
from rrins.host_tools.cli.output import print_note, print_results
from rrins.host_tools.diag import calibration_file, calibration_status
from rrins.host_tools.diag.tester import Tester
from rrins.host_tools.errors import DiagError


@click.group(cls=Group)
def calibration() -> None:
    """Pull or push the calibration file, or show its age and whether it still holds."""


class _File(click.Path):
    """A path with a known file extension."""

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
            self.fail(f"{value}: the extension must be .toml or .rrca", param, ctx)
        return path


def _decoded(file: bytes) -> Parameters:
    try:
        return calibration_image.decode(file)
    except ImageError as error:
        raise DiagError(f"calibration pull: invalid calibration file received: {error}") from error


@calibration.command()
@click.argument("file", type=_File())
@flag("--settings", "Include the settings in a .toml file.")
@flag("--force", "Overwrite an existing file.")
@json_option
@with_tester
def pull(tester: Tester, file: Path, settings: bool, force: bool, as_json: bool) -> None:
    """Write the computer's calibration to a new FILE.

    A .toml file can also be passed to the firmware at startup. A .rrca file holds the raw bytes as
    the computer stores them, including all settings.
    """
    pulled = tester.pull()
    parameters = _decoded(pulled)
    is_raw = file.suffix == calibration_file.RAW
    text = calibration_file.to_toml(parameters, settings)
    calibration_file.write(file, pulled if is_raw else text.encode(), force)
    _print_summary("pulled", file, pulled, parameters, as_json)


@calibration.command()
@click.argument("file", type=_File())
@json_option
@with_securing_tester
def push(tester: Tester, file: Path, as_json: bool) -> None:
    """Write FILE to the computer's parameter memory; takes effect at the next reset.

    A .toml file changes what it names; a .rrca file replaces everything. A damaged file, or one
    with a value out of range, is rejected before anything is sent; the computer checks it again.
    """
    current = _decoded(tester.pull())
    parameters = calibration_file.read(file, current)
    pushed = calibration_image.encode(parameters)
    tester.push(pushed)
    kept = _decoded(tester.pull())
    if any(kept[number] != values for number, values in parameters.items()):
        raise DiagError("calibration push: the computer now holds other values; push again")
    _print_summary("pushed", file, pushed, parameters, as_json)
    print_note("takes effect at the next reset (`rrins diag reset`)")


@calibration.command()
@json_option
@with_tester
def show(tester: Tester, as_json: bool) -> None:
    """Show when the sensors were calibrated, how long ago, and whether the constants have drifted.

    The age is by this computer's clock: the navigation computer has none.
    """
    values = tester.read([CALIBRATION_STATUS])[CALIBRATION_STATUS.name]
    status = calibration_status.status_of(values)
    print_results(as_json, status, calibration_status.lines(status))


def _print_summary(
    done: str, file: Path, data: bytes, parameters: Parameters, as_json: bool
) -> None:
    crc = f"{zlib.crc32(data):08X}"
    result = {"file": str(file), done: len(data), "crc32": crc, "parameters": len(parameters)}
    text = f"{done}: {len(parameters)} parameters, {len(data)} bytes, CRC {crc}; {file}"
    print_results(as_json, result, [text])
