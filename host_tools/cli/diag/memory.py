"""`rrins diag memory`: read the RAM image."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click
from rich.table import Table

from rrins.firmware_py.diagnostics import table as diagnostic_table
from rrins.host_tools.cli.diag.arguments import complete_memory
from rrins.host_tools.cli.diag.options import with_tester
from rrins.host_tools.cli.diag.output import grid
from rrins.host_tools.cli.group import Group
from rrins.host_tools.cli.options import FILE, flag, json_option, option
from rrins.host_tools.cli.output import counting, print_results
from rrins.host_tools.diag import ram
from rrins.host_tools.diag.tester import Tester
from rrins.host_tools.errors import DiagError
from rrins.host_tools.files import JsonObject

_MOST_VALUES = 16  # values of an array


@click.group(cls=Group)
def memory() -> None:
    """Read the computer's RAM image."""


@memory.command("list")
@json_option
def list_regions(as_json: bool) -> None:
    """List the regions. Needs no bus."""
    regions = diagnostic_table.regions()
    table = grid("region", "address", "size")
    for one in regions:
        table.add_row(one.name, f"0x{one.address:06X}", str(one.size))
    values = [{"name": one.name, "address": one.address, "size": one.size} for one in regions]
    print_results(as_json, values, [table])


def _number(text: str) -> int | None:
    try:
        return int(text, 0)
    except ValueError:
        return None


@memory.command("read")
@click.argument("where", metavar="PATH|ADDRESS", shell_complete=complete_memory)
@option("--size", "Number of bytes to read from ADDRESS.", click.IntRange(1))
@flag("--hex as_hex", "Show bytes, not fields.")
@option("--out", "Write the bytes to a new file.", FILE)
@json_option
@with_tester
def read_memory(
    tester: Tester, where: str, size: int | None, as_hex: bool, out: Path | None, as_json: bool
) -> None:
    """Read part of the RAM image.

    PATH is a region or a field in it (sequencer.target_angle_deg.0); ADDRESS is an offset (0x16B1)
    and needs --size. More than 4000 bytes take several requests, each at a different epoch: all of
    `ram` takes minutes in real time, so read the region that is wanted (`rrins diag memory list`).
    """
    address = _number(where)
    if (address is None) != (size is None):
        raise click.UsageError("an ADDRESS needs --size, and a PATH does not accept it")
    if address is not None and size is not None:
        name, length, part = f"0x{address:06X}", size, None
    else:
        try:
            part = ram.part_of(where.removesuffix("."))
        except ram.MemoryPathError as error:
            raise click.UsageError(str(error)) from error
        name, address, length = part.name, part.address, part.size
    assert address is not None
    with counting(f"reading {name}", length, as_json) as on_progress:
        data = tester.read_memory(address, length, on_progress)
    if out is not None:
        _write(out, data)
    summary: JsonObject = {"address": address, "size": length, "hex": data.hex()}
    fields = dict(ram.leaves(part, data)) if part is not None else {}
    parts: Sequence[Table | str]
    if out is not None:
        parts = [f"{length} bytes from 0x{address:06X} written to {out}"]
    elif as_hex or part is None:
        parts = list(ram.dump(address, data))
    else:
        rows = grid("field", "value")
        for path, value in fields.items():
            rows.add_row(path, _value_text(value))
        parts = [rows]
    print_results(as_json, {name: summary | {"fields": fields}}, parts)


def _value_text(value: object) -> str:
    if not isinstance(value, list):
        return f"{value:.12g}" if isinstance(value, float) else str(value)
    texts = [_value_text(one) for one in value[:_MOST_VALUES]]
    more = f", … {len(value)} in total" if len(value) > _MOST_VALUES else ""
    return f"[{', '.join(texts)}{more}]"


def _write(path: Path, data: bytes) -> None:
    try:
        with path.open("xb") as file:
            file.write(data)
    except FileExistsError as error:
        raise DiagError(f"--out {path}: already exists; choose another file") from error
    except OSError as error:
        raise DiagError(f"--out {path}: cannot be written: {error.strerror}") from error
