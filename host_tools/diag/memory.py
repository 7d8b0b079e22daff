"""`rrins diag memory`: the RAM image."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from firmware_py.diagnostics import table
from host_tools.diag import ram, show
from host_tools.diag.kinds import complete_memory
from host_tools.diag.options import json_option, with_tester
from host_tools.diag.tester import Tester
from host_tools.errors import DiagError

_SHOWN = 16  # values of a row


@click.group()
def memory() -> None:
    """Read the computer's RAM image."""


@memory.command("list")
@json_option
def list_regions(as_json: bool) -> None:
    """List the regions. Needs no bus."""
    regions = table.regions()
    if as_json:
        show.as_json(
            [{"name": one.name, "address": one.address, "size": one.size} for one in regions]
        )
        return
    grid = show.grid(("region", "address", "size"))
    for one in regions:
        grid.add_row(one.name, f"0x{one.address:06X}", str(one.size))
    show.put(grid)


def _number(text: str) -> int | None:
    try:
        return int(text, 0)
    except ValueError:
        return None


@memory.command("read")
@click.argument("where", metavar="PATH|ADDRESS", shell_complete=complete_memory)
@click.option("--size", type=click.IntRange(1), help="Bytes, from an ADDRESS.")
@click.option("--hex", "as_hex", is_flag=True, help="Show bytes, not fields.")
@click.option(
    "--out", type=click.Path(dir_okay=False, path_type=Path), help="Write the bytes to a new file."
)
@json_option
@with_tester
def read_memory(
    tester: Tester, where: str, size: int | None, as_hex: bool, out: Path | None, as_json: bool
) -> None:
    """Read a part of the RAM image.

    PATH is a region or a field in it (sequencer.target_angle_deg.0), ADDRESS an offset (0x16B1,
    with --size). More than 4000 bytes are read in several requests, each at an epoch of its own.
    """
    address = _number(where)
    if (address is None) != (size is None):
        raise click.UsageError("--size goes with an ADDRESS, and only with that")
    if address is not None and size is not None:
        name, length, part = f"0x{address:06X}", size, None
    else:
        try:
            part = ram.part_of(where.removesuffix("."))
        except ram.MemoryPathError as error:
            raise click.UsageError(str(error)) from error
        name, address, length = part.name, part.address, part.size
    assert address is not None
    data = tester.read_memory(address, length)
    if out is not None:
        _write(out, data)
    told: dict[str, Any] = {"address": address, "size": length, "hex": data.hex()}
    fields = dict(ram.leaves(part, data)) if part is not None else {}
    if as_json:
        show.as_json({name: told | {"fields": fields}})
    elif out is not None:
        show.line(f"{length} bytes from 0x{address:06X} are in {out}")
    elif as_hex or part is None:
        for text in ram.dump(address, data):
            show.line(text)
    else:
        grid = show.grid(("field", "value"))
        for path, value in fields.items():
            grid.add_row(path, _shown(value))
        show.put(grid)


def _shown(value: Any) -> str:
    if not isinstance(value, list):
        return f"{value:.12g}" if isinstance(value, float) else str(value)
    texts = [_shown(one) for one in value[:_SHOWN]]
    more = f", … {len(value)} in all" if len(value) > _SHOWN else ""
    return f"[{', '.join(texts)}{more}]"


def _write(path: Path, data: bytes) -> None:
    try:
        with path.open("xb") as file:
            file.write(data)
    except FileExistsError as error:
        raise DiagError(f"--out {path}: is there already; name another file") from error
    except OSError as error:
        raise DiagError(f"--out {path}: cannot be written: {error.strerror}") from error
