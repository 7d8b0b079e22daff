"""The XCP master: pyxcp on a bus of the rehearsal."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from queue import SimpleQueue
from typing import Any

import can
import numpy as np
from can.typechecking import CanFilter
from pyxcp.config import create_application_from_config
from pyxcp.master.master import Master
from pyxcp.transport.can import CanInterfaceBase
from pyxcp.transport.transport_ext import FrameAcquisitionPolicy, FrameCategory
from pyxcp.types import XcpGetSeedMode, XcpResponseError, XcpTimeoutError

from rrins.dbc.codec import load
from rrins.firmware_py.diagnostics.access import KEY_SIZE, key_of
from rrins.firmware_py.xcp.layout import epk
from rrins.firmware_py.xcp.memory import EPK_ADDRESS
from rrins.firmware_py.xcp.protocol import BLOCK_CAPACITY, MAX_CTO, Resource
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.pace import attach_in_pace
from rrins.host_tools.bus.port import open_bus
from rrins.host_tools.closing import Closing
from rrins.host_tools.errors import BusError, XcpError
from rrins.host_tools.xcp.signals import Signal

DEFAULT_TIMEOUT_S = 2.0
_DOWNLOAD = MAX_CTO - 2
_A2L_TEXT = 4  # of GET_ID


class _Interface(CanInterfaceBase):
    """A bus as pyxcp wants it; remembers why it ended."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self.end: can.CanError | None = None

    def set_filters(self, filters: Any = None) -> None:
        self._bus.set_filters(filters)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        try:
            return self._bus.recv(timeout)
        except can.CanError as error:
            self.end = error
            time.sleep(timeout or 0.0)
            return None

    def send(self, msg: can.Message) -> None:
        self._bus.send(msg)

    @property
    def filters(self) -> Any:
        return self._bus.filters

    @property
    def state(self) -> can.BusState:
        return can.BusState.ACTIVE


class _Measured(FrameAcquisitionPolicy):  # type: ignore[misc]  # compiled: of no known type
    """Keeps the packets of measured data, and the events."""

    def __init__(self) -> None:
        super().__init__()
        self.packets: SimpleQueue[bytes] = SimpleQueue()
        self.events: SimpleQueue[int] = SimpleQueue()

    def feed(self, category: Any, counter: int, timestamp: int, payload: bytes) -> None:
        if category == FrameCategory.DAQ:
            self.packets.put(bytes(payload))
        elif category == FrameCategory.EVENT:
            self.events.put(payload[1])

    def finalize(self) -> None: ...


class XcpMaster(Closing):
    """A session with the navigation computer.

    Parameters
    ----------
    address : Address
        The bus.
    timeout_s : float
        Longest wait for an answer.

    Attributes
    ----------
    packets, events : SimpleQueue
        Measured data, and codes of events, as they have come.

    Raises
    ------
    BusError
        If the bus cannot be opened.
    XcpError
        If nobody answers, or the computer has another memory layout than this version.
    """

    def __init__(self, address: Address, timeout_s: float = DEFAULT_TIMEOUT_S) -> None:
        self._where = str(address)
        self._bus = (
            attach_in_pace(address, "xcp", timeout_s)[0]
            if address.is_embedded
            else open_bus(address)
        )
        identifier = load().frame_id("XCP_RESPONSE")
        self._bus.set_filters([CanFilter(can_id=identifier, can_mask=0x7FF, extended=False)])
        self._interface = _Interface(self._bus)
        policy = _Measured()
        self.packets, self.events = policy.packets, policy.events
        self.raw = Master(
            "can", _configuration(timeout_s), policy, transport_layer_interface=self._interface
        )
        try:
            self.raw.transport.connect()
            with self._asking("connect"):
                self.raw.connect()
            self._check_layout()
        except BaseException:
            self.close()
            raise

    def _check_layout(self) -> None:
        found = self.read_bytes(EPK_ADDRESS, len(epk())).decode("ascii", "replace")
        if found != epk():
            raise XcpError(
                f"bus {self._where}: the computer's memory is that of {found!r}, this version's "
                f"that of {epk()!r}; use the rrins that it runs"
            )

    @contextlib.contextmanager
    def _asking(self, what: str) -> Iterator[None]:
        """Turn what goes wrong into one line."""
        try:
            yield
        except XcpResponseError as error:
            name = error.get_error_code()  # type: ignore[no-untyped-call]  # pyxcp has no types
            raise XcpError(f"xcp {what}: refused, {name}") from error
        except XcpTimeoutError as error:
            self.check_bus()
            raise XcpError(
                f"bus {self._where}: no answer over XCP; the scenario needs the table [xcp]"
            ) from error
        except can.CanError as error:
            raise BusError(f"bus {self._where}: {error}") from error

    def check_bus(self) -> None:
        """Raise `BusError` if the bus has ended."""
        if self._interface.end is not None:
            raise BusError(f"bus {self._where}: {self._interface.end}")

    @property
    def has_ended(self) -> bool:
        """Whether the bus has ended."""
        return self._interface.end is not None

    def command(self, what: str, command: Callable[[], Any]) -> Any:
        """Return what a command of pyxcp's master returns.

        Raises
        ------
        XcpError
            If it is refused, or nobody answers.
        BusError
            If the bus has ended.
        """
        with self._asking(what):
            return command()

    def read_bytes(self, address: int, size: int) -> bytes:
        """Read memory; each part of up to 255 bytes is of one epoch."""
        self.command("set address", lambda: self.raw.setMta(address))
        return self._upload(size)

    def _upload(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            part = min(BLOCK_CAPACITY, size - len(data))
            data += bytes(self.command("read", partial(self.raw.upload, part)))[:part]
        return data

    def a2l(self) -> str:
        """Return the A2L file that the computer gives."""
        found = self.command("identify", lambda: self.raw.getId(_A2L_TEXT))
        return self._upload(int(found.length)).decode()

    def unlock(self, resource: Resource) -> None:
        """Get access by seed and key."""
        raw = self.raw
        first = self.command("seed", lambda: raw.getSeed(XcpGetSeedMode.FIRST_PART, resource))
        if not first.length:
            return
        seed = bytes(first.seed)
        rest = self.command("seed", lambda: raw.getSeed(XcpGetSeedMode.REMAINING, resource))
        key = key_of((seed + bytes(rest.seed))[: int(first.length)])
        for k in range(0, KEY_SIZE, _DOWNLOAD):
            self.command("unlock", partial(raw.unlock, KEY_SIZE - k, key[k : k + _DOWNLOAD]))

    def write(self, signal: Signal, value: float) -> None:
        """Change a parameter; it takes effect between two steps.

        Raises
        ------
        XcpError
            If it is not a parameter, or out of its limits.
        """
        limits = signal.limits
        if limits is None:
            raise XcpError(f"signal {signal.name}: is measured, and cannot be written")
        if not limits.minimum <= value <= limits.maximum:
            raise XcpError(
                f"signal {signal.name}: {value:g} is not from {limits.minimum:g} to "
                f"{limits.maximum:g}"
            )
        data = signal.field.dtype.type(value).tobytes()
        self.unlock(Resource.CALIBRATION)
        self.command("set address", lambda: self.raw.setMta(signal.address))
        self.command("write", lambda: self._download(data))

    def _download(self, data: bytes) -> None:
        """Write a number as one block."""
        first, rest = data[:_DOWNLOAD], data[_DOWNLOAD:]
        if not rest:
            self.raw.download(first)
            return
        self.raw.download(first, block_mode_length=len(data))
        self.raw.downloadNext(rest, len(rest), last=True)

    def close(self) -> None:
        """End the session and leave the bus."""
        with contextlib.suppress(XcpResponseError, XcpTimeoutError, can.CanError):
            if not self.has_ended:
                self.raw.disconnect()
        self.raw.close()
        self.raw.transport.listener.join()
        self._bus.shutdown()


def _configuration(timeout_s: float) -> Any:
    configuration = create_application_from_config(log_level=logging.CRITICAL)
    configuration.general.disable_error_handling = True
    configuration.transport.timeout = timeout_s
    configuration.transport.can.can_id_master = load().frame_id("XCP_COMMAND")
    configuration.transport.can.can_id_slave = load().frame_id("XCP_RESPONSE")
    for name in ("pyxcp", "pyxcp.master", "pyxcp.transport", "PyXCP"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    return configuration


def values_of(master: XcpMaster, signals: Sequence[Signal]) -> dict[str, float]:
    """Return the present values of signals by name."""
    found: dict[str, float] = {}
    for signal in signals:
        data = master.read_bytes(signal.address, signal.size)
        found[signal.name] = float(np.frombuffer(data, dtype=signal.field.dtype)[0])
    return found
