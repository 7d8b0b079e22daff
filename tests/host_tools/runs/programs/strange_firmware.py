"""Programs in the firmware's place that do it wrong: ``strange_firmware.py KIND --channel PATH …``.

They speak to the bus as docs/bus.md has it, without the project's code.
"""

from __future__ import annotations

import os
import signal
import socket
import struct
import sys
import time
from pathlib import Path

HEADER = struct.Struct("<4sBBHIIQq")
HELLO, BYE, FRAMES, EXCLUSIVE, CLOSES = 1, 4, 5, 2, 1
AXES = (0x020, 0x021)


def attach(magic: bytes = b"RRB1") -> tuple[socket.socket, int]:
    """Attach as the firmware; return the socket and the node number."""
    path = sys.argv[sys.argv.index("--channel") + 1]
    end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    while True:
        try:
            end.connect(path)
            break
        except OSError:
            time.sleep(0.02)
    end.send(HEADER.pack(magic, HELLO, EXCLUSIVE, 8, 0, 0, 0, 0) + b"firmware")
    answer = end.recv(65537)
    _, kind, _, _, number, *_ = HEADER.unpack_from(answer)
    if kind != 2:
        sys.exit(f"refused: {answer[32:].decode()}")
    return end, number


def frames(epoch: int) -> bytes:
    """Return two axis commands without protection: nobody uses them."""
    return b"".join(struct.pack("<IB3x8s", one, 8, bytes([0, epoch % 15])) for one in AXES)


def answer(epochs: int) -> tuple[socket.socket, int]:
    """Close so many epochs with useless frames."""
    end, number = attach()
    for _ in range(epochs):
        try:
            batch = end.recv(65537)
        except ConnectionResetError:
            batch = b""
        if not batch or batch[4] == BYE:
            sys.exit(0)
        _, _, _, _, _, _, epoch, time_ns = HEADER.unpack_from(batch)
        end.send(HEADER.pack(b"RRB1", FRAMES, CLOSES, 2, number, 0, epoch, time_ns) + frames(epoch))
    return end, number


def main() -> None:
    kind = sys.argv[1]
    if kind == "ends":
        sys.exit("no licence")
    elif kind == "ends-well":
        sys.exit(0)
    elif kind == "dies":
        answer(100)
        os.kill(os.getpid(), signal.SIGSEGV)
    elif kind == "dies-once":
        mark = Path(sys.argv[2], "died")
        epochs = 10**9 if mark.exists() else 100
        mark.touch()
        answer(epochs)
        os.kill(os.getpid(), signal.SIGKILL)
    elif kind == "leaves":
        answer(100)
    elif kind == "hangs":
        end, _ = answer(100)
        if os.fork() == 0:  # a child that it leaves behind
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
        print("no pulse", flush=True)
        time.sleep(1000)
    elif kind == "floods":
        end, number = answer(100)
        batch = HEADER.pack(b"RRB1", FRAMES, 0, 2000, number, 0, 100, 0) + frames(0) * 1000
        while True:
            end.send(batch)
    elif kind == "version":
        attach(b"RRB2")
    elif kind == "garbage":
        end, _ = answer(100)
        end.send(b"hello, bus")
        time.sleep(1000)
    elif kind == "idle":
        answer(10**9)


main()
