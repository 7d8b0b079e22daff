"""`rrins diag`, udsoncan and gallia at a navigation computer on the kernel's vcan0.

Runs where vcan0 is; with RRINS_REQUIRE_SOCKETCAN set, its lack is a failure. All 65,536
identifiers are tried in virtual time, by `tests/host_tools/diag/test_scanner.py`.
"""

from __future__ import annotations

import json
import re

import can
import isotp
import pytest
import udsoncan
from click.testing import CliRunner
from udsoncan.client import Client
from udsoncan.connections import IsoTPSocketConnection

from rrins.__main__ import main
from rrins.dbc.codec import load
from rrins.firmware_py.diagnostics import calibration_image as image
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.access import Session, key_of
from rrins.host_tools.cli.main import rrins
from rrins.host_tools.diag.target import Target
from rrins.host_tools.diag.tester import Tester as Tool
from tests.socketcan.conftest import forked

START_S = 300
TARGET = (
    f"isotp://vcan0?tx_id={table.request_id():#x}&rx_id={table.response_id():#x}&tx_padding=0xcc"
)


@pytest.fixture(scope="module")
def rehearsal(tmp_path_factory):
    """A rehearsal in lockstep, in real time at most, so that no machine is too slow for it."""
    said = tmp_path_factory.mktemp("diag")
    bus = ("--interface", "socketcan", "--channel", "vcan0", "--speed", "0.99")
    sides = [
        forked(main, ["rrins", side, "rimu_rotating", *bus], said / side)
        for side in ("hardware", "firmware")
    ]

    def heard():
        return "".join(path.read_text() for path in said.iterdir())

    try:
        with can.Bus("vcan0", interface="socketcan") as listener:
            navigates = load().frame_id("NAV_LATITUDE")
            listener.set_filters([{"can_id": navigates, "can_mask": 0x7FF}])
            assert listener.recv(START_S) is not None, heard()
        yield sides
        assert all(side.is_alive() for side in sides), heard()
    finally:
        for side in sides:
            side.terminate()
            side.join(60)


def diag(*words):
    bus = ("--interface", "socketcan", "--channel", "vcan0", "--timeout", "20")
    ended = CliRunner().invoke(rrins, ["diag", *words, "--json", *bus, "--transport", "kernel"])
    assert ended.exit_code == 0, ended.stderr
    return json.loads(ended.stdout)


@pytest.mark.timeout(500)
def test_the_tool_by_the_kernels_sockets(rehearsal, tmp_path):
    """By can-isotp, the other way, it reads in the tests below."""
    values = diag("did", "read", "--all")
    assert values["table_version"]["table_crc32"] == table.crc32()
    assert values["position"]["latitude_deg"] == pytest.approx(40.3554, abs=1e-3)
    assert diag("memory", "read", "heard")["heard"]["size"] > 4000  # several requests
    file = tmp_path / "calibration.rrca"
    diag("calibration", "pull", str(file))
    parameters = image.decode(file.read_bytes())
    parameters[0x1004] = {"bridge_s": 0.25}
    file.write_bytes(image.encode(parameters))
    diag("calibration", "push", str(file), "--security")
    found = diag("did", "read", "bridge")
    assert found == {"bridge": parameters[0x1004]}


class Codec(udsoncan.DidCodec):
    def __init__(self, did):
        super().__init__()
        self._did = did

    def encode(self, *values):
        return self._did.encode(*values)

    def decode(self, data):
        return self._did.decode(data)

    def __len__(self):
        return self._did.layout.size


@pytest.mark.timeout(800)
def test_udsoncan_as_it_is_over_the_kernels_isotp_sockets(rehearsal):
    address = isotp.Address(txid=table.request_id(), rxid=table.response_id())
    config = udsoncan.configs.default_client_config | {
        "data_identifiers": {did.number: Codec(did) for did in table.IDENTIFIERS},
        "security_algo": lambda level, seed, params: key_of(seed),
        "use_server_timing": False,
        "request_timeout": 60,
        "p2_timeout": 20,
    }
    with Client(IsoTPSocketConnection("vcan0", address), config=config) as client:
        gyros = table.identifier("gyro_increments").number
        found = client.read_data_by_identifier(gyros).service_data.values[gyros]
        assert len(found["gyro_dtheta"]) == 16
        supported = client.get_supported_dtc().service_data.dtcs
        assert {dtc.id for dtc in supported} <= set(table.TROUBLE_BY_NUMBER)
        client.change_session(3)
        client.unlock_security_access(1)
        weights = table.identifier("gyro_weights")
        before = client.read_data_by_identifier(weights.number).service_data.values[weights.number]
        client.write_data_by_identifier(weights.number, before)  # more than one frame
        with pytest.raises(udsoncan.exceptions.NegativeResponseException) as refused:
            client.write_data_by_identifier(weights.number, {"weights": (0.0,) * 16})
        assert refused.value.response.code == 0x31


def numbers(pattern, said):
    """Return what stands in the hexadecimal group of a pattern, in each line that has it."""
    return {int(found, 16) for found in re.findall(pattern, said, re.MULTILINE)}


@pytest.mark.timeout(600)
@pytest.mark.soak
@pytest.mark.parametrize("session", [Session.DEFAULT, Session.EXTENDED])
def test_gallia_finds_the_services_of_the_table_only(gallia, rehearsal, session):
    said = gallia(TARGET, "services", "--sessions", str(int(session)))
    found = numbers(r"  \[(0x[0-9a-fA-F]+)\]", said)
    assert found == {one.number for one in table.SERVICES if session in one.access.sessions}


@pytest.mark.timeout(600)
@pytest.mark.soak
def test_gallia_finds_the_sessions_of_the_table_only(gallia, rehearsal):
    said = gallia(TARGET, "sessions", "--depth", "2")
    assert numbers(r"\* Session (0x[0-9a-fA-F]+)", said) == {int(session) for session in Session}


@pytest.mark.timeout(900)
@pytest.mark.soak
def test_gallia_finds_the_identifiers_of_the_table_only(gallia, rehearsal):
    first, last = 0x0FF0, 0x1010
    said = gallia(TARGET, "identifiers", "--start", hex(first), "--end", hex(last))
    with Tool(Target("socketcan", "vcan0", timeout_s=20.0)) as tester:
        there = {did.number for did in tester.has(table.IDENTIFIERS)}
    found = numbers(r"(0x[0-9a-fA-F]+): .*Response", said)
    assert found == {number for number in there if first <= number <= last}
