"""The user's own program as a side of a rehearsal: how it is called, and how it ended.

It is given what `docs/own-firmware.md` says: the bus, the speed, a file with its set-up. It reports
nothing but what it sends on the bus; what it prints goes into a file.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rrins.host_tools.bus.address import Address, Side
from rrins.host_tools.bus.channel import socket_path
from rrins.host_tools.errors import RehearsalError, SideLostError
from rrins.host_tools.runs.programs import keeper
from rrins.host_tools.runs.set_up.setup_file import write_setup
from rrins.host_tools.scenario.scenario import Scenario

EMULATED: Final = "qemu:"
"""A program that begins so is an image for an emulated microcontroller."""
_EMULATOR = "rrins.host_tools.runs.emulated"
SAID_BYTES: Final = 4096
"""Of what a program has printed last, read for the reason of its end."""
GRACE_S: Final = 5.0
"""For a process of ours to end after SIGTERM, before it gets SIGKILL."""
PROGRAM_GRACE_S: Final = 1.0
"""For a user's program: whoever stops a rehearsal waits no longer than two seconds."""
LOG_BYTES: Final = 16_000_000
"""Of one file of what a program prints; the one before is kept."""


class ProgramProcess(subprocess.Popen[bytes]):
    """A program, kept by a small process that leaves nothing of it running (`keeper`).

    It is waited for like the program itself, and ends as that did. Signals go to the program.

    Parameters
    ----------
    words : sequence of str
        The program and its options.
    log : Path
        For what it prints: the last `LOG_BYTES` to twice as many.
    keep_open : sequence of int
        Descriptors that stay open until all is over; the program does not have them.

    Attributes
    ----------
    program_pid : int
        Number of the program's process; it has a session of its own.

    Raises
    ------
    OSError
        If it cannot be started.
    """

    def __init__(self, words: Sequence[str], log: Path, keep_open: Sequence[int]) -> None:
        kept = [keeper.__file__, f"{PROGRAM_GRACE_S:g}", str(log), str(LOG_BYTES), *words]
        super().__init__(
            [sys.executable, "-I", "-S", *kept],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            pass_fds=keep_open,
            start_new_session=True,
        )
        assert self.stdout is not None
        with self.stdout as first_words:
            said = first_words.readline().decode().strip()
        if not said.isdigit():
            self.wait()
            raise OSError(None, said or "the process that keeps it has ended")
        self.program_pid = int(said)

    def send_signal(self, number: int) -> None:
        """Send a signal to the program and its children, unless it has ended."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.program_pid, number)

    def close(self) -> None:
        """Kill the program, if it still runs, and wait for its end. Idempotent."""
        self.kill()
        self.wait()
        assert self.stdin is not None
        self.stdin.close()


@dataclass(frozen=True)
class Program:
    """A program and the words that it is always called with."""

    words: tuple[str, ...]  #: the program, as a path, and its own options
    title: str = ""  #: what it is called if not by its file

    @classmethod
    def parse(cls, text: str) -> Program:
        """Return the program of a command line, such as ``"./own_firmware --verbose"``.

        ``"qemu:navigator.elf"`` is an image of `rrins build`, run by `emulated`.

        Raises
        ------
        RehearsalError
            If there is no such program, or it cannot be executed.
        """
        try:
            words = shlex.split(text)
        except ValueError as error:
            raise RehearsalError(f"{text}: not a command line: {error}") from error
        if not words:
            raise RehearsalError("no program is named")
        if words[0].startswith(EMULATED):
            image = Path(words[0].removeprefix(EMULATED)).absolute()
            if not image.is_file():
                raise RehearsalError(f"{words[0]}: there is no such image: rrins build")
            return cls((sys.executable, "-m", _EMULATOR, str(image), *words[1:]))
        found = shutil.which(words[0])
        if found is None:
            why = "is not executable" if Path(words[0]).exists() else "there is no such program"
            raise RehearsalError(f"{words[0]}: {why}")
        return cls((str(Path(found).absolute()), *words[1:]))

    @property
    def name(self) -> str:
        """Its title, or else the name of its file."""
        return self.title or Path(self.words[0]).name

    def __str__(self) -> str:
        return shlex.join(self.words)

    def write_setup(self, path: Path, scenario: Scenario) -> None:
        """Write the set-up that the program is given."""
        write_setup(path, scenario)

    def start(
        self,
        scenario: Scenario,
        address: Address,
        speed: str,
        attach_wait_s: float,
        folder: Path,
        keep_open: Sequence[int] = (),
        side: Side = "firmware",
        again: bool = False,
    ) -> ProgramProcess:
        """Start the program, in a session of its own, which ends with this process.

        Parameters
        ----------
        address : Address
            The bus; of the embedded one the program is given the socket's path.
        speed : str
            ``"1"`` is real time, anything else lockstep.
        attach_wait_s : float
            How long it is to wait for the bus.
        folder : Path
            Where its set-up goes (`setup.txt`), and what it prints (`firmware.txt`, or
            `hardware.txt`).
        keep_open : sequence of int
            Descriptors that stay open until it and its descendants have ended.
        side : {"firmware", "hardware"}
            In whose place it is.
        again : bool
            Whether it has run before: what it prints is added to what it has printed.

        Raises
        ------
        RehearsalError
            If it cannot be started.
        """
        setup, said = folder / "setup.txt", said_path(folder, side)
        self.write_setup(setup, scenario)
        channel = str(socket_path(address.channel)) if address.is_embedded else address.channel
        words = [
            *self.words,
            *("--setup", str(setup), "--interface", address.interface, "--channel", channel),
            *("--speed", "1" if speed == "1" else "max", "--attach-wait", f"{attach_wait_s:g}"),
        ]
        if not again:
            said.unlink(missing_ok=True)
        try:
            return ProgramProcess(words, said, keep_open)
        except OSError as error:
            raise RehearsalError(f"{self.words[0]}: cannot be started: {error.strerror}") from error


def misfit_of(notice: str, pid: int) -> str:
    """Return what the bus does not understand of a process; empty if a notice is about others."""
    return notice.partition(" it sent ")[2] if f"process {pid}" in notice else ""


def misfit_error(name: str, misfit: str) -> SideLostError:
    """Return the error of a program that the bus does not understand."""
    return SideLostError(f"{name} does not follow the protocol of the bus: {misfit}")


def end_error(name: str, status: int, when: str, said: str) -> SideLostError:
    """Return the error of a program that has ended, from its exit status and last words."""
    if status < 0:
        return SideLostError(f"{name} was killed by {signal.Signals(-status).name} {when}")
    return SideLostError(f"{name} ended with status {status} {when}" + (said and f": {said}"))


def said_path(folder: Path, side: Side = "firmware") -> Path:
    """Return the file of what a program prints."""
    return folder / f"{side}.txt"


def last_words(folder: Path, side: Side = "firmware") -> str:
    """Return the last line that a program has printed; empty if there is none."""
    lines = _said_last(folder, side).strip().splitlines()
    return "".join(one for one in lines[-1] if one.isprintable()) if lines else ""


def digest_said(folder: Path) -> str | None:
    """Return the digest of its navigation that a firmware has printed last; None if it has not."""
    said = re.findall(r"^navigation_sha256 ([0-9a-f]{64})$", _said_last(folder), re.MULTILINE)
    return said[-1] if said else None


def _said_last(folder: Path, side: Side = "firmware") -> str:
    path = said_path(folder, side)
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - SAID_BYTES))
            return file.read().decode(errors="replace")
    except OSError:
        return ""
