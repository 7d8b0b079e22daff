"""A diagnostic tool on the embedded bus of a running firmware; what it costs the navigation."""

from __future__ import annotations

import contextlib
import json
import select

import can
import isotp
import pytest
import udsoncan
from udsoncan.client import Client
from udsoncan.connections import BaseConnection, PythonIsoTpConnection

from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.access import key_of
from rrins.host_tools.bus.interface import RrinsBus

SCENARIO = """
title = "Under a tool's eyes"
duration_s = {duration_s}
mode = "strapdown"
[gyros]
angle_random_walk_deg_per_sqrt_h = 0.001
[accelerometers]
white_noise_ug_per_sqrt_hz = 20
[firmware]
alignment_s = 0.5
"""
HEARTBEAT = 0x701
NAVIGATION = ("NAV_LATITUDE", "NAV_LONGITUDE", "NAV_HEIGHT", "NAV_VELOCITY", "NAV_ATTITUDE")
PATIENCE_S = 20
ABSENT = 2 * 12 * 2  # calibration and its sigma, of 12 gyros and 12 accelerometers


class Codec(udsoncan.DidCodec):
    def __init__(self, did):
        super().__init__()
        self._did = did

    def encode(self, values=None, **named):
        return self._did.encode(values or named)

    def decode(self, data):
        return self._did.decode(data)

    def __len__(self):
        return self._did.layout.size


def client_of(connection):
    config = dict(udsoncan.configs.default_client_config)
    config["data_identifiers"] = {did.number: Codec(did) for did in table.IDENTIFIERS}
    config["security_algo"] = lambda level, seed, params: key_of(seed)
    # P2 is the time to a response's first frame; udsoncan measures it to the last one.
    config |= {"request_timeout": PATIENCE_S, "p2_timeout": PATIENCE_S, "use_server_timing": False}
    return Client(connection, config=config)


def address():
    return isotp.Address(txid=table.request_id(), rxid=table.response_id())


# In virtual time: the world waits for the tool


class BenchConnection(BaseConnection):
    """udsoncan's connection to a bench: each turn is an epoch."""

    def __init__(self, bench):
        super().__init__("bench")
        self._bench = bench
        self._period_s = bench.scenario.period_ns / 1e9
        self._layer = isotp.TransportLayerLogic(
            rxfn=self._receive,
            txfn=self._transmit,
            address=address(),
            params={"override_receiver_stmin": 0.0, "rx_consecutive_frame_timeout": 10_000},
        )

    def _receive(self):
        message = self._bench.bus.recv(0.0)
        if message is None:
            return None
        return isotp.CanMessage(arbitration_id=message.arbitration_id, data=message.data)

    def _transmit(self, message):
        self._bench.send_frame(
            can.Message(
                arbitration_id=message.arbitration_id, data=message.data, is_extended_id=False
            )
        )

    def _turn(self):
        self._layer.process()
        self._bench.advance(self._period_s)

    def open(self):
        return self

    def close(self): ...

    def is_open(self):
        return True

    def empty_rxqueue(self):
        self._layer.clear_rx_queue()

    def specific_send(self, payload, timeout=None):
        self._layer.send(payload)

    def specific_wait_frame(self, timeout=None):
        for _ in range(round((timeout or PATIENCE_S) / self._period_s)):
            self._turn()
            got = self._layer.recv()
            if got is not None:
                return bytes(got)
        raise udsoncan.exceptions.TimeoutException("no response")


@pytest.fixture
def bench_of(rrins_bench, tmp_path):
    path = tmp_path / "watched.toml"
    path.write_text(SCENARIO.format(duration_s=20.0), encoding="utf-8")
    return lambda: rrins_bench(path, way="lockstep")


def read_everything(client):
    found = {}
    for did in table.IDENTIFIERS:
        with contextlib.suppress(udsoncan.exceptions.NegativeResponseException):
            response = client.read_data_by_identifier(did.number)
            found[did.name] = response.service_data.values[did.number]
    return found


def said(bench):
    """Return all that the firmware has said of its navigation."""
    return {name: [dict(values) for values in bench.messages(name)] for name in NAVIGATION}


def test_reading_everything_in_a_loop_changes_nothing(bench_of):
    watched = bench_of()
    watched.expect("NAV_ATTITUDE", within=5.0)
    with client_of(BenchConnection(watched)) as client:
        client.change_session(3)
        for _ in range(3):
            found = read_everything(client)
            assert len(found) == len(table.IDENTIFIERS) - ABSENT
        memory = client.read_memory_by_address(udsoncan.MemoryLocation(0, 4000, 24, 16))
        assert len(memory.service_data.memory_block) == 4000
        client.unlock_security_access(1)
        assert client.get_dtc_by_status_mask(0x08).service_data.dtcs == []
    assert found["fault_counters"]["missing_frames"] == 0
    watched.advance(1.0)
    alone = bench_of()
    alone.advance(watched.time_s)
    assert alone.time_s == watched.time_s
    assert said(watched) == said(alone)
    assert len(said(alone)["NAV_ATTITUDE"]) > 60


# As processes


def attach(channel):
    """Return an end on a channel once the firmware is at work on it."""
    while True:
        try:
            bus = RrinsBus(channel, host="never", name="tool")
        except can.CanError:
            select.select([], [], [], 0.05)
        else:
            break
    while True:
        message = bus.recv(60.0)
        assert message is not None, "no firmware"
        if message.arbitration_id == HEARTBEAT:
            return bus


@contextlib.contextmanager
def client_on(channel):
    """Give udsoncan's client, on a bus end of its own, through can-isotp with its threads."""
    with attach(channel) as bus:
        stack = isotp.CanStack(bus, address=address(), params={"tx_padding": 0xCC})
        with client_of(PythonIsoTpConnection(stack)) as client:
            yield client


@pytest.fixture
def scenario(tmp_path):
    """Return what writes the scenario's file."""

    def write(duration_s=4.0):
        path = tmp_path / "watched.toml"
        path.write_text(SCENARIO.format(duration_s=duration_s), encoding="utf-8")
        return path

    return write


@pytest.fixture
def rehearsal(start):
    """Start both sides on a channel; return what waits for their end and gives the summary."""

    def both(path, channel, speed, *options):
        hardware = start("hardware", path, "--channel", channel, "--speed", speed)
        firmware = start(
            "firmware", path, "--json", "--channel", channel, "--speed", speed, *options,
            "--attach-wait", 60,
        )  # fmt: skip

        def finish():
            status, out = firmware.finish()
            assert status == 0, firmware.said
            assert hardware.finish()[0] == 0, hardware.said
            return json.loads(out)

        return finish

    return both


def test_the_parameter_memory_lasts_from_one_run_to_the_next(rehearsal, scenario, tmp_path):
    path, file = scenario(), tmp_path / "parameters.bin"
    bridge = table.identifier("bridge").number
    finish = rehearsal(path, "first", "1", "--parameters", file)
    with client_on("first") as client:
        client.change_session(3)
        client.unlock_security_access(1)
        client.write_data_by_identifier(bridge, {"bridge_s": 0.75})
    finish()
    finish = rehearsal(path, "second", "1", "--parameters", file)
    with client_on("second") as client:
        names = ("bridge", "parameter_memory", "operation_cycles")
        numbers = {name: table.identifier(name).number for name in names}
        values = client.read_data_by_identifier(list(numbers.values())).service_data.values
    found = {name: values[number] for name, number in numbers.items()}
    assert found["bridge"] == {"bridge_s": 0.75}
    assert found["parameter_memory"]["parameters"] == 1
    assert found["operation_cycles"]["operation_cycles"] == 2
    finish()


def test_a_file_that_is_no_parameter_memory_is_refused(start, scenario):
    path = scenario()
    before = path.read_bytes()
    command = start("firmware", path, "--parameters", path)
    assert command.finish()[0] == 11
    said = command.said[-1]
    assert said.startswith(f"rrins: parameter memory {path}: not a memory of this kind")
    assert path.read_bytes() == before
