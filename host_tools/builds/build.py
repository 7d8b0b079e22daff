"""Builds a scenario for a target: objects, library, headers, images, and what tells of them."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from cantools.database.can.c_source import generate
from llvmlite import binding as llvm

from rrins.compiled.code_folder import sources
from rrins.compiled.object_code import optimised
from rrins.compiled.record import Record
from rrins.dbc.codec import load
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.turntable.table_sums import TableSums
from rrins.firmware_py.version import VERSION
from rrins.host_tools.builds import fmu, image_code, navigator, toolchain
from rrins.host_tools.builds.code import object_of
from rrins.host_tools.builds.entries import FIRMWARE_OUTBOX, HARDWARE_OUTBOX, entries_of
from rrins.host_tools.builds.header import header, struct_name
from rrins.host_tools.builds.images import Images
from rrins.host_tools.builds.targets import TARGETS, Target
from rrins.host_tools.builds.templates import rendered
from rrins.host_tools.errors import BuildError
from rrins.host_tools.files import make_folder, replacing, write_text
from rrins.host_tools.hardware.memory import Plant
from rrins.host_tools.scenario.scenario import Scenario

UNITS = ("firmware", "hardware")
"""Each is an object of its own."""
LIBRARY = "librrins.a"
MANIFEST = "manifest.json"


@dataclass(frozen=True)
class Build:
    """The files of a build, and their sizes.

    Attributes
    ----------
    folder : Path
    target : str
        A key of `TARGETS`.
    images : Images
    files : tuple of Path
        All that was written, the manifest last.
    code_bytes, constant_bytes : dict
        Size of each object's code and of its constants, by unit.
    """

    folder: Path
    target: str
    images: Images
    files: tuple[Path, ...]
    code_bytes: dict[str, int]
    constant_bytes: dict[str, int]

    @property
    def memory_bytes(self) -> dict[str, int]:
        """Size of each unit's memory."""
        return {"firmware": self.images.ram.nbytes, "hardware": self.images.plant.nbytes}


def build(
    scenario: Scenario,
    name: str,
    target: str,
    folder: Path,
    on_note: Callable[[str], None] = lambda text: None,
    executable: bool = False,
    fmus: bool = False,
) -> Build:
    """Build the steps of a scenario for a target.

    Parameters
    ----------
    name : str
        The scenario's, for those who read what is written.
    target : str
        A key of `TARGETS`.
    folder : Path
        Made if it is not there; files of the same names are replaced.
    on_note : callable
        Told what is being done.
    executable : bool
        Whether to link the firmware's step into a program, too: a navigation computer.
    fmus : bool
        Whether to link both sides into units of co-simulation, too.

    Raises
    ------
    BuildError
        When there is no machine code or no library.
    RehearsalError
        When a file of the scenario cannot be used, or the folder not be written.
    """
    if executable and target == "wasm32":
        raise BuildError(f"{target} has no programs of its own: rrins dashboard --static")
    if fmus and target != fmu.TARGET:
        raise BuildError(f"FMUs are built for {fmu.TARGET} only")
    needs_zig = fmus or (executable and not toolchain.links_own_programs(TARGETS[target].system))
    if needs_zig:
        toolchain.check()
    images = Images.of(scenario)
    make_folder(folder)
    files = [folder / f"rrins_{name}.o" for name in (*UNITS, "images")]
    for unit, path in zip(UNITS, files, strict=False):
        on_note(f"{unit}: compiling for {target}")
        with replacing(path) as made:
            made.write_bytes(object_of(unit, images.variant, target))
    with replacing(files[-1]) as made:
        made.write_bytes(_images_object(images, TARGETS[target]))
    if toolchain.is_installed():
        on_note("linking")
        library = folder / LIBRARY
        with replacing(library) as made:
            toolchain.archive(made, files)
        files.append(library)
    else:
        on_note(f"no {LIBRARY}: that needs pip install 'rrins[build]'")
    texts = _headers(images) | _frames() | {"README.md": _readme(name, target, images)}
    for file, text in texts.items():
        write_text(folder / file, text)
        files.append(folder / file)
    sizes = {unit: _sizes(folder / f"rrins_{unit}.o") for unit in UNITS}
    if executable:
        on_note("the navigation computer")
        files.append(navigator.link(folder, TARGETS[target], images))
    if fmus:
        on_note("units of co-simulation")
        files += fmu.make_fmus(folder, scenario, name, images)
    manifest = folder / MANIFEST
    write_text(
        manifest, json.dumps(_manifest(scenario, name, target, images, files), indent=2) + "\n"
    )
    return Build(
        folder,
        target,
        images,
        (*files, manifest),
        {unit: code for unit, (code, _) in sizes.items()},
        {unit: constants for unit, (_, constants) in sizes.items()},
    )


def _images_object(images: Images, target: Target) -> bytes:
    """Return the object of the memories at power-on."""
    text = "\n".join(
        (
            image_code.constant("rrins_contract", images.contract.tobytes()),
            image_code.constant("rrins_hello", images.hello.tobytes()),
            image_code.constant("rrins_setup", images.setup.encode("ascii")),
            image_code.number("rrins_setup_bytes", len(images.setup)),
            image_code.constant("rrins_motion", images.motion.tobytes()),
            image_code.number("rrins_motion_pieces", len(images.motion)),
            image_code.DECLARATIONS,
            image_code.power_on("rrins_firmware_power_on", images.ram.tobytes()),
            image_code.power_on("rrins_hardware_power_on", images.plant.tobytes()),
        )
    )
    return optimised(text, target.processor).emit_object()


def _headers(images: Images) -> dict[str, str]:
    """Return the headers of both sides by file name."""
    rate_hz = round(1e9 / int(images.ram[0]["parameters"]["period_ns"]))
    memories: dict[str, tuple[type[Record], np.dtype[np.void], int]] = {
        "firmware": (Ram, images.ram.dtype, FIRMWARE_OUTBOX),
        "hardware": (Plant, images.plant.dtype, HARDWARE_OUTBOX),
    }
    return {
        f"rrins_{side}.h": header(
            side,
            memory,
            dtype,
            {
                "RRINS_RATE_HZ": rate_hz,
                f"RRINS_{side.upper()}_OUTBOX": outbox,
                **{f"RRINS_MODE_{mode.name}": mode.value for mode in Mode},
            },
            entries_of(side, images.variant),
            (TableSums,) if side == "firmware" else (),
        )
        for side, (memory, dtype, outbox) in memories.items()
    }


def _frames() -> dict[str, str]:
    """Return the messages of the contract in C, as cantools writes them."""
    name = "rrins"
    written, source, *_ = generate(load().database, name, f"{name}.h", f"{name}.c", "")
    return {f"{name}.h": written, f"{name}.c": source}


def _readme(name: str, target: str, images: Images) -> str:
    return rendered(
        "readme.md.j2",
        target=target,
        system=TARGETS[target].system,
        text=TARGETS[target].text,
        name=name,
        memory=struct_name("firmware", Ram),
        ram_bytes=images.ram.nbytes,
        version=VERSION,
    )


def _sizes(path: Path) -> tuple[int, int]:
    """Return the size of an object's code and of its constants, bytes."""
    code = constants = 0
    for section in llvm.ObjectFileRef.from_data(path.read_bytes()).sections():
        name = section.name() or b""
        if section.is_text():
            code += section.size()
        elif name.startswith((b".rodata", b".data")):
            constants += section.size()
    return code, constants


def _manifest(
    scenario: Scenario, name: str, target: str, images: Images, files: list[Path]
) -> dict[str, object]:
    """Return what the build is made of, and digests of all files."""
    processor = TARGETS[target].processor
    return {
        "version": VERSION,
        "scenario": name,
        "rate_hz": scenario.rate_hz,
        "target": target,
        "triple": processor.triple,
        "cpu": processor.cpu,
        "features": processor.features,
        "sources": sources().digest,
        "compiler": {
            "numba": importlib.metadata.version("numba"),
            "llvmlite": importlib.metadata.version("llvmlite"),
            "LLVM": ".".join(map(str, llvm.llvm_version_info)),
        },
        "variant": vars(images.variant),
        "memory_bytes": {"firmware": images.ram.nbytes, "hardware": images.plant.nbytes},
        "sha256": {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files},
    }
