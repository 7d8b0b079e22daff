"""`rrins diag memory`: read the RAM image."""

from __future__ import annotations

from pathlib import Path

import click

from rrins.firmware_py.diagnostics import table
from rrins.host_tools.cli.diag.arguments import complete_memory
from rrins.host_tools.cli.diag.options import with_tester
from rrins.host_tools.cli.diag.output import new_table, print_json, print_line, print_table
from rrins.host_tools.cli.group import Group
from rrins.host_tools.cli.options import json_option
from rrins.host_tools.diag import ram
from rrins.host_tools.diag.tester import Tester
from rrins.host_tools.errors import DiagError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.terminal import new_console, progress_line

_MOST_VALUES = 16  # values of an array


@click.group(cls=Group)
def memory() -> None:
    """Read the computer's RAM image."""


@memory.command("list")
@json_option
def list_regions(as_json: bool) -> None:
    """List the regions. Needs no bus."""
    regions = table.regions()
    if as_json:
        print_json(
            [{"name": one.name, "address": one.address, "size": one.size} for one in regions]
        )
        return
    grid = new_table(("region", "address", "size"))
    for one in regions:
        grid.add_row(one.name, f"0x{one.address:06X}", str(one.size))
    print_table(grid)


def _number(text: str) -> int | None:
    try:
        return int(text, 0)
    except ValueError:
        return None


@memory.command("read")
@click.argument("where", metavar="PATH|ADDRESS", shell_complete=complete_memory)
@click.option("--size", type=click.IntRange(1), help="Number of bytes to read from ADDRESS.")
@click.option("--hex", "as_hex", is_flag=True, help="Show bytes, not fields.")
@click.option(
    "--out", type=click.Path(dir_okay=False, path_type=Path), help="Write the bytes to a new file."
)
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
    with progress_line(new_console(stderr=True), as_json) as progress:
        task = progress.add_task(f"reading {name}", total=length)
        data = tester.read_memory(
            address, length, lambda done: progress.update(task, completed=done)
        )
    if out is not None:
        _write(out, data)
    summary: JsonObject = {"address": address, "size": length, "hex": data.hex()}
    fields = dict(ram.leaves(part, data)) if part is not None else {}
    if as_json:
        print_json({name: summary | {"fields": fields}})
    elif out is not None:
        print_line(f"{length} bytes from 0x{address:06X} written to {out}")
    elif as_hex or part is None:
        for text in ram.dump(address, data):
            print_line(text)
    else:
        grid = new_table(("field", "value"))
        for path, value in fields.items():
            grid.add_row(path, _value_text(value))
        print_table(grid)


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
