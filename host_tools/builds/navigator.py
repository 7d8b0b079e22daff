"""The navigation computer as a program for Linux: the firmware's step within a shell in C.

The shell is that of the example `examples/own_firmware`: embedded bus and SocketCAN, lockstep and
real time. The program is static: it needs neither Python nor a library.
"""

from __future__ import annotations

import shutil
from importlib import resources
from pathlib import Path

from rrins.host_tools.builds import toolchain
from rrins.host_tools.builds.targets import Target
from rrins.host_tools.files import make_folder, replacing

NAME = "navigator"
_SOURCES = ("main.c", "port.c", "navigator.c", "rrins_bus.c")
_HEADERS = ("firmware.h", "port.h", "rrins_bus.h")


def link(folder: Path, target: Target) -> Path:
    """Link the program of a build; its sources are in the folder `c` there.

    Raises
    ------
    BuildError
        When it cannot be linked.
    """
    sources = folder / "c"
    make_folder(sources)
    for name in (*_SOURCES, *_HEADERS):
        with resources.as_file(resources.files(__package__) / "c" / name) as path:
            shutil.copyfile(path, sources / name)
    program = folder / NAME
    with replacing(program) as made:
        toolchain.zig(
            "cc", "-target", target.system, "-std=c11", "-O2", "-static", "-I", folder,
            *(sources / name for name in _SOURCES),
            folder / "rrins_firmware.o", folder / "rrins_images.o", "-lm", "-o", made,
        )  # fmt: skip
    return program
