"""Programs in the hardware's place: ``some_hardware.py KIND [SCENARIO DURATION] --channel PATH …``.

All but the emulation speak to the bus as docs/bus.md has it, without the project's code.
"""

from __future__ import annotations

import os
import signal
import socket
import struct
import sys
import time

HEADER = struct.Struct("<4sBBHIIQq")
HELLO, BYE, FRAMES, EXCLUSIVE, CLOSES = 1, 4, 5, 2, 1
CHANNEL = sys.argv[sys.argv.index("--channel") + 1]


def attach(magic: bytes = b"RRB1") -> tuple[socket.socket, int]:
    """Attach as the hardware; return the socket and the node number."""
    end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    end.connect(CHANNEL)
    end.send(HEADER.pack(magic, HELLO, EXCLUSIVE, 8, 0, 0, 0, 0) + b"hardware")
    answer = end.recv(65537)
    _, kind, _, _, number, *_ = HEADER.unpack_from(answer)
    if kind != 2:
        sys.exit(f"refused: {answer[32:].decode()}")
    return end, number


def answer(epochs: int, count: int = 0) -> socket.socket:
    """Close so many epochs, each with `count` frames of an identifier that is nobody's."""
    end, number = attach()
    frames = count * struct.pack("<IB3x8s", 0x7A0, 8, bytes(8))
    for _ in range(epochs):
        batch = end.recv(65537)
        if not batch or batch[4] == BYE:
            sys.exit(0)
        *_, epoch, time_ns = HEADER.unpack_from(batch)
        head = HEADER.pack(b"RRB1", FRAMES, CLOSES, count, number, 0, epoch, time_ns)
        end.send(head + frames)
    return end


def emulate(name: str, duration_s: float) -> None:
    """Be the project's own emulation, but for the operator."""
    import can

    from rrins.dbc.contract import load_contract
    from rrins.dbc.frame import frame_array
    from rrins.host_tools.bus.interface import RrinsBus
    from rrins.host_tools.hardware.loop import Hardware
    from rrins.host_tools.runs.set_up.settings import hardware_settings
    from rrins.host_tools.scenario.scenario import load

    settings = hardware_settings(load(name, duration_s=duration_s))
    Hardware(settings).step(frame_array(1), 0)  # compiles, or loads, before anybody waits
    hardware = Hardware(settings)
    of_operator = int(load_contract()[0].mode_command.message.can_id)
    inbox = frame_array(4096)
    with RrinsBus(CHANNEL, host="never", name="hardware", exclusive=True) as bus:
        while True:
            try:
                batch = bus.recv_batch(inbox, None)
            except can.CanError:
                return
            assert batch is not None
            assert batch.closes_epoch
            sent = hardware.step(inbox, batch.count)
            frames = hardware.outbox[:sent]
            own = frames[frames["can_id"] != of_operator].copy()
            epoch, time_ns = batch.epoch, batch.time_ns
            bus.send_batch(own, len(own), epoch=epoch, time_ns=time_ns, closes_epoch=True)


def main() -> None:
    kind = sys.argv[1]
    if kind == "emulation":
        emulate(sys.argv[2], float(sys.argv[3]))
    elif kind == "ends":
        sys.exit("no table is connected")
    elif kind == "dies":
        answer(100)
        os.kill(os.getpid(), signal.SIGSEGV)
    elif kind == "leaves":
        answer(100)
    elif kind == "hangs":
        with answer(100):
            print("no pulse", flush=True)
            time.sleep(60)
    elif kind == "floods":
        answer(100, 1000)
    elif kind == "version":
        attach(b"RRB2")


main()
