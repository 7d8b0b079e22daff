"""The lower bound for lockstep: two processes exchange the bytes of an epoch and do nothing else.

Run as a program, it is one of the two ends; it imports next to nothing, so that it starts at once.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time

_WARM_UP = 500  # epochs


def _open(fd: int, core: int) -> socket.socket:
    os.sched_setaffinity(0, {core})
    return socket.socket(fileno=fd)


def _echo(end: socket.socket, down: int, epochs: int) -> None:
    """Answer each datagram with one of `down` bytes."""
    buffer = bytearray(65_536)
    answer = bytes(down)
    for _ in range(epochs):
        end.recv_into(buffer)
        end.send(answer)


def _drive(end: socket.socket, up: int, epochs: int) -> int:
    """Send datagrams of `up` bytes and read the answers; return the duration in nanoseconds."""
    buffer = bytearray(65_536)
    opening = bytes(up)
    start_ns = time.monotonic_ns()
    for _ in range(epochs):
        end.send(opening)
        end.recv_into(buffer)
    return time.monotonic_ns() - start_ns


def measure(up: int, down: int, epochs: int) -> float:
    """Return the epochs per second of two processes on one core.

    Parameters
    ----------
    up, down : int
        Bytes of the datagram of an epoch in each direction.
    epochs : int
    """
    core = str(max(os.sched_getaffinity(0)))
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ends[0], ends[1]:
        started = []
        try:
            for role, end, size in (("echo", ends[0], down), ("drive", ends[1], up)):
                command = [sys.executable, "-m", "rrins.host_tools.benchmarks.floor", role]
                command += [str(end.fileno()), str(size), str(epochs), core]
                started.append(
                    subprocess.Popen(
                        command,
                        pass_fds=(end.fileno(),),
                        stdin=subprocess.DEVNULL,
                        stdout=subprocess.PIPE,
                        start_new_session=True,
                    )
                )
            for end in ends:
                end.close()  # so that each process notices when the other exits
            took_ns = int(started[1].communicate()[0])
            started[0].communicate()
        finally:
            for process in started:
                process.kill()
                process.wait()
    return epochs / (took_ns * 1e-9)


def main(arguments: list[str]) -> None:
    """Run one end: ``echo|drive FD BYTES EPOCHS CORE``; ``drive`` prints nanoseconds."""
    role = arguments[0]
    fd, size, epochs, core = (int(argument) for argument in arguments[1:])
    with _open(fd, core) as end:
        if role == "echo":
            _echo(end, size, _WARM_UP + epochs)
        else:
            _drive(end, size, _WARM_UP)
            print(_drive(end, size, epochs))


if __name__ == "__main__":
    main(sys.argv[1:])
