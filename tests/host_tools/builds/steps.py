"""The steps of a build, called from Python as C would, beside Python's own."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rrins.dbc.frame import Frame, frame_array
from rrins.firmware_py.core.frames_in.clock import own_clock_ns
from rrins.firmware_py.core.step import firmware_step
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.builds import toolchain
from rrins.host_tools.builds.build import Build
from rrins.host_tools.builds.entries import FIRMWARE_OUTBOX, HARDWARE_OUTBOX
from rrins.host_tools.builds.targets import TARGETS
from rrins.host_tools.builds.variants import shortened
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.step import hardware_step
from rrins.host_tools.runs.exchange import answer_epoch
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario


def shared_library(built: Build, folder: Path) -> ctypes.CDLL:
    """Return the objects of a build for this processor, loaded."""
    path = folder / "steps.so"
    objects = sorted(built.folder.glob("*.o"))
    # -O2: the libraries that zig compiles on its first use are then those that the FMUs need.
    words = "-target", "x86_64-linux-gnu", "-O2", "-shared", "-o"
    toolchain.zig("cc", *words, path, *objects, "-lm")
    return ctypes.CDLL(str(path))


def _at(memory: Any) -> ctypes.c_void_p:
    return ctypes.c_void_p(memory.ctypes.data)


def first_difference(
    scenario: Scenario, built: Build, library: ctypes.CDLL, epochs: int
) -> str | None:
    """Run both sides by Python's steps and by a build's; say where they first differ.

    By the steps alone: what Python does between two of them is no part of the objects.
    """
    firmware, hardware = (
        Firmware(firmware_settings(scenario)),
        Hardware(hardware_settings(scenario)),
    )
    images = built.images
    ram, plant = images.ram.copy(), images.plant.copy()
    for memory in ram, plant:
        memory.view("u1")[:] = 0xA5
    library.rrins_firmware_power_on(_at(ram))
    library.rrins_hardware_power_on(_at(plant))
    up, down = frame_array(HARDWARE_OUTBOX), frame_array(FIRMWARE_OUTBOX)
    error_ppm = scenario.firmware.clock_error_ppm
    sent = count = 0
    for epoch in range(epochs):
        for memory in ram, firmware.ram:
            memory["clock"]["sync_arrival_ns"] = own_clock_ns(epoch * firmware.period_ns, error_ppm)
            memory["clock"]["is_whole"] = True
        came = hardware_step(
            hardware.plant, hardware.pieces, firmware.contract, firmware.outbox, count,
            hardware.outbox,
        )  # fmt: skip
        count = firmware_step(
            firmware.ram, firmware.contract, hardware.outbox, 0, came, firmware.outbox,
            firmware.compares, firmware.estimates,
        )  # fmt: skip
        received = library.rrins_hardware_step(
            _at(plant), _at(images.motion), len(images.motion), _at(images.contract),
            _at(down), sent, _at(up),
        )  # fmt: skip
        sent = library.rrins_firmware_step(
            _at(ram), _at(images.contract), _at(up), received, _at(down)
        )
        if down[:sent].tobytes() != firmware.outbox[:count].tobytes():
            return f"frames of epoch {epoch}"
    if ram.tobytes() != shortened(firmware.ram, ram.dtype).tobytes():
        return "the firmware's memory"
    return None if plant.tobytes() == hardware.plant.tobytes() else "the hardware's memory"


_WASI = """
const { WASI } = require("node:wasi"), { readFileSync } = require("node:fs");
const [path] = process.argv.slice(1);
const wasi = new WASI({ version: "preview1", args: process.argv.slice(1) });
WebAssembly.instantiate(readFileSync(path), wasi.getImportObject()).then(
  ({ instance }) => wasi.start(instance),
);
"""
EMULATORS: dict[str, tuple[str, ...]] = {
    "x86_64-linux": (),
    "aarch64-linux": ("qemu-aarch64",),
    "armv7-linux": ("qemu-arm",),
    "riscv64-linux": ("qemu-riscv64",),
    "wasm32": ("node", "--no-warnings", "-e", _WASI),
}
"""Words before a program for a target that make it run here."""
_BLOCK = 1000


def program(built: Build) -> list[str]:
    """Return words that start a program with both steps of a build; its epochs are to follow."""
    path = built.folder / "frames"
    toolchain.zig(
        "cc", "-target", TARGETS[built.target].system, "-std=c11", "-O2", "-static",
        "-I", built.folder, Path(__file__).with_name("frames.c"),
        *sorted(built.folder.glob("*.o")), "-lm", "-o", path,
    )  # fmt: skip
    return [*EMULATORS[built.target], str(path)]


def frames_that_differ(
    scenario: Scenario, programs: Sequence[list[str]], epochs: int
) -> tuple[int, int]:
    """Run both sides by Python's functions and by programs, which have to send the same.

    Returns how many frames there were, and how many of the programs' were not Python's.
    """
    assert scenario.firmware.clock_error_ppm == 0.0
    running = [
        subprocess.Popen([*words, str(epochs)], stdout=subprocess.PIPE) for words in programs
    ]
    firmware, hardware = (
        Firmware(firmware_settings(scenario)),
        Hardware(hardware_settings(scenario)),
    )
    up, contract = hardware.outbox, firmware.contract
    frames = differing = count = 0
    expected = bytearray()
    for epoch in range(epochs):
        sent = hardware_step(hardware.plant, hardware.pieces, contract, firmware.outbox, count, up)
        count = answer_epoch(firmware, up, sent, epoch)
        expected += up[:sent].tobytes() + firmware.outbox[:count].tobytes()
        if epoch % _BLOCK < _BLOCK - 1 and epoch < epochs - 1:
            continue
        outputs = {_output(process, len(expected)) for process in running}
        assert len(outputs) == 1, f"programs differ from each other before epoch {epoch}"
        theirs, ours = (np.frombuffer(each, Frame.dtype) for each in (outputs.pop(), expected))
        frames += len(ours)
        differing += int(np.count_nonzero(theirs != ours))
        expected = bytearray()
    for process in running:
        process.communicate()
    return frames, differing


def _output(process: subprocess.Popen[bytes], size: int) -> bytes:
    assert process.stdout is not None
    return process.stdout.read(size)
