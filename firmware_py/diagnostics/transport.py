"""ISO-TP (ISO 15765-2) with the library can-isotp, timed by the epoch counter.

The layer has no thread; it runs once in each slot of an epoch, and sends at most one consecutive
frame per slot.
"""

from __future__ import annotations

from collections import deque

import isotp

from rrins.firmware_py.diagnostics import access, network_frame, table
from rrins.firmware_py.diagnostics.timed_layer import LayerClock, TimedLayer

_LEAST_FED = 16  # frames processed in an epoch, at least
WAITING_EPOCHS = 8
"""Epochs that frames may wait."""

REQUESTS = 4
"""Requests that may wait."""

_FIRST_FRAME_BYTES = 6
_CONSECUTIVE_FRAME_BYTES = 7
_NS_PER_S = 1_000_000_000
_NS_PER_MS = 1_000_000


def slots_per_epoch(period_ns: int) -> int:
    """Return how many diagnostic frames an epoch has room for."""
    return max(1, access.FRAMES_PER_SECOND * period_ns // _NS_PER_S)


def most_fed(period_ns: int) -> int:
    """Return how many frames are processed in an epoch, at most."""
    return max(_LEAST_FED, 2 * period_ns // (access.ST_MIN_MS * _NS_PER_MS))


class Transport:
    """Requests in, responses out.

    Parameters
    ----------
    period_ns : int
        Length of an epoch.

    Attributes
    ----------
    dropped : int
        Frames lost to full queues since power-on.
    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._slots = slots_per_epoch(period_ns)
        self._slot_ns = period_ns // self._slots
        self._most_fed = most_fed(period_ns)
        self._clock = LayerClock()
        self._waiting: deque[tuple[int, bytes]] = deque()
        self._fed: deque[isotp.CanMessage] = deque()
        self._functional: deque[bytes] = deque()
        self._sent: deque[bytes] = deque()
        self._functional_id = table.functional_id()
        self._request_id = table.request_id()
        self._layer = TimedLayer(
            self._clock,
            self._slot_ns,
            receive=self._next_message,
            txfn=lambda message: self._sent.append(bytes(message.data)),
            address=isotp.Address(
                isotp.AddressingMode.Normal_11bits, txid=table.response_id(), rxid=self._request_id
            ),
            error_handler=lambda error: None,
            params={
                "stmin": access.ST_MIN_MS,
                "blocksize": access.BLOCK_SIZE,
                "tx_padding": access.PADDING,
                "rx_flowcontrol_timeout": access.N_BS_MS,
                "rx_consecutive_frame_timeout": access.N_CR_MS,
                "max_frame_size": access.MESSAGE_CAPACITY,
                "wftmax": 10,
                "logger_name": "rrins.isotp",
            },
        )
        self._layer.logger.disabled = True  # the peer notices what goes wrong on the wire
        self.dropped = 0
        self._rests = False  # nothing is in progress, so no epoch has to ask the layer

    def _next_message(self) -> isotp.CanMessage | None:
        return self._fed.popleft() if self._fed else None

    @property
    def is_idle(self) -> bool:
        """Whether nothing is in progress in either direction."""
        return self._rests or not (
            self._waiting
            or self._fed
            or self._sent
            or self._functional
            or self._layer.available()
            or self._layer.transmitting()
            or self._layer.is_rx_active()
        )

    @property
    def is_sending(self) -> bool:
        """Whether a response is being sent."""
        return not self._rests and bool(self._layer.transmitting() or self._sent)

    @property
    def is_receiving(self) -> bool:
        """Whether a request is being received."""
        return not self._rests and bool(self._layer.is_rx_active())

    def put(self, can_id: int, data: bytes) -> None:
        """Queue a frame from the bus; `begin` processes it."""
        if len(self._waiting) >= WAITING_EPOCHS * self._most_fed:
            self.dropped += 1
            return
        self._waiting.append((can_id, data))
        self._rests = False

    def begin(self, now_ns: int) -> None:
        """Begin an epoch: process the queued frames, up to the limit of an epoch."""
        self._clock.now_ns = now_ns
        if self._rests:
            return
        for _ in range(min(self._most_fed, len(self._waiting))):
            can_id, data = self._waiting.popleft()
            if can_id == self._functional_id:
                self._receive_functional(data)
            else:
                self._fed.append(isotp.CanMessage(arbitration_id=can_id, data=data))
        self._layer.process()
        while self._layer.rx_queue.qsize() > REQUESTS:
            self._layer.recv()
            self.dropped += 1

    def _receive_functional(self, data: bytes) -> None:
        """Receive a functional request: a single frame, as ISO 15765-2 requires."""
        request = network_frame.single(data)
        if request is not None and len(self._functional) < REQUESTS:
            self._functional.append(request)

    def receive_functional(self) -> bytes | None:
        """Return the next functional request, or None."""
        return self._functional.popleft() if self._functional else None

    def receive(self) -> bytes | None:
        """Return the next physical request, or None."""
        request = None if self._rests else self._layer.recv()
        return None if request is None else bytes(request)

    def sending_ns(self, response: bytes) -> int:
        """Return how long sending a response takes, if the tool asks for no pauses."""
        following = max(0, len(response) - _FIRST_FRAME_BYTES)
        return -(-following // _CONSECUTIVE_FRAME_BYTES) * self._slot_ns

    def send(self, response: bytes) -> None:
        """Begin to send a response."""
        self._layer.send(response)
        self._rests = False

    def end(self) -> list[bytes]:
        """End the epoch: return the frames to send in it, eight bytes each."""
        if self._rests:
            return []
        begin_ns = self._clock.now_ns
        self._layer.process(do_rx=False)
        for slot in range(1, self._slots):
            if len(self._sent) >= self._slots or not self._layer.transmitting():
                break
            self._clock.now_ns = begin_ns + slot * self._slot_ns
            self._layer.process(do_rx=False)
        frames = [self._sent.popleft() for _ in range(min(self._slots, len(self._sent)))]
        self._rests = self.is_idle
        return frames

    def reset(self) -> None:
        """Drop everything in progress."""
        self._layer.reset()
        for waiting in (self._waiting, self._fed, self._functional, self._sent):
            waiting.clear()
