"""Both sides as FMUs (https://fmi-standard.org): units of co-simulation with machine code inside.

An FMU is an archive with a library and `modelDescription.xml`. Its library links the step of a side
with a shell in C: what FMI 2.0 and 3.0 share, and the interface of one of them.
"""

from __future__ import annotations

import hashlib
import shutil
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.version import VERSION
from rrins.host_tools.builds import toolchain
from rrins.host_tools.builds.entries import FIRMWARE_OUTBOX, HARDWARE_OUTBOX
from rrins.host_tools.builds.fmu_variables import (
    Effect,
    Variables,
    firmware_variables,
    hardware_variables,
)
from rrins.host_tools.builds.header import struct_name
from rrins.host_tools.builds.images import Images
from rrins.host_tools.builds.templates import rendered
from rrins.host_tools.files import replacing
from rrins.host_tools.hardware.memory import Plant
from rrins.host_tools.runs.set_up.settings import hardware_settings
from rrins.host_tools.scenario.scenario import Scenario

TARGET = "x86_64-linux"
_SYSTEM = "x86_64-linux-gnu"
"""With the C library of the program that loads it, and its mathematics."""
_PLATFORMS = {"2": "linux64", "3": "x86_64-linux"}
"""Folder of the library, by the first number of FMI's version."""
_SOURCES = ("fmu.c", "fmi2.c", "fmi3.c")
_FIRST_OUTPUT = 8
"""Value reference, as in `c/fmu.h`."""
_OPERATION_BYTES, _FRAMES = 24, 256
"""Bytes of a frame, and the most frames that a step takes."""
_LONG_AGO = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class _Side:
    name: str
    memory: str  #: in C
    outbox: int
    variables: Variables


def make_fmus(folder: Path, scenario: Scenario, name: str, images: Images) -> list[Path]:
    """Link the FMUs of a build, whose objects and headers are in its folder.

    Parameters
    ----------
    name : str
        The scenario's.

    Raises
    ------
    BuildError
        When they cannot be linked.
    """
    sides = (
        _Side(
            "firmware",
            struct_name("firmware", Ram),
            FIRMWARE_OUTBOX,
            firmware_variables(scenario, images),
        ),
        _Side(
            "hardware",
            struct_name("hardware", Plant),
            HARDWARE_OUTBOX,
            hardware_variables(hardware_settings(scenario)),
        ),
    )
    return [path for side in sides for path in _make(folder, side, scenario, name)]


def _make(folder: Path, side: _Side, scenario: Scenario, name: str) -> list[Path]:
    """Write a side's FMUs: both have the same library, which has both interfaces."""
    variables = side.variables
    digest = hashlib.sha256()
    for part in f"rrins_{side.name}.o", "rrins_images.o":
        digest.update((folder / part).read_bytes())
    values = {
        "side": side.name,
        "identifier": f"rrins_{side.name}",
        "token": digest.hexdigest(),
        "name": name,
        "version": VERSION,
        "period_s": 1 / scenario.rate_hz,
        "duration_s": scenario.duration_s,
        "most_bytes": _OPERATION_BYTES * _FRAMES,
        "outputs": list(enumerate(variables.outputs, _FIRST_OUTPUT)),
        "parameters": list(enumerate(variables.parameters, _FIRST_OUTPUT + len(variables.outputs))),
        "units": sorted({v.unit for v in (*variables.outputs, *variables.parameters)} - {""}),
    }
    library = _library(folder, side, _tables(side, values))
    files = []
    for version, platform in _PLATFORMS.items():
        description = rendered(f"fmi{version}.xml.j2", **values)
        files.append(folder / f"rrins_{side.name}.fmi{version}.fmu")
        with replacing(files[-1]) as made, zipfile.ZipFile(made, "w") as archive:
            for inside, content in (
                ("modelDescription.xml", description.encode("utf-8")),
                (f"binaries/{platform}/rrins_{side.name}.so", library),
            ):
                entry = zipfile.ZipInfo(inside, _LONG_AGO)
                entry.external_attr = 0o644 << 16
                archive.writestr(entry, content, zipfile.ZIP_DEFLATED)
    return files


def _library(folder: Path, side: _Side, tables: str) -> bytes:
    """Link a side's shared library."""
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        (work / "fmu_tables.h").write_text(tables, encoding="ascii")
        for source in ("fmu.h", *_SOURCES):
            with resources.as_file(resources.files(__package__) / "c" / source) as path:
                shutil.copyfile(path, work / source)
        made = work / "made.so"
        toolchain.zig(
            "cc", "-target", _SYSTEM, "-std=c11", "-O2", "-shared", "-fPIC", "-fvisibility=hidden",
            "-Wall", "-Wextra", "-Werror", "-Wl,-Bsymbolic", "-I", folder, "-I", work,
            *(work / source for source in _SOURCES),
            folder / f"rrins_{side.name}.o", folder / "rrins_images.o", "-lm", "-o", made,
        )  # fmt: skip
        return made.read_bytes()


def _tables(side: _Side, values: dict[str, object]) -> str:
    """Return what the shell knows of a side, in C."""
    variables = side.variables
    outputs = ", ".join(f"{{{v.offset}, {int(v.is_integer)}}}" for v in variables.outputs)
    starts = ", ".join((v.start or 0.0).hex() for v in variables.parameters)
    noises = ", ".join(map(str, variables.noises))
    return "\n".join(
        (
            f'#include "rrins_{side.name}.h"',
            *(["#define FMU_IS_HARDWARE"] if side.name == "hardware" else []),
            f'#define FMU_NAME "{values["identifier"]}"',
            f'#define FMU_TOKEN "{values["token"]}"',
            f"#define FMU_MEMORY struct {side.memory}",
            f"#define FMU_PERIOD_S {values['period_s']!r}",
            "enum {",
            f"    FMU_OUTBOX = {side.outbox}, FMU_BYTES = {values['most_bytes']},",
            f"    FMU_OUTPUTS = {len(variables.outputs)},",
            f"    FMU_PARAMETERS = {len(variables.parameters)},",
            f"    FMU_NOISES = {len(variables.noises)}",
            "};",
            "struct fmu_effect { uint32_t offset; int32_t parameter; double slope, base; };",
            "struct fmu_output { uint32_t offset; bool is_integer; };",
            "#ifdef FMU_WITH_TABLES",
            f"static const struct fmu_output outputs[] = {{{outputs}}};",
            f"static const double starts[] = {{{starts}}};",
            f"static const struct fmu_effect effects[] = {{{_effects(variables.effects)}}};",
            f"static const struct fmu_effect flags[] = {{{_effects(variables.flags)}}};",
            *([f"static const uint32_t noises[] = {{{noises}}};"] if noises else []),
            "#endif",
            "",
        )
    )


def _effects(effects: Sequence[Effect]) -> str:
    rows = [f"{{{e.offset}, {e.parameter}, {e.slope.hex()}, {e.base.hex()}}}" for e in effects]
    return ", ".join((*rows, "{0, -1, 0.0, 0.0}"))
