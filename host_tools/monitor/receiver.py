"""Receives the frames of a bus in a thread, for a watch.

On the embedded bus it is an observer: the bus never waits for it, and cuts it off when too much
waits for it. Then it attaches again, and the watch is told that frames are missing.
"""

from __future__ import annotations

import threading
from typing import Any

import can

from dbc.frame import frame_array
from host_tools.bus.interface import RrinsBus
from host_tools.errors import BusError
from host_tools.monitor.watch import Watch
from host_tools.port import Address, frame_of_message, open_bus

NAME = "monitor"
"""What a monitor calls itself on the embedded bus."""

_POLL_S = 0.1
_REST_S = 0.004  # between two visits: to wake for each datagram would cost its sender time
_CAPACITY = 4096
_ATTACH_S = 2.0


class Receiver:
    """A thread that hands all frames of a bus to a watch.

    Parameters
    ----------
    address : Address
    watch : Watch

    Raises
    ------
    BusError
        When the bus cannot be opened.
    """

    def __init__(self, address: Address, watch: Watch) -> None:
        self._address = address
        self._watch = watch
        self._frames = frame_array(_CAPACITY)
        self._stop = threading.Event()
        self._bus = self._open()
        self._thread = threading.Thread(target=self._run, name=NAME, daemon=True)
        self._thread.start()

    def _open(self) -> can.BusABC:
        wishes: dict[str, Any] = {}
        if self._address.is_embedded:
            wishes = {"name": NAME, "role": "observer", "host": "never"}
            wishes["attach_timeout"] = _ATTACH_S
        return open_bus(self._address, **wishes)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                if isinstance(self._bus, RrinsBus):
                    self._receive_batches(self._bus)
                else:
                    self._receive_messages(self._bus)
            except (can.CanError, OSError) as error:
                if self._stop.is_set() or not self._attach_again(error):
                    return

    def _receive_batches(self, bus: RrinsBus) -> None:
        """Wait for a batch, take all that are there, and rest."""
        frames, take = self._frames, self._watch.take
        batch = bus.recv_batch(frames, _POLL_S)
        while batch is not None and not self._stop.is_set():
            take(frames, batch.count, batch.time_ns)
            batch = bus.recv_batch(frames, 0.0)
        self._stop.wait(_REST_S)

    def _receive_messages(self, bus: can.BusABC) -> None:
        message = bus.recv(_POLL_S)
        while message is not None and not self._stop.is_set():
            if not message.is_fd:
                frame_of_message(self._frames[0], message)
                self._watch.take(self._frames, 1, round(message.timestamp * 1e9))
            message = bus.recv(0.0)

    def _attach_again(self, error: Exception) -> bool:
        """Return whether the bus is still there; else the watch is told why it has ended."""
        self._bus.shutdown()
        if self._address.is_embedded:
            try:
                self._bus = self._open()
            except BusError:
                pass
            else:
                self._watch.note_gap()
                return True
        self._watch.end(" ".join(str(error).split()))
        return False

    def close(self) -> None:
        """Leave the bus."""
        self._stop.set()
        self._thread.join()
        self._bus.shutdown()
