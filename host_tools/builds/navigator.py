"""The navigation computer as a program: the firmware's step within a shell in C.

The shell for Linux is that of the example `examples/own_firmware`: embedded bus and SocketCAN,
lockstep and real time. The program is static: it needs neither Python nor a library. Linked by the
compiler of the machine that it is for, it has the mathematics that Python uses there. For a
microcontroller it is an image without an operating system, which QEMU runs.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

from rrins.host_tools.builds import diagnostic_tables, toolchain
from rrins.host_tools.builds.diagnostic_constants import header
from rrins.host_tools.builds.images import Images
from rrins.host_tools.builds.targets import Target
from rrins.host_tools.files import make_folder, replacing, write_text

_BOARD = "cortex_m7"
_SOURCES = ("main.c", "port.c", "navigator.c", "rrins_bus.c")
_DIAGNOSTICS = "diagnostics"
STRICT = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror", "-ffp-contract=off")
"""Fused operations would round otherwise than Python does."""
_HEADERS = ("firmware.h", "port.h", "rrins_bus.h")


def link(folder: Path, target: Target, images: Images) -> Path:
    """Link the program of a build; its sources are in the folder `c` there.

    Raises
    ------
    BuildError
        When it cannot be linked.
    """
    sources = folder / "c"
    names: tuple[str, ...]
    make_folder(sources)
    if target.has_linux:
        names, program = write_sources(sources, images), folder / "navigator"
        words = list(STRICT)
    else:
        names, program = (f"{_BOARD}.c",), folder / "navigator.elf"
        script = f"{_BOARD}.ld"
        words = ["-static", f"-mcpu={_BOARD}", "-T", str(sources / script)]
        _copy((*names, script), sources)
    with replacing(program) as made:
        toolchain.link(
            target.system, "-std=c11", "-O2", *words, "-I", folder, "-I", sources,
            *(sources / name for name in names),
            folder / "rrins_firmware.o", folder / "rrins_images.o", "-lm", "-o", made,
        )  # fmt: skip
    return program


def write_sources(folder: Path, images: Images) -> tuple[str, ...]:
    """Write the program's C, and the table that its diagnostics answer by; return the names."""
    make_folder(folder)
    _copy((*_SOURCES, *_HEADERS), folder)
    shared = diagnostic_tables.segments(images.ram.dtype)
    choices = diagnostic_tables.choices_of(images)
    write_text(folder / "rrins_diagnostics.h", header(images, len(choices), len(shared)))
    write_text(folder / "rrins_diagnostics.c", diagnostic_tables.source(images, choices))
    names = sorted(
        entry.name for entry in (resources.files(__package__) / "c" / _DIAGNOSTICS).iterdir()
    )
    _copy(names, folder, _DIAGNOSTICS)
    sources = (name for name in names if name.endswith(".c"))
    return (*_SOURCES, *sources, "rrins_diagnostics.c")


def _copy(names: Sequence[str], folder: Path, within: str = "") -> None:
    for name in names:
        with resources.as_file(resources.files(__package__) / "c" / within / name) as path:
            shutil.copyfile(path, folder / name)
