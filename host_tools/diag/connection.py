"""Connections for udsoncan's client: ISO-TP (ISO 15765-2) by can-isotp or by the kernel."""

from __future__ import annotations

import contextlib
import errno
import time
from abc import abstractmethod
from collections.abc import Iterable, Iterator
from typing import Self

import can
import isotp
from udsoncan.connections import BaseConnection
from udsoncan.exceptions import TimeoutException

from rrins.firmware_py.diagnostics import access, table
from rrins.firmware_py.diagnostics.timed_layer import LayerClock, TimedLayer
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.port import open_bus
from rrins.host_tools.diag.transport import DiagnosticFrame, DiagTransport
from rrins.host_tools.errors import BusError, DiagError

_NS_PER_S = 1_000_000_000
_TURN_S = 0.05  # longest wait for frames while nothing is being sent
_SENDING_TURN_S = 0.0005  # the same while consecutive frames are being sent
_STANDSTILL_S = 10.0  # wall clock time without progress after which the bus has stalled
_LISTEN_S = 0.5
_SILENCES = (errno.ETIMEDOUT, errno.ECOMM, errno.EBADMSG, errno.EILSEQ)


_PRESENT = bytes.fromhex("023e80")  # TesterPresent without a response disturbs no other tool


class DisturbedError(DiagError):
    """Another tool sent requests at the same time, so responses cannot be attributed."""


class Connection(BaseConnection):
    """Base class of both kinds of connections.

    Attributes
    ----------
    keeps_pace : bool
        Whether time advances only while this end receives.
    """

    keeps_pace = False

    def __init__(self, where: str) -> None:
        super().__init__(where)
        self.logger.disabled = True  # errors are raised instead
        self.where = where
        self._is_open = False

    def open(self) -> Self:
        """Mark the connection as open."""
        self._is_open = True
        return self

    def is_open(self) -> bool:
        """Return whether requests can be sent."""
        return self._is_open

    @abstractmethod
    def pass_time(self, seconds: float) -> None:
        """Let time pass."""

    def drain(self) -> None:
        """Discard unexpected frames."""

    @abstractmethod
    def hears_others(self) -> bool:
        """Return whether there is any traffic on the bus."""


def _silence(text: str) -> TimeoutException:
    return TimeoutException(text)  # type: ignore[no-untyped-call]  # udsoncan's


def _address() -> isotp.Address:
    return isotp.Address(
        isotp.AddressingMode.Normal_11bits, txid=table.request_id(), rxid=table.response_id()
    )


class LibraryConnection(Connection):
    """ISO-TP by the can-isotp library, without threads: it runs only while sending or waiting.

    Parameters
    ----------
    medium : DiagTransport
    where : str
        Name of the bus, for errors.
    """

    def __init__(self, medium: DiagTransport, where: str) -> None:
        super().__init__(where)
        self.keeps_pace = medium.keeps_pace
        self._medium = medium
        self._clock = LayerClock()
        self._inbox: list[isotp.CanMessage] = []
        self._sent: set[bytes] = set()
        self._sent_before: set[bytes] = set()
        self._is_disturbed = False
        self._failures: list[Exception] = []
        self._layer = TimedLayer(
            self._clock,
            0,
            receive=lambda: self._inbox.pop(0) if self._inbox else None,
            txfn=lambda message: self._send(bytes(message.data)),
            address=_address(),
            error_handler=self._failures.append,
            params={
                "stmin": 0,
                "blocksize": 0,
                "tx_padding": access.PADDING,
                "rx_flowcontrol_timeout": access.N_BS_MS,
                "rx_consecutive_frame_timeout": access.N_CR_MS,
                "max_frame_size": access.MESSAGE_CAPACITY,
                "wftmax": 10,
                "logger_name": "rrins.isotp.tool",
            },
        )
        self._layer.logger.disabled = True

    def close(self) -> None:
        """Leave the bus."""
        self._is_open = False
        self._medium.close()

    @contextlib.contextmanager
    def _on_bus(self) -> Iterator[None]:
        try:
            yield
        except can.CanError as error:
            raise BusError(f"bus {self.where}: {error}") from error

    def _send(self, data: bytes) -> None:
        self._sent.add(data)
        self._medium.send(data)

    def _is_foreign(self, frame: DiagnosticFrame) -> bool:
        """Return whether another tool sent this frame; some buses echo our own."""
        is_present = frame.data[: len(_PRESENT)] == _PRESENT
        is_own = frame.data in self._sent or frame.data in self._sent_before
        return not (frame.is_response or is_present or is_own)

    def _turn(self, wait_s: float) -> bool:
        """Wait for frames and run the layer; return whether time has advanced."""
        before_ns = self._medium.now_ns
        frames = self._medium.receive(wait_s)
        for frame in frames:
            self._is_disturbed |= self._is_foreign(frame)
            if frame.is_response:
                message = isotp.CanMessage(arbitration_id=table.response_id(), data=frame.data)
                self._inbox.append(message)
        self._clock.now_ns = self._medium.now_ns
        if frames or self._layer.transmitting() or self._layer.is_rx_active():
            self._layer.process()
        return self._clock.now_ns > before_ns

    def _turn_until(self, timeout_s: float) -> bytes | None:
        """Run until a message arrives or the timeout expires, by the transport's clock.

        If that clock stands still, the wall clock ends the wait.
        """
        end_ns = self._medium.now_ns + round(timeout_s * _NS_PER_S)
        moved = time.monotonic()
        while True:
            left_ns = end_ns - self._medium.now_ns
            has_begun = self._layer.is_rx_active()  # the layer's own timeouts end a stalled message
            if self._turn(_TURN_S if has_begun else min(_TURN_S, max(0.0, left_ns / _NS_PER_S))):
                moved = time.monotonic()
            message = self._layer.recv()
            if message is not None:
                return bytes(message)
            is_over = left_ns <= 0 and not self._layer.is_rx_active()
            if is_over or time.monotonic() - moved > max(_STANDSTILL_S, timeout_s):
                return None

    def specific_send(self, payload: bytes, timeout: float | None = None) -> None:
        """Send a request.

        Raises
        ------
        TimeoutException
            If the other end stops accepting it.
        """
        self._failures.clear()
        self._sent, self._sent_before = set(), self._sent
        moved = time.monotonic()
        with self._on_bus():
            self._clock.now_ns = self._medium.now_ns
            self._layer.send(payload)
            self._layer.process()
            while self._layer.transmitting():
                if self._turn(_SENDING_TURN_S):
                    moved = time.monotonic()
                if time.monotonic() - moved > _STANDSTILL_S:
                    self._layer.stop_sending()
                    raise _silence(f"bus {self.where} stands still")
        if self._failures:
            raise _silence(str(self._failures[0]))

    def specific_wait_frame(self, timeout: float | None = None) -> bytes:
        """Return the response, waiting up to `timeout` seconds by the transport's clock.

        Raises
        ------
        TimeoutException
            If no response arrives in time.
        DisturbedError
            If another tool sends requests at the same time.
        """
        with self._on_bus():
            message = self._turn_until(timeout or 0.0)
        if self._is_disturbed:
            self._is_disturbed = False
            raise DisturbedError(
                f"bus {self.where}: another diagnostic tool is active, and responses do not say "
                "whom they answer; use one tool at a time"
            )
        if message is None:
            raise _silence("no response")
        return message

    def empty_rxqueue(self) -> None:
        """Forget what came late."""
        self._layer.clear_rx_queue()
        if not self.keeps_pace:
            self.drain()

    def drain(self) -> None:
        """Discard unexpected frames."""
        if self.keeps_pace:
            return
        with self._on_bus():
            while frames := self._medium.receive(0.0):
                self._overhear(frames)

    def _overhear(self, frames: Iterable[DiagnosticFrame]) -> None:
        """Note whether another tool is still waiting for a response."""
        for frame in frames:
            if frame.is_response:
                self._is_disturbed = False
            elif self._is_foreign(frame):
                self._is_disturbed = True

    def pass_time(self, seconds: float) -> None:
        """Let time pass, by the transport's clock."""
        end_ns = self._medium.now_ns + round(seconds * _NS_PER_S)
        with self._on_bus():
            while (left_ns := end_ns - self._medium.now_ns) > 0:
                self._overhear(self._medium.receive(min(left_ns, _NS_PER_S) / _NS_PER_S))

    def hears_others(self) -> bool:
        """Return whether there is any traffic on the bus."""
        with self._on_bus():
            return self._medium.hears_others(_LISTEN_S)


class KernelConnection(Connection):
    """ISO-TP by a kernel socket (Linux with can-isotp).

    Parameters
    ----------
    channel : str
        The network interface.
    where : str
        Name of the bus, for errors.

    Raises
    ------
    BusError
        If the kernel has no ISO-TP sockets, or no such interface.
    """

    def __init__(self, channel: str, where: str) -> None:
        super().__init__(where)
        self._channel = channel
        self._socket: isotp.socket | None = None
        try:
            self._socket = isotp.socket()
        except (OSError, NotImplementedError, AttributeError) as error:
            raise BusError(
                f"bus {where}: this kernel has no ISO-TP sockets ({error}); run `modprobe "
                "can-isotp` or use --transport library"
            ) from error
        try:
            self._socket.set_opts(txpad=access.PADDING)
            self._socket.set_fc_opts(bs=0, stmin=0)
            self._socket.bind(channel, address=_address())
        except OSError as error:
            self._socket.close()
            raise BusError(
                f"bus {where}: cannot be opened: {error.strerror or error} (`ip link` lists the "
                "interfaces)"
            ) from error

    def close(self) -> None:
        """Leave the bus."""
        self._is_open = False
        if self._socket is not None:
            self._socket.close()

    def specific_send(self, payload: bytes, timeout: float | None = None) -> None:
        """Hand a request to the kernel, which sends it.

        Raises
        ------
        TimeoutException
            If the other end stopped accepting the previous request.
        BusError
            If the interface is missing or down.
        """
        assert self._socket is not None
        self._socket.settimeout(access.N_BS_MS / 1000 + 1.0)
        try:
            self._socket.send(payload)
        except TimeoutError as error:
            raise _silence(str(error)) from error
        except OSError as error:
            raise self._translated(error) from error

    def _translated(self, error: OSError) -> Exception:
        """Translate a socket error: the other end is silent, or the bus has failed."""
        if error.errno in _SILENCES:
            return _silence(str(error))
        return BusError(f"bus {self.where}: {error.strerror or error}")

    def specific_wait_frame(self, timeout: float | None = None) -> bytes:
        """Return the response, waiting up to `timeout` seconds of wall clock time.

        Raises
        ------
        TimeoutException
            If no response arrives in time.
        BusError
            If the interface is missing or down.
        """
        assert self._socket is not None
        self._socket.settimeout(max(timeout or 0.0, 1e-6))
        try:
            return bytes(self._socket.recv())
        except TimeoutError as error:
            raise _silence("no response") from error
        except OSError as error:
            raise self._translated(error) from error

    def empty_rxqueue(self) -> None:
        """Forget what came late."""
        assert self._socket is not None
        self._socket.settimeout(1e-6)
        with contextlib.suppress(OSError):
            while self._socket.recv():
                pass

    def pass_time(self, seconds: float) -> None:
        """Let time pass."""
        time.sleep(seconds)

    def hears_others(self) -> bool:
        """Return whether there is any traffic on the bus."""
        with open_bus(Address("socketcan", self._channel)) as bus:
            return bus.recv(_LISTEN_S) is not None
