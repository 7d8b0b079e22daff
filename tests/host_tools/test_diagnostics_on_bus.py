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
from udsoncan.connections import PythonIsoTpConnection

from firmware_py.diagnostics import table
from firmware_py.diagnostics.access import key_of
from firmware_py.modes import Mode
from host_tools.bus.interface import RrinsBus
from host_tools.direct import run_direct
from host_tools.scenario import load

SCENARIO = """
title = "Under a tool's eyes"
duration_s = {duration_s}
rate_hz = {rate_hz}
mode = "strapdown"
[gyros]
angle_random_walk_deg_per_sqrt_h = 0.001
[accelerometers]
white_noise_ug_per_sqrt_hz = 20
[firmware]
alignment_s = 0.5
"""


HEARTBEAT = 0x701


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


@contextlib.contextmanager
def client_on(channel):
    """Give udsoncan's client, on a bus end of its own, through can-isotp with its threads."""
    with attach(channel) as bus:
        address = isotp.Address(txid=table.request_id(), rxid=table.response_id())
        stack = isotp.CanStack(bus, address=address, params={"tx_padding": 0xCC})
        config = dict(udsoncan.configs.default_client_config)
        config["data_identifiers"] = {did.number: Codec(did) for did in table.IDENTIFIERS}
        config["security_algo"] = lambda level, seed, params: key_of(seed)
        # P2 is the time to a response's first frame; udsoncan measures it to the last one.
        config |= {"request_timeout": 20, "p2_timeout": 10, "use_server_timing": False}
        with Client(PythonIsoTpConnection(stack), config=config) as client:
            yield client


@pytest.fixture
def scenario(tmp_path):
    """Return what writes the scenario's file."""

    def write(duration_s=10.0, rate_hz=200):
        path = tmp_path / "watched.toml"
        path.write_text(SCENARIO.format(duration_s=duration_s, rate_hz=rate_hz), encoding="utf-8")
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


def read_everything(client):
    """Read every identifier, until the firmware navigates and once more."""
    found = {}
    for did in table.IDENTIFIERS:
        with contextlib.suppress(udsoncan.exceptions.NegativeResponseException):
            response = client.read_data_by_identifier(did.number)
            found[did.name] = response.service_data.values[did.number]
    return found


def test_reading_everything_in_a_loop_changes_nothing(rehearsal, scenario):
    path, channel = scenario(), "watched"
    finish = rehearsal(path, channel, "5")
    modes = []
    with client_on(channel) as client:
        client.change_session(3)
        for _ in range(3):
            found = read_everything(client)
            modes.append(found["mode"]["mode"])
            assert len(found) == len(table.IDENTIFIERS) - 24
            assert found["fault_counters"]["missing_frames"] == 0
        memory = client.read_memory_by_address(udsoncan.MemoryLocation(0, 2000, 24, 16))
        assert len(memory.service_data.memory_block) == 2000
        client.unlock_security_access(1)
        assert client.get_dtc_by_status_mask(0x08).service_data.dtcs == []
    assert modes[-1] == Mode.NAVIGATION_STRAPDOWN
    watched = finish()
    alone, _, _ = run_direct(load(str(path)))
    assert watched["navigation_sha256"] == alone["navigation_sha256"]
    assert watched["faults"] == alone["faults"]


def test_the_parameter_memory_lasts_from_one_run_to_the_next(rehearsal, scenario, tmp_path):
    path, file = scenario(), tmp_path / "parameters.bin"
    bridge = table.identifier("bridge").number
    finish = rehearsal(path, "first", "5", "--parameters", file)
    with client_on("first") as client:
        client.change_session(3)
        client.unlock_security_access(1)
        client.write_data_by_identifier(bridge, {"bridge_s": 0.75})
    finish()
    finish = rehearsal(path, "second", "5", "--parameters", file)
    with client_on("second") as client:
        found = read_everything(client)
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
    assert said.startswith(f"rrins: parameter memory {path}: is no memory of this kind")
    assert path.read_bytes() == before
