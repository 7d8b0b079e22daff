"""The processors and systems that the steps can be built for."""

from __future__ import annotations

from dataclasses import dataclass

from rrins.compiled.object_code import Processor


@dataclass(frozen=True)
class Target:
    """A processor with its system.

    Attributes
    ----------
    processor : Processor
    system : str
        As `zig cc -target` names it, with its C library.
    text : str
        What it is, in a few words.
    has_linux : bool
        Whether programs with sockets and a clock run there.
    """

    processor: Processor
    system: str
    text: str
    has_linux: bool = True


TARGETS = {
    "x86_64-linux": Target(
        Processor("x86_64-linux-gnu", "x86-64"), "x86_64-linux-musl", "PCs and servers"
    ),
    "aarch64-linux": Target(
        Processor("aarch64-linux-gnu", "generic"),
        "aarch64-linux-musl",
        "64-bit ARM boards, such as a Raspberry Pi 3 to 5",
    ),
    "armv7-linux": Target(
        Processor("armv7-unknown-linux-gnueabihf", "generic", "+vfp3,+d32,+neon", True, True),
        "arm-linux-musleabihf",
        "32-bit ARM boards with floating point, such as a BeagleBone",
    ),
    "riscv64-linux": Target(
        Processor("riscv64-linux-gnu", "generic-rv64", "+m,+a,+f,+d,+c"),
        "riscv64-linux-musl",
        "64-bit RISC-V boards",
    ),
    "cortex-m7": Target(
        Processor("thumbv7em-none-eabi", "cortex-m7", "", False, True),
        "thumb-linux-musleabi",
        "microcontrollers with double precision",
        False,
    ),
    "wasm32": Target(
        Processor("wasm32-unknown-unknown", "", "", False),
        "wasm32-wasi",
        "browsers and other WebAssembly hosts",
        False,
    ),
}
"""By the name that `--target` takes."""
