"""Receives the frames of a bus in a thread, for a watch.

On the embedded bus it is an observer: the bus never waits for it, and disconnects it if it falls
too far behind. It then reattaches and notifies the watch of the gap.
"""

from __future__ import annotations

import contextlib
import threading
import time

import can
import numpy as np

from rrins.dbc.direct import AVAILABLE, WORDS, Direct
from rrins.dbc.frame import frame_array
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.bus.port import frame_of_message, open_bus
from rrins.host_tools.errors import BusError
from rrins.host_tools.monitor.tally import MOST_AT_ONCE, count_waiting
from rrins.host_tools.monitor.watch import Watch

NAME = "monitor"
"""Name of a monitor on the embedded bus."""

_POLL_S = 0.1
_REST_S = 0.004
_CAPACITY = 4096
_ASK_S = 0.5
_FIRST_ATTACH_S = 10.0  # a host on a busy machine may still be starting
_ATTACH_S = 2.0


class Receiver:
    """A thread that passes all frames of a bus to a watch.

    Parameters
    ----------
    address : Address
    watch : Watch
    name : str, optional
        Of this observer on the embedded bus.
    rest_s : float, optional
        Between two reads; waking up for each datagram would delay its sender.

    Raises
    ------
    BusError
        If the bus cannot be opened.
    """

    def __init__(
        self, address: Address, watch: Watch, name: str = NAME, rest_s: float = _REST_S
    ) -> None:
        self._address = address
        self._watch = watch
        self._name = name
        self._rest_s = rest_s
        self._frames = frame_array(_CAPACITY)
        self._lent, self._words = Direct.zeros(), np.zeros(WORDS, dtype=np.uint64)
        self._left_over = self._lent["left_over"]
        self._is_lent = False  # the socket, to compiled code
        if AVAILABLE:  # compile now: there is no socket yet
            self._lent[0].fd = -1
            count_waiting(watch.memory(), self._lent, self._words, self._frames)
        self._next_question = 0.0
        self._stop = threading.Event()
        self._bus = self._open(_FIRST_ATTACH_S)
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _open(self, attach_timeout: float = _ATTACH_S) -> can.BusABC:
        options: dict[str, str | float] = {}
        if self._address.is_embedded:
            options = {"name": self._name, "role": "observer", "host": "never"}
            options["attach_timeout"] = attach_timeout
        return open_bus(self._address, **options)

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
        """Receive all pending batches, wait for one if there are none, and pause."""
        self._ask(bus)
        if not (self._is_lent and self._take_waiting(bus)):
            self._receive_slowly(bus)
        self._watch.note_refused(bus.refused)
        self._stop.wait(self._rest_s)

    def _receive_slowly(self, bus: RrinsBus) -> None:
        """Wait for a batch and receive it, and what follows until compiled code may go on."""
        frames, add = self._frames, self._watch.add_frames
        batch = bus.recv_batch(frames, _POLL_S)
        while batch is not None and not self._stop.is_set():
            add(frames, batch.count, batch.time_ns)
            self._is_lent = AVAILABLE and bus.lend(self._lent[0])
            batch = None if self._is_lent else bus.recv_batch(frames, 0.0)

    def _take_waiting(self, bus: RrinsBus) -> bool:
        """Receive pending batches in compiled code; return False if Python is to go on."""
        lent, words = self._lent, self._words
        taken = batches = self._watch.add_waiting(lent, words, self._frames)
        while batches == MOST_AT_ONCE and not self._stop.is_set():
            batches = self._watch.add_waiting(lent, words, self._frames)
        left_over = int(self._left_over[0])
        if left_over:
            bus.take_back(words.view(np.uint8).data[:left_over])
            self._is_lent = False
        return taken > 0 and not left_over

    def _ask(self, bus: RrinsBus) -> None:
        """Ask the host now and then what it has refused; it answers among the frames."""
        now = time.monotonic()
        if now >= self._next_question:
            self._next_question = now + _ASK_S
            self._is_lent = False  # a send may take in what waits
            with contextlib.suppress(can.CanError):  # held up: asked later; ended: read to the end
                bus.ask_refused(0.0)

    def _receive_messages(self, bus: can.BusABC) -> None:
        message = bus.recv(_POLL_S)
        while message is not None and not self._stop.is_set():
            if not message.is_fd:
                frame_of_message(self._frames[0], message)
                self._watch.add_frames(self._frames, 1, round(message.timestamp * 1e9))
            message = bus.recv(0.0)

    def _attach_again(self, error: Exception) -> bool:
        """Reattach and return True; if the bus has ended, notify the watch and return False."""
        self._bus.shutdown()
        if self._address.is_embedded:
            try:
                self._bus = self._open()
                self._is_lent = False
            except BusError:
                pass
            else:
                self._watch.count_gap()
                return True
        self._watch.end(" ".join(str(error).split()))
        return False

    def close(self) -> None:
        """Leave the bus."""
        self._stop.set()
        self._thread.join()
        self._bus.shutdown()
