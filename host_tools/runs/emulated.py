"""A navigation computer on an emulated microcontroller, as a program on the bus.

``rrins rehearse --firmware qemu:navigator.elf`` runs this: it starts QEMU with what `rrins build
--target cortex-m7 --executable` has made, and passes epochs between the bus and the step there. The
processor's time is counted in instructions: QEMU gives each the same nanosecond.
"""

from __future__ import annotations

import argparse
import os
import select
import shutil
import statistics
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rrins.dbc.frame import Frame, FrameArray, frame_array
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.loop import INBOX_CAPACITY
from rrins.host_tools.bus.address import Address
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.runs.programs.program import EMULATED
from rrins.host_tools.runs.sides.job import open_port

MACHINE: Final = "mps2-an500"
"""QEMU's board with a Cortex-M7."""
_QEMU = "qemu-system-arm"
_POLL_MS = 200
_HEAD_IN, _HEAD_OUT = struct.Struct("<qII"), struct.Struct("<qIIII")
_TICK_INSTRUCTIONS = 40
"""The board's clock has 25 MHz, and an instruction takes a nanosecond."""
_MEGAHERTZ = 480
"""A usual clock of a Cortex-M7, for the load that is told."""


@dataclass(frozen=True)
class Answer:
    """The firmware's answer to an epoch."""

    epoch: int
    count: int  #: frames
    mode: int
    instructions: int


@dataclass(frozen=True)
class Spent:
    """The instructions that the steps of a run took."""

    median: float  #: instructions
    worst: int  #: instructions
    period_ns: int

    def __str__(self) -> str:
        share = 100.0 * self.worst / (_MEGAHERTZ * 1e-3 * self.period_ns)
        return (
            f"a step took {self.median:,.0f} instructions in the median, {self.worst:,} at most: "
            f"at an instruction a cycle and {_MEGAHERTZ} MHz {share:.1f} % of the period"
        )


class EmulatedComputer:
    """QEMU with the firmware's step, fed through two pipes.

    Parameters
    ----------
    process : Popen
        QEMU.
    feed, answers : int
        Descriptors of the pipes; that of the answers does not block.
    """

    def __init__(self, process: subprocess.Popen[bytes], feed: int, answers: int) -> None:
        self._process, self._feed, self._answers = process, feed, answers
        self._wait = select.poll()
        self._wait.register(answers, select.POLLIN)

    def step(self, inbox: FrameArray, count: int, arrival_ns: int, outbox: FrameArray) -> Answer:
        """Run an epoch on all of ``inbox[:count]``; its answer's frames come into `outbox`.

        Raises
        ------
        RehearsalError
            When the processor has stopped.
        """
        os.write(self._feed, _HEAD_IN.pack(arrival_ns, count, 1) + inbox[:count].tobytes())
        epoch, sent, _, ticks, mode = _HEAD_OUT.unpack(self._read(_HEAD_OUT.size))
        outbox[:sent] = Frame.from_bytes(self._read(sent * Frame.dtype.itemsize))
        return Answer(epoch, sent, mode, ticks * _TICK_INSTRUCTIONS)

    def _read(self, size: int) -> bytes:
        parts = b""
        while len(parts) < size:
            came = self._wait.poll(_POLL_MS)
            part = os.read(self._answers, size - len(parts)) if came else b""
            if not part and (came or self._process.poll() is not None):
                raise RehearsalError("the emulated processor has stopped")
            parts += part
        return parts


@contextmanager
def emulated(image: Path) -> Iterator[EmulatedComputer]:
    """Start QEMU with an image.

    Raises
    ------
    RehearsalError
        When there is no QEMU.
    """
    if shutil.which(_QEMU) is None:
        raise RehearsalError(f"{EMULATED}{image}: needs {_QEMU}, of Debian's qemu-system-arm")
    with ExitStack() as ends:
        folder = Path(ends.enter_context(tempfile.TemporaryDirectory(prefix="rrins-qemu-")))
        feed, answers = folder / "in", folder / "out"
        for pipe in feed, answers:
            os.mkfifo(pipe)
        semihosting = f"enable=on,target=native,arg=navigator,arg={feed},arg={answers}"
        came = os.open(answers, os.O_RDONLY | os.O_NONBLOCK)
        ends.callback(os.close, came)
        process = subprocess.Popen(
            [
                *(_QEMU, "-M", MACHINE, "-icount", "shift=0", "-nodefaults", "-nographic"),
                *("-kernel", str(image), "-semihosting-config", semihosting),
            ],
            stdin=subprocess.DEVNULL,
        )
        ends.callback(process.wait)
        ends.callback(process.kill)
        # Opened for both, it does not wait for QEMU, which may not come that far.
        to = os.open(feed, os.O_RDWR)
        ends.callback(os.close, to)
        yield EmulatedComputer(process, to, came)


def run(image: Path, setup: str, address: Address, attach_wait_s: float) -> Spent:
    """Be the firmware on a bus, in lockstep, until it is shut down.

    Parameters
    ----------
    image : Path
        Of `rrins build --target cortex-m7 --executable`.
    setup : str
        The set-up that the image must have been built for.

    Raises
    ------
    RehearsalError
        When it was built for another set-up, or stops.
    BusError
        When the bus cannot be reached, or ends.
    """
    try:
        is_same = setup.encode() in image.read_bytes()
    except OSError as error:
        raise RehearsalError(f"{image}: cannot be read: {error.strerror}") from error
    if not is_same:
        raise RehearsalError(f"{image}: built for another set-up: rrins build")
    (rate_hz,) = (
        int(line.split()[1]) for line in setup.splitlines() if line.startswith("rate_hz ")
    )
    period_ns = 1_000_000_000 // rate_hz
    inbox, outbox = frame_array(INBOX_CAPACITY), frame_array(INBOX_CAPACITY)
    instructions: list[int] = []
    with (
        closing(open_port(address, "firmware", attach_wait_s)) as port,
        emulated(image) as computer,
    ):
        port.meet()
        mode = Mode.POWER_ON
        while mode != Mode.SHUTDOWN:
            count = port.receive_epoch(inbox)
            arrival_ns = len(instructions) * period_ns
            answer = computer.step(inbox, count, arrival_ns, outbox)
            instructions.append(answer.instructions)
            mode = Mode(answer.mode)
            port.send(outbox, answer.count, answer.epoch, answer.epoch * period_ns)
    return Spent(statistics.median(instructions), max(instructions), period_ns)


def main(words: Sequence[str]) -> None:
    """Run as `docs/own-firmware.md` says that a program is called, behind the image's path."""
    parser = argparse.ArgumentParser(prog="rrins rehearse --firmware qemu:IMAGE")
    parser.add_argument("image", type=Path)
    parser.add_argument("--setup", type=Path, required=True)
    parser.add_argument("--interface", default="rrins")
    parser.add_argument("--channel", default="rrins0")
    parser.add_argument("--speed", default="max")
    parser.add_argument("--attach-wait", type=float, default=10.0)
    given = parser.parse_args(words)
    try:
        if given.speed != "max":
            raise RehearsalError("an emulated processor has no real time: --speed max")
        address = Address(given.interface, given.channel)
        print(run(given.image, given.setup.read_text(), address, given.attach_wait))
    except RehearsalError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main(sys.argv[1:])
