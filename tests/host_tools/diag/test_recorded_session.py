"""A session of `rrins diag`, recorded: all of it in words, and all of it by the PDX."""

from __future__ import annotations

import odxtools
import pytest
from odxtools.decodestate import DecodeState
from odxtools.exceptions import DecodeError

from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.responses import NEGATIVE
from rrins.host_tools.descriptions.pdx import write_pdx
from rrins.host_tools.logs.diagnosis import Diagnosis
from rrins.host_tools.logs.reader import Log

pytestmark = pytest.mark.slow

SESSION = (
    ("identify",),
    ("did", "read", "--all"),
    ("did", "write", "axis_watch", "follow_tolerance_deg=2.5"),
    ("did", "write", "axis_watch", "follow_tolerance_deg=2.5", "--security"),
    ("did", "control", "excluded_sensors", "adjust", "gyros=2", "--security"),
    ("did", "control", "excluded_sensors", "return", "--security"),
    ("dtc", "read", "--all"),
    ("dtc", "read", "--freeze-frames"),
    ("dtc", "read", "gyro_2_absent"),
    ("dtc", "clear"),
    ("memory", "read", "sequencer"),
    ("routine", "start", "rotation", "--security"),
    ("routine", "start", "standby", "--security"),
    ("routine", "start", "go_to_axis_angle", "axis=inner", "angle_deg=90", "--security"),
    ("routine", "result", "go_to_axis_angle", "--security"),
    ("routine", "stop", "go_to_axis_angle", "--security"),
    ("calibration", "pull", "box.toml"),
    ("calibration", "push", "box.toml", "--security"),
    ("session", "extended"),
    ("reset", "soft", "--security"),
)


@pytest.fixture
def messages(computer, monkeypatch, tmp_path):
    """Return all messages of a session, from the frames on the bus."""
    monkeypatch.chdir(tmp_path)
    computer.bench.inject("gyro_stuck", sensor=2)
    computer.bench.advance(1.0)
    for words in SESSION:
        computer.type(*words)
    path = tmp_path / "bus.log"
    computer.bench.write_log(path)
    diagnosis = Diagnosis()
    pieces = Log(path).pieces()
    return [said for piece in pieces for _, said in diagnosis.messages(piece.frames)]


def test_a_session_of_the_tool(messages, tmp_path):
    assert len(messages) > 150
    services = {one.payload[0] for one in messages if one.sender == "tool"}
    assert services == {service.number for service in table.SERVICES} - {0x28, 0x3E, 0x85}
    assert [one.text for one in messages if "not in the diagnostic table" in one.text] == []
    assert all(one.is_whole for one in messages)
    path = tmp_path / "rrins.pdx"
    write_pdx(path)
    pdx = odxtools.load_pdx_file(path)  # its parts live as long as it does
    (ecu,) = pdx.ecu_variants
    request = b""
    for one in messages:
        request = one.payload if one.sender == "tool" else request
        assert is_explained(ecu, one.payload, request), one.text


def is_explained(ecu, message: bytes, request: bytes) -> bool:
    """Return whether a service of the request explains every byte of a message."""
    for service in ecu._find_services_for_uds(request):
        try:
            found = service.decode_message(message)
        except DecodeError:
            continue
        state = DecodeState(coded_message=message)
        found.coding_object.decode_from_pdu(state)
        if state.cursor_byte_position == len(message):
            return message[0] != NEGATIVE or "negative_response_code" in found.param_dict
    return False
