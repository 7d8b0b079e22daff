"""Programs that do a bus no good, each until the bus ends: ``python strangers.py ROLE CHANNEL``.

They say that they are ready, and wait for the channel: they are on it before its rehearsal begins.
"""

from __future__ import annotations

import contextlib
import itertools
import sys
import time
from collections.abc import Callable

import can
import numpy as np

from rrins.dbc.contract import load_contract
from rrins.dbc.e2e import fill
from rrins.dbc.frame import Frame, frame_array
from rrins.host_tools.bus import datagram
from rrins.host_tools.bus.channel import NoHostError, connect
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.errors import BusError

_TRIES = 20  # of those who are cut off each time


def _wait_for(channel: str) -> None:
    while True:
        with contextlib.suppress(NoHostError):
            connect(channel, 10.0).close()
            return
        time.sleep(0.02)


def _attach(channel: str, name: str) -> RrinsBus:
    return RrinsBus(channel, host="never", role="observer", name=name)


def forge(channel: str) -> None:
    """Send SENSOR_1 with right CRC and every counter, and SYNC of the future."""
    contract = load_contract()[0]
    unread, forged = frame_array(4096), frame_array(2)
    with _attach(channel, "forger") as bus:
        for epoch in itertools.count(5000):
            fill(forged[0], contract.sensor[0].message, np.uint64(0x0123_4567_0000_0000), epoch)
            fill(forged[1], contract.sync.message, np.uint64(epoch << 12), epoch)
            with contextlib.suppress(can.CanTimeoutError):
                bus.send_batch(forged, 2, timeout=0.01)
            while bus.recv_batch(unread, 0.0) is not None:
                pass


def close_epochs(channel: str) -> None:
    """Claim to close epochs."""
    for _ in range(_TRIES):
        with _attach(channel, "closer") as bus:
            bus.send_batch(frame_array(1), 0, closes_epoch=True, timeout=10.0)
            with contextlib.suppress(can.CanOperationError):
                while bus.recv(10.0) is not None:
                    pass


def flood_with(frame: Frame, count: int, channel: str, name: str) -> None:
    """Send batches of a frame as fast as the bus takes them."""
    frames = np.resize(np.array([frame], dtype=Frame.dtype), count)
    unread = frame_array(4096)
    with _attach(channel, name) as bus:
        while True:
            with contextlib.suppress(can.CanTimeoutError):
                bus.send_batch(frames, count, timeout=0.01)
            while bus.recv_batch(unread, 0.0) is not None:
                pass


def _frame(can_id: int, data: int) -> Frame:
    frame = frame_array(1)[0]
    frame["can_id"], frame["length"], frame["data"] = can_id, 8, data
    return frame


def ask(channel: str) -> None:
    """Ask over UDS, again and again: ReadDataByIdentifier of the epoch."""
    flood_with(_frame(0x7E0, 0x01_01_22_03), 1, channel, "asker")


def babble(channel: str) -> None:
    """Send batches of an identifier that is nobody's, with the highest priority."""
    flood_with(_frame(0x001, 0), 256, channel, "babbler")


def spoil(channel: str) -> None:
    """Attach, and send something that is not a datagram."""
    for number in range(_TRIES):
        with contextlib.suppress(BusError, OSError), connect(channel, 10.0) as end:
            end.send(datagram.control(datagram.HELLO, f"spoiler-{number}"))
            end.recv(1000)
            end.send(bytes(range(number, 100 + number)))
            while end.recv(70_000):
                pass


def call(channel: str) -> None:
    """Call, and say nothing."""
    with contextlib.ExitStack() as stack:
        for _ in itertools.count():
            try:
                stack.enter_context(connect(channel, 10.0))
            except NoHostError:
                return
            except (BusError, OSError):  # no descriptor is left
                stack.close()


ROLES: dict[str, Callable[[str], None]] = {
    "forger": forge,
    "closer": close_epochs,
    "asker": ask,
    "babbler": babble,
    "spoiler": spoil,
    "caller": call,
}

if __name__ == "__main__":
    try:
        # Compiled, or loaded, before the rehearsal begins.
        fill(frame_array(1)[0], load_contract()[0].sync.message, np.uint64(0), 0)
        print("ready", flush=True)
        _wait_for(sys.argv[2])
        ROLES[sys.argv[1]](sys.argv[2])
    except (can.CanError, BusError) as error:
        print(error, flush=True)
