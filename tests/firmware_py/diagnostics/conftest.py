"""A tool at the computer on the bench: requests in virtual time, by bytes or by frames."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import isotp
import pytest
import udsoncan
from udsoncan.client import Client
from udsoncan.connections import BaseConnection

from rrins.dbc.frame import frame_array
from rrins.firmware_py.core.modes.modes import Mode, ModeRequest
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.access import key_of

REQUEST, FUNCTIONAL, RESPONSE = table.request_id(), table.functional_id(), table.response_id()
PATIENCE_S = 5.0


def diagnostic_frame(data: bytes, can_id: int = REQUEST) -> Any:
    frame = frame_array(1)
    frame["can_id"], frame["length"] = can_id, len(data)
    frame["data"] = int.from_bytes(data.ljust(8, b"\0"), "little")
    return frame[0]


def payload(frame: Any) -> bytes:
    return int(frame["data"]).to_bytes(8, "little")[: int(frame["length"])]


class Tool:
    """Somebody with a diagnostic tool at a bench.

    `ask` goes straight to the server, `exchange` puts frames on the bus.
    """

    def __init__(self, bench: Any) -> None:
        self.bench = bench
        self.node = bench.firmware.diagnostics
        self.server = self.node.server
        self.state = bench.state
        self.sent: list[bytes] = []
        """Diagnostic frames of the last `step`."""

    @property
    def rate_hz(self) -> int:
        return 1_000_000_000 // self.bench.period_ns

    def step(self, frames: list[bytes] = (), can_id: int = REQUEST) -> list[bytes]:  # type: ignore[assignment]  # not changed
        """Run an epoch with diagnostic frames beside its own; return those that are answered."""
        own = [diagnostic_frame(data, can_id) for data in frames]
        out = self.bench.step([*own, *self.bench.frames()])
        self.sent = [payload(frame) for frame in out if frame["can_id"] == RESPONSE]
        return self.sent

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * self.rate_hz)):
            self.step()

    def ask(self, request: str | bytes, functional: bool = False) -> str | None:
        """Return the final response to a request, in hexadecimal; None for none in 5 s."""
        request = bytes.fromhex(request) if isinstance(request, str) else request
        response = self.server.handle(request, functional, self.node.now_ns)
        for _ in range(round(PATIENCE_S * self.rate_hz)):
            if response is not None or not self.server.is_busy:
                break
            self.bench.step()
            response = self.server.poll(self.node.now_ns)
        return None if response is None else response.hex()

    def unlock(self, session: int = 3) -> None:
        self.ask("1003")
        if session != 3:
            self.ask(bytes([0x10, session]))
        seed = self.ask("2701")
        assert seed is not None
        assert self.ask(b"\x27\x02" + key_of(bytes.fromhex(seed[4:]))) == "6702"

    def functional(self, data: str) -> list[bytes]:
        """Put a functional single frame on the bus; return the frames that answer it."""
        raw = bytes.fromhex(data)
        return self.step([bytes([len(raw)]) + raw.ljust(7, b"\xcc")], FUNCTIONAL)


class BenchConnection(BaseConnection):
    """udsoncan's connection to a bench: ISO-TP frames, an epoch at a time, no threads."""

    def __init__(self, tool: Tool) -> None:
        super().__init__("bench")
        self._tool = tool
        self._out: list[bytes] = []
        self._in: list[bytes] = []
        self._layer = isotp.TransportLayerLogic(
            rxfn=self._receive,
            txfn=lambda message: self._out.append(bytes(message.data)),
            address=isotp.Address(isotp.AddressingMode.Normal_11bits, txid=REQUEST, rxid=RESPONSE),
            params={"tx_padding": 0, "blocksize": 8, "stmin": 0, "override_receiver_stmin": 0.0005},
        )

    def _receive(self) -> Any:
        if not self._in:
            return None
        return isotp.CanMessage(arbitration_id=RESPONSE, data=bytearray(self._in.pop(0)))

    def open(self) -> BenchConnection:
        return self

    def close(self) -> None: ...

    def is_open(self) -> bool:
        return True

    def empty_rxqueue(self) -> None:
        self._layer.clear_rx_queue()

    def specific_send(self, payload: bytes, timeout: float | None = None) -> None:
        self._layer.send(payload)
        while self._layer.transmitting():
            self._turn()

    def specific_wait_frame(self, timeout: float | None = None) -> bytes:
        for _ in range(round((timeout or PATIENCE_S) * self._tool.rate_hz)):
            self._turn()
            got = self._layer.recv()
            if got is not None:
                return bytes(got)
        raise udsoncan.exceptions.TimeoutException("no response")

    def _turn(self) -> None:
        self._layer.process()
        out, self._out = self._out, []
        self._in += self._tool.step(out)


class Codec(udsoncan.DidCodec):
    """udsoncan's codec of an identifier of the table."""

    def __init__(self, did: Any) -> None:
        super().__init__()
        self._did = did

    def encode(self, values: Any = None, **named: Any) -> bytes:
        return self._did.encode(values or named)

    def decode(self, data: bytes) -> Any:
        return self._did.decode(data)

    def __len__(self) -> int:
        return self._did.layout.size


def client_of(tool: Tool, connection: BaseConnection | None = None) -> Client:
    """Return udsoncan's client, told of the table."""
    config = dict(udsoncan.configs.default_client_config)
    codecs = {did.number: Codec(did) for did in table.IDENTIFIERS}
    config |= {
        "data_identifiers": codecs,
        "input_output": {d.number: codecs[d.number] for d in table.IDENTIFIERS if d.control},
        "security_algo": lambda level, seed, params: key_of(seed),
        "extended_data_size": {
            t.number: sum(layout.size for layout in table.EXTENDED_DATA.values())
            for t in table.TROUBLES
        },
        "request_timeout": 20,
        "p2_timeout": 5,
        "p2_star_timeout": 10,
        "use_server_timing": False,
    }
    client = Client(connection or BenchConnection(tool), config=config)
    client.open()
    return client


@pytest.fixture
def tool_at(tools: Any) -> Callable[..., Tool]:
    """Return what makes a tool at a bench in a mode."""

    def make(mode: Mode = Mode.STANDBY, **settings: Any) -> Tool:
        bench = tools.Bench(**settings)
        request = {
            Mode.NAVIGATION_STRAPDOWN: ModeRequest.NAVIGATE_STRAPDOWN,
            Mode.NAVIGATION_ROTATING: ModeRequest.NAVIGATE_ROTATING,
            Mode.ALIGNMENT: ModeRequest.ALIGN,
        }.get(mode)
        bench.run_to(mode, request)
        return Tool(bench)

    return make


@pytest.fixture
def tool_of() -> Callable[[Any], Tool]:
    """Return what makes a tool at a bench that there is."""
    return Tool


@pytest.fixture
def tool(tool_at: Callable[..., Tool]) -> Tool:
    """A tool at a computer in STANDBY."""
    return tool_at()


@pytest.fixture
def connect() -> Callable[[Tool], Client]:
    """Return what connects udsoncan's client to a tool's bench."""
    return client_of


@pytest.fixture(scope="session")
def _standing_by(tools: Any) -> tuple[Tool, Any, int]:
    bench = tools.Bench()
    bench.run_to(Mode.STANDBY)
    for _ in range(250):  # until all tests have been completed
        bench.step()
    return Tool(bench), bench.ram.copy(), bench.epoch


@pytest.fixture
def standing_by(_standing_by: tuple[Tool, Any, int]) -> Tool:
    """A tool at a computer in STANDBY; one for all, put back to the same moment each time."""
    tool, ram, epoch = _standing_by
    tool.node.restart()
    tool.bench.ram[:] = ram
    tool.bench.epoch = epoch
    tool.node.parameters.stored = {}
    return tool


@pytest.fixture
def at(tools: Any) -> Callable[..., Any]:
    """Return what makes a bench in a mode, all tests completed."""

    def make(mode: Mode = Mode.NAVIGATION_STRAPDOWN, **settings: Any) -> Any:
        bench = tools.Bench(**settings)
        request = {
            Mode.NAVIGATION_STRAPDOWN: ModeRequest.NAVIGATE_STRAPDOWN,
            Mode.NAVIGATION_ROTATING: ModeRequest.NAVIGATE_ROTATING,
        }.get(mode)
        bench.run_to(mode, request)
        bench.state["mode_command_counter"] = 0  # this operator does not repeat himself
        return bench

    return make
