"""A runtime directory of its own for each test, players at the other end, and a check for leaks."""

from __future__ import annotations

import contextlib
import fcntl
import gc
import json
import os
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from rrins.host_tools.bus.interface import RrinsBus
from tests.processes import Fork, server


class PlayerProcess:
    """A process that runs `player.py`."""

    def __init__(self) -> None:
        player = Path(__file__).with_name("player.py")
        self.process = Fork([player], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.pid = self.process.pid

    def tell(self, method: str, **arguments: Any) -> None:
        """Let the player do something, and do not wait for it."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps([method, arguments]) + "\n")
        self.process.stdin.flush()

    def answer(self) -> Any:
        """Wait until the player has done what it was told."""
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, "the player has ended"
        return json.loads(line)

    def ask(self, method: str, **arguments: Any) -> Any:
        """Let the player do something and wait for its answer."""
        self.tell(method, **arguments)
        return self.answer()

    def end(self) -> None:
        """End the process, whatever it does."""
        self.process.kill()
        self.process.communicate()


def _descriptors() -> dict[str, str]:
    found = {}
    for entry in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):  # the descriptor of the listing itself
            found[entry.name] = str(entry.readlink())
    kept = ("/proc/", "/claims")  # the listing's; that of compiled code, for the process's life
    return {fd: target for fd, target in found.items() if not any(part in target for part in kept)}


def _children() -> set[str]:
    return set(Path(f"/proc/self/task/{os.getpid()}/children").read_text().split())


def _wait_for_hubs(directory: Path) -> None:
    """Wait until no process hosts a channel any more."""
    for path in directory.glob("rrins/*.lock"):
        try:
            lock = os.open(path, os.O_RDONLY)
        except FileNotFoundError:
            continue
        fcntl.flock(lock, fcntl.LOCK_EX)
        os.close(lock)


@pytest.fixture(autouse=True)
def runtime_directory(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A short path, because a socket takes no long one; nothing may be left behind in it."""
    server()  # of forks: it stays
    with tempfile.TemporaryDirectory(prefix="rr-") as name:
        directory = Path(name)
        monkeypatch.setenv("XDG_RUNTIME_DIR", name)
        gc.freeze()  # looking through all that other tests left takes a second
        descriptors, children = _descriptors(), _children()
        threads = set(threading.enumerate())
        yield directory
        gc.collect()
        _wait_for_hubs(directory)
        for thread in set(threading.enumerate()) - threads:
            thread.join(timeout=120.0)
        assert set(threading.enumerate()) <= threads, "a thread was left behind"
        assert _children() <= children, "a process was left behind"
        assert _descriptors() == descriptors, "a descriptor was left behind"


@pytest.fixture
def start_player(runtime_directory: Path) -> Iterator[Callable[[], PlayerProcess]]:
    """Start players, which are ended with the test."""
    with contextlib.ExitStack() as stack:

        def start() -> PlayerProcess:
            player = PlayerProcess()
            stack.callback(player.end)
            return player

        yield start


@pytest.fixture
def player(start_player: Callable[[], PlayerProcess]) -> PlayerProcess:
    return start_player()


@pytest.fixture
def attach_to() -> Iterator[Callable[..., RrinsBus]]:
    """Attach a bus to a host of this very process, which has to answer meanwhile."""
    with contextlib.ExitStack() as stack, ThreadPoolExecutor(1) as pool:

        def attach(host: RrinsBus, name: str = "peer", **arguments: Any) -> RrinsBus:
            coming = pool.submit(
                RrinsBus, host.channel, host="never", name=name, attach_timeout=120.0, **arguments
            )
            host.wait_for(name, 5.0)
            bus = coming.result()
            stack.callback(bus.shutdown)
            return bus

        yield attach
