"""Processes of the project for tests: forks of a server that has imported what they need.

A program of its own imports and loads compiled code for two seconds before it does anything; a fork
starts at once. Run as a program, this file is the server: `Fork` asks it for processes.
"""

from __future__ import annotations

import atexit
import base64
import contextlib
import fcntl
import gc
import importlib
import json
import os
import pkgutil
import runpy
import select
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
NO_PICTURE = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAQAAAC1HAwCAAAAC0lEQVR42mNkYAAAAAYAAjCB0C8AAAAASUVORK5CYII="
)
"""Stands for pictures, which take longer than most runs of tests."""

_LONGEST = 1 << 20  # bytes of a request
_MOST_DESCRIPTORS = 16
_OUT_OF_THE_WAY = 500  # the least number of a descriptor that no process was promised


def write_no_pictures(folder: Path, pictures: Mapping[str, object]) -> list[Path]:
    """Write a tiny picture where `saving.write_pictures` writes pictures; return the paths."""
    from rrins.host_tools.files import replacing

    paths = [folder / f"{name}.png" for name in pictures]
    for path in paths:
        with replacing(path) as part:
            part.write_bytes(NO_PICTURE)
    return paths


def draw_no_pictures() -> None:
    """Have this process draw none of the pictures of every run, which tests draw by themselves."""
    from rrins.host_tools.runs.results import plots

    plots.write_pictures = write_no_pictures
    for draw in ("draw_errors", "_track_figure", "draw_parity"):
        setattr(plots, draw, lambda *_: None)


class Fork(subprocess.Popen):
    """A Python program as a fork of the server, with all that `Popen` can do, in its own session.

    Parameters
    ----------
    words : sequence of str
        A module, as behind `python -m`, or a script that ends in `.py`; and its words.
    **options
        As of `Popen`.
    """

    def __init__(self, words: Any, **options: Any) -> None:
        self._ended, self._ending = os.pipe()  # the server's process number, and how it ended
        try:
            super().__init__([str(word) for word in words], **options)
        finally:
            os.close(self._ending)

    def _execute_child(self, args, executable, preexec_fn, close_fds, pass_fds, cwd, env, *more):
        """Ask the server for a process, where `Popen` would make one."""
        pipes = more[3:9]  # child's and ours of standard input, ours and child's of the outputs
        request = {
            "words": args,
            "cwd": os.fspath(cwd or Path.cwd()),
            "environment": dict(os.environ if env is None else env),
            "kept": list(pass_fds),
        }
        own = [own if own >= 0 else k for k, own in enumerate((pipes[0], pipes[3], pipes[5]))]
        with Path(os.devnull).open() as nothing:
            own[0] = own[0] or nothing.fileno()
            socket.send_fds(
                server(), [json.dumps(request).encode()], [self._ending, *own, *pass_fds]
            )
        self.pid = int(self._hear())
        self._child_created = True
        self._close_pipe_fds(*pipes)

    def _hear(self) -> bytes:
        """Return the next number that the server's process says."""
        said = b""
        while not said.endswith(b"\n"):
            byte = os.read(self._ended, 1)
            if not byte:
                return b"9"  # killed, and what waited for it, too
            said += byte
        return said

    def _try_wait(self, flags):
        if flags == os.WNOHANG and not select.select([self._ended], [], [], 0)[0]:
            return 0, 0
        status = int(self._hear())
        os.close(self._ended)
        return self.pid, status

    def _internal_poll(self, *_, **__):
        if self.returncode is None:
            number, status = self._try_wait(os.WNOHANG)
            if number:
                self._handle_exitstatus(status)
        return self.returncode


class Forking:
    """Stands for the module `subprocess` where that starts nothing but Python modules."""

    def Popen(self, words: Any, **options: Any) -> Fork:
        """Start a fork, for `sys.executable -m MODULE WORDS`."""
        return Fork(words[2:], **options)

    def __getattr__(self, name: str) -> Any:
        return getattr(subprocess, name)


@cache
def server() -> socket.socket:
    """Start the server of this process; it ends with it."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        subprocess.Popen(
            [sys.executable, "-W", "ignore::DeprecationWarning", __file__, str(theirs.fileno())],
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            cwd=ROOT,
        )
    return ours


def serve(requests: socket.socket) -> None:
    """Fork for each request; return in the process asked for, with its words in `sys.argv`."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # of its forks there is nothing to be known
    while True:
        data, received, *_ = socket.recv_fds(requests, _LONGEST, _MOST_DESCRIPTORS)
        if not data:
            os._exit(0)
        if not os.fork():
            break
        _close(received)
    requests.close()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    ending, *received = received
    number = os.fork()
    if number:
        _close(received)
        os.write(ending, f"{number}\n".encode())
        _, status = os.waitpid(number, 0)
        with contextlib.suppress(BrokenPipeError):
            os.write(ending, f"{status}\n".encode())
        os._exit(0)
    os.close(ending)
    os.setsid()
    request = json.loads(data)
    passed = [fcntl.fcntl(one, fcntl.F_DUPFD, _OUT_OF_THE_WAY) for one in received]
    _close(received)
    for one, wanted in zip(passed, [0, 1, 2, *request["kept"]], strict=True):
        os.dup2(one, wanted)
    _close(passed)
    os.chdir(request["cwd"])
    os.environ.clear()
    os.environ.update(request["environment"])
    sys.argv = request["words"]


def _close(descriptors: list[int]) -> None:
    for one in descriptors:
        os.close(one)


def prepare() -> None:
    """Import what commands import, and load the compiled code of a rehearsal."""
    sys.modules["asammdf"] = None  # type: ignore[assignment]  # as the command without .mf4 does
    from rrins.host_tools import cli

    for module in pkgutil.walk_packages(cli.__path__, f"{cli.__name__}."):
        importlib.import_module(module.name)
    from rrins.host_tools.runs import rehearsal
    from rrins.host_tools.runs.direct import run_direct, run_without_frames
    from tests.host_tools.conftest import record_rehearsal, short_scenario

    assert rehearsal
    draw_no_pictures()
    with tempfile.TemporaryDirectory(prefix="rrins-", ignore_cleanup_errors=True) as folder:
        os.environ["XDG_RUNTIME_DIR"] = folder
        scenario = short_scenario(duration_s=0.1)
        run_without_frames(scenario)  # as long as there is one thread, two processes compile
        run_direct(scenario)
        record_rehearsal(scenario, Path(folder, "bus.log"))


def run(program: str) -> None:
    """Run a module or a script by its name, which may end with `SystemExit`."""
    if program == "rrins":
        from rrins.__main__ import main

        main()
    elif program.endswith(".py"):
        runpy.run_path(program, run_name="__main__")
    else:
        runpy.run_module(program, run_name="__main__", alter_sys=True)


_status: list[int] = []
"""How the program of this process has ended, once it has."""


def _leave() -> None:
    """End a fork with its memory as it is: to tidy up all modules takes a tenth of a second."""
    with contextlib.suppress(OSError):  # what cannot be written is said as Python says it
        for stream in (sys.stdout, sys.stderr):
            if stream is not None and not stream.closed:
                stream.flush()
        if _status:
            os._exit(_status[0])


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    atexit.register(_leave)  # the first, so the last that is called, and after all threads
    prepare()
    if len(sys.argv) == 1:  # `make test`: all that is to be done is that the code is compiled
        sys.exit()
    gc.collect()
    gc.freeze()
    serve(socket.socket(fileno=int(sys.argv[1])))
    program = sys.argv[0]
    sys.path[0] = str(Path(program).parent) if program.endswith(".py") else str(Path.cwd())
    try:
        run(program)
    except SystemExit as ended:
        _status += [ended.code or 0] if isinstance(ended.code, int | None) else []
        raise
    _status.append(0)
