"""Diagnosis in a trace: what others said to each other, in words."""

from __future__ import annotations

import isotp
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.firmware_py.diagnostics import table
from rrins.host_tools.diag.trace import Trace

ASK, ALL, ANSWER = table.request_id(), table.functional_id(), table.response_id()


def said(*messages: tuple[int, str]) -> list[str]:
    """Return the texts of messages, each a CAN identifier and its bytes, short or long."""
    trace = Trace()
    texts = []
    for can_id, text in messages:
        for frame in frames_of(bytes.fromhex(text)):
            texts += [message.text for message in trace.add(can_id, frame)]
    return texts


def frames_of(payload: bytes) -> list[bytes]:
    """Return the frames that can-isotp makes of a message."""
    sent: list[bytes] = []
    flow = [isotp.CanMessage(arbitration_id=ANSWER, data=bytearray(b"\x30\x00\x00"))]
    layer = isotp.TransportLayerLogic(
        rxfn=lambda: flow.pop() if flow and sent else None,
        txfn=lambda message: sent.append(bytes(message.data)),
        address=isotp.Address(isotp.AddressingMode.Normal_11bits, txid=ASK, rxid=ANSWER),
        params={"tx_padding": 0xCC, "stmin": 0, "override_receiver_stmin": 0},
    )
    layer.send(payload)
    while layer.transmitting():
        layer.process()
    return sent


@pytest.mark.parametrize(
    ("asked", "answered", "request_text", "response_text"),
    [
        ("1003", "5003003201f4", "diagnostic_session_control_extended",
            "diagnostic_session_control_extended: p2_ms 50 ms, p2_star_10ms 500"),
        ("220102", "6201020500", "read_mode", "read_mode: mode NAVIGATION_ROTATING, fault NONE"),
        ("22f186ffff", "62f18601", "read_identifiers: active_session, 0xFFFF",
            "read_active_session: session DEFAULT"),
        ("220102f186", "6201020500f18601", "read_identifiers: mode, active_session",
            "read_identifiers: mode (mode NAVIGATION_ROTATING, fault NONE), "
            "active_session (session DEFAULT)"),
        ("2e10043fe0000000000000", "6e1004", "write_bridge: bridge_s 0.5 s", "write_bridge"),
        ("2e10043fe0000000000000", "7f2e33", "write_bridge: bridge_s 0.5 s",
            "write_bridge refused: securityAccessDenied (0x33): the computer is locked"),
        ("31010203004056800000000000", "7f3178",
            "start_go_to_axis_angle: axis INNER, angle_deg 90 °",
            "start_go_to_axis_angle delayed: requestCorrectlyReceived_ResponsePending (0x78): "
            "processing takes longer; the response follows"),
        ("190208", "59027f" + "d10387" + "2f", "report_dtc_by_status_mask: status_mask 8",
            "report_dtc_by_status_mask: status_availability_mask 127, "
            "sensor_3_silent (U1103-87) failed now, pending, confirmed"),
        ("1906d1038701", "6706", "report_dtc_ext_data_record_by_dtc_number: sensor_3_silent "
            "(U1103-87), record_number 1", "SecurityAccess: 67 06: not in the diagnostic table"),
        ("2324000000000004", "6340" + "4b4c00",
            "read_memory: address 0, size 4 bytes", "read_memory: 40 4b 4c 00"),
        ("3e80", "7e00", "tester_present_zero_sub_function_quiet",
            "tester_present_zero_sub_function"),
        ("ba01", "7fba11", "service 0xBA: ba 01: not in the diagnostic table",
            "service 0xBA refused: serviceNotSupported (0x11): no such service"),
    ],
)  # fmt: skip
def test_words(asked, answered, request_text, response_text):
    assert said((ASK, asked), (ANSWER, answered)) == [request_text, response_text]


def test_a_functional_request():
    (message,) = Trace().add(ALL, bytes.fromhex("023e00cccccccccc"))
    assert (message.sender, message.text) == ("tool to all", "tester_present_zero_sub_function")


def test_a_lost_frame_breaks_its_message_off():
    first, second, *rest = frames_of(bytes(range(40)))
    trace = Trace()
    assert trace.add(ASK, first) == trace.add(ASK, second) == []
    (broken,) = trace.add(ASK, rest[1])
    assert broken.text == "incomplete message: 13 of 40 bytes"
    assert broken.is_warning
    assert trace.add(ASK, rest[2]) == []
    assert [one.text for one in trace.add(ASK, bytes.fromhex("03220102"))] == ["read_mode"]


@given(st.binary(max_size=8), st.sampled_from([ASK, ALL, ANSWER, 0x123]))
def test_no_frame_is_too_odd(data, can_id):
    trace = Trace()
    for frame in (data, bytes.fromhex("100a220102010201"), data):
        for message in trace.add(can_id, frame):
            assert message.text


@given(st.binary(min_size=1, max_size=300))
def test_every_payload_comes_out_as_it_was(payload):
    trace = Trace()
    messages = [one for frame in frames_of(payload) for one in trace.add(ANSWER, frame)]
    assert [one.payload for one in messages] == [payload]
