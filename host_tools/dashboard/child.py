"""The rehearsal that the dashboard starts: a program of its own, which ends with it."""

from __future__ import annotations

import ctypes
import json
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final

from rrins.host_tools.bus.address import Address
from rrins.host_tools.closing import Closing
from rrins.host_tools.files import JsonObject
from rrins.host_tools.interruption import INTERRUPTED
from rrins.host_tools.rounding import with_unit
from rrins.host_tools.scenario.scenario import Scenario

_PR_SET_PDEATHSIG: Final = 1
_GRACE_S: Final = 20.0
_libc = ctypes.CDLL(None)


@dataclass(frozen=True)
class Start:
    """Subject of a rehearsal."""

    name: str  #: Built-in scenario or file
    scenario: Scenario  #: the same, with the options applied
    #: by which it differs from its file, and where results and recording go
    options: tuple[str, ...]
    address: Address  #: a channel of the embedded bus


def _end_with_parent() -> None:
    """Have SIGINT sent to this process when the thread that started it has gone."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGINT)


class ChildRehearsal(Closing):
    """`rrins rehearse`, steered by a file.

    Attributes
    ----------
    latest : str
        What it said last on standard error.
    """

    def __init__(self, start: Start, steer: Path) -> None:
        words = ["rehearse", start.name, *start.options, "--channel", start.address.channel]
        words += ["--steer", str(steer), "--json"]
        self.latest = ""
        self._out = ""
        self._process = subprocess.Popen(
            [sys.executable, "-m", "rrins", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            preexec_fn=_end_with_parent,
        )
        out, err = self._process.stdout, self._process.stderr
        assert out is not None
        assert err is not None
        self._threads = [
            threading.Thread(target=self._read_out, args=(out,), daemon=True),
            threading.Thread(target=self._read_err, args=(err,), daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    def _read_out(self, stream: IO[str]) -> None:
        with stream:
            self._out = stream.read()

    def _read_err(self, stream: IO[str]) -> None:
        with stream:
            for line in stream:
                self.latest = line.strip().removeprefix("rrins: ") or self.latest

    @property
    def is_running(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    def stop(self) -> None:
        """Have it end as Ctrl-C does; kill it if it does not."""
        if self.is_running:
            self._process.send_signal(signal.SIGINT)
        try:
            self._process.wait(_GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def outcome(self) -> tuple[str, str]:
        """Return `ended` or `failed`, and what came of it in words."""
        for thread in self._threads:
            thread.join()
        status = self._process.returncode
        words = "stopped" if status == INTERRUPTED else "ended"
        if status not in (0, INTERRUPTED):
            return "failed", self.latest or f"the rehearsal ended with status {status}"
        try:
            summary: JsonObject = json.loads(self._out)
        except ValueError:
            return "ended", words
        error_m = summary.get("end_position_error_m")
        if error_m is not None:
            words += f"; position error at the end {with_unit(error_m, 'm')}"
        return "ended", words

    def close(self) -> None:
        """Stop it and close its pipes."""
        self.stop()
        for stream in (self._process.stdout, self._process.stderr):
            if stream is not None:
                for thread in self._threads:
                    thread.join()
                stream.close()
