"""Keeps a user's program: starts it, writes down what it prints, leaves nothing of it running.

A process of its own, with the standard library alone::

    python -I -S keeper.py GRACE_S LOG LOG_BYTES PROGRAM [OPTION…]

It first prints a line: the program's process number, or why it cannot be started. Its standard
input is a pipe that the starting process holds open: its end is the end of that process. Then the
program gets SIGTERM and, `GRACE_S` seconds later, SIGKILL. When the program has ended, however it
went, so do all of its descendants, in whatever session they are; the keeper ends last, as the
program did.
"""

import contextlib
import ctypes
import os
import resource
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

_PDEATHSIG, _SUBREAPER = 1, 36  # of prctl(2)
_LOOK_S = 0.05
_CHUNK = 65536


def _prctl(option: int, value: int) -> None:
    ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


class Log:
    """A file for the output of the program; when it is full, it becomes the one before.

    Parameters
    ----------
    path : Path
    limit : int
        Bytes of one file; two are kept.
    pipe : int
        From the program.
    """

    def __init__(self, path: Path, limit: int, pipe: int) -> None:
        self._path, self._limit, self._pipe = path, limit, pipe
        self._file = path.open("ab", buffering=0)
        self._bytes = self._file.tell()
        os.set_blocking(pipe, False)

    def take(self) -> bool:
        """Take what has come; return False at the pipe's end, or when nothing is there."""
        try:
            data = os.read(self._pipe, _CHUNK)
        except BlockingIOError:
            return False
        with contextlib.suppress(OSError):  # a full disk, no folder any more: the program goes on
            self._write(data)
        return bool(data)

    def _write(self, data: bytes) -> None:
        if self._bytes + len(data) > self._limit:
            self._path.replace(self._path.with_stem(f"{self._path.stem}.before"))
            fresh = self._path.open("wb", buffering=0)
            self._file.close()
            self._file, self._bytes = fresh, 0
        self._bytes += self._file.write(data) or 0


class Keeper:
    """The program, and what it has started.

    Raises
    ------
    OSError
        If it cannot be started.
    """

    def __init__(self, grace_s: float, log: Path, log_bytes: int, words: list[str]) -> None:
        _prctl(_SUBREAPER, 1)
        read_end, write_end = os.pipe()
        self._log = Log(log, log_bytes, read_end)  # before the program, which may undo its folder
        self._program = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            stdout=write_end,
            stderr=write_end,
            start_new_session=True,
            preexec_fn=lambda: _prctl(_PDEATHSIG, signal.SIGKILL),
        )
        os.close(write_end)
        self.pid = self._program.pid
        self._grace_s = grace_s
        self._deadline = float("inf")
        self._poller = select.poll()
        self._lines = (0, read_end, os.pidfd_open(self.pid))
        for line in self._lines:
            self._poller.register(line, select.POLLIN)

    def run(self) -> int:
        """Wait for the program's end; return its status, as `subprocess` tells it."""
        starter, output, end = self._lines
        while True:
            ready = [line for line, _ in self._poller.poll(self._wait_ms)]
            if output in ready and not self._log.take():
                self._poller.unregister(output)
            if end in ready:
                break
            if starter in ready and not os.read(starter, 1):
                self._poller.unregister(starter)
                self._ask_to_end()
            if time.monotonic() > self._deadline:
                os.kill(self.pid, signal.SIGKILL)
        status = self._program.wait()
        self._end_descendants()
        while self._log.take():
            pass
        return status

    @property
    def _wait_ms(self) -> float | None:
        return None if self._deadline == float("inf") else 1e3 * _LOOK_S

    def _ask_to_end(self) -> None:
        self._deadline = time.monotonic() + self._grace_s
        os.killpg(self.pid, signal.SIGTERM)
        os.killpg(self.pid, signal.SIGCONT)

    def _end_descendants(self) -> None:
        """Kill what the program has started until none is left: orphans become our children."""
        while found := descendants(os.getpid()):
            for pid in found:
                try:
                    os.kill(pid, signal.SIGKILL)
                except ProcessLookupError:
                    continue
                except PermissionError:  # it runs as somebody else
                    return
            try:
                while os.waitpid(-1, os.WNOHANG)[0]:
                    pass
            except ChildProcessError:
                return
            time.sleep(1e-3)


def _parent(pid: str) -> int:
    """Return the parent of a process; 0 if it is gone."""
    try:
        stat = Path("/proc", pid, "stat").read_bytes()
    except OSError:
        return 0
    return int(stat.rpartition(b")")[2].split()[1])


def descendants(ancestor: int) -> list[int]:
    """Return what descends from a process, as far as no process between them has ended."""
    names = (path.name for path in Path("/proc").iterdir())
    parents = {int(pid): _parent(pid) for pid in names if pid.isdigit()}
    found, family = [], {ancestor}
    while new := {pid for pid, parent in parents.items() if parent in family} - family:
        found += sorted(new)
        family |= new
    return found


def _end_as(status: int) -> None:
    """End with a status of `subprocess`: minus a signal is an end by that signal."""
    if status < 0:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if -status not in (signal.SIGKILL, signal.SIGSTOP):
            signal.signal(-status, signal.SIG_DFL)
        os.kill(os.getpid(), -status)
    os._exit(status)


def main() -> None:
    """Keep a program."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: None)  # not ignored: the program would inherit that
    grace_s, log, log_bytes, *words = sys.argv[1:]
    try:
        keeper = Keeper(float(grace_s), Path(log), int(log_bytes), words)
    except OSError as error:
        print(error.strerror, flush=True)
        sys.exit(1)
    print(keeper.pid, flush=True)
    _end_as(keeper.run())


if __name__ == "__main__":
    main()
