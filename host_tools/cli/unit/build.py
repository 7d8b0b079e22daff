"""`rrins build`: the steps as machine code for another processor."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.completion import complete_scenarios
from rrins.host_tools.cli.options import FOLDER, json_option, option
from rrins.host_tools.cli.output import print_results

if TYPE_CHECKING:
    from rich.table import Table

    from rrins.host_tools.builds.build import Build

_TARGETS = (
    "x86_64-linux", "aarch64-linux", "armv7-linux", "riscv64-linux", "cortex-m7", "wasm32",
)  # fmt: skip


@click.command()
@click.argument("scenario", default="rimu_rotating", shell_complete=complete_scenarios)
@option("--target", "Processor and system.", click.Choice(_TARGETS), "x86_64-linux")
@option("--out", "Folder for what is built.", FOLDER, Path("out/build"))
@click.option("--executable", is_flag=True, help="Link a navigation computer, too.")
@click.option("--fmu", is_flag=True, help="Link both sides as FMUs, FMI 2.0 and 3.0, too.")
@click.option("--size", is_flag=True, help="Show what of the memory is for what.")
@json_option
def build(
    scenario: str, target: str, out: Path, executable: bool, fmu: bool, size: bool, as_json: bool
) -> None:
    """Build the firmware and the hardware of a SCENARIO as machine code.

    Writes objects, a static library, C headers of the records and of the bus, both memories at
    power-on, a manifest, and a README.md with the C around them. The steps are the rehearsed ones:
    they send the same frames. With --executable also a static program without Python, for SocketCAN
    and the embedded bus: copy it to a board, or rehearse it with --firmware. With --fmu also both
    sides as units of co-simulation for other simulators.
    """
    from rrins.host_tools.builds.build import build as build_steps
    from rrins.host_tools.scenario.scenario import load

    done = build_steps(load(scenario), Path(scenario).stem, target, out, _note, executable, fmu)
    values = {
        "folder": str(done.folder),
        "target": done.target,
        "files": [path.name for path in done.files],
        "code_bytes": done.code_bytes,
        "constant_bytes": done.constant_bytes,
        "memory_bytes": done.memory_bytes,
    }
    tables = [_sizes(done), *([_memory(done)] if size else [])]
    print_results(as_json, values, [*tables, str(done.folder / "README.md")])


def _note(text: str) -> None:
    click.echo(text, err=True)


def _sizes(done: Build) -> Table:
    from rrins.host_tools.terminal import new_table

    table = new_table(None, "step", "code, kB", "constants, kB", "memory, kB")
    for unit, memory in done.memory_bytes.items():
        sizes = done.code_bytes[unit], done.constant_bytes[unit], memory
        table.add_row(unit, *(f"{size / 1000:.1f}" for size in sizes))
    return table


def _memory(done: Build) -> Table:
    from rrins.host_tools.builds.sizes import sizes_of
    from rrins.host_tools.terminal import new_table

    table = new_table(None, "the firmware's memory", "kB")
    for name, size in sizes_of(done.images.ram.dtype):
        table.add_row(name, f"{size / 1000:.1f}")
    return table
