"""Checks of what a navigation computer does: start-up, modes, commands, axes, diagnostics."""

from __future__ import annotations

import time

import can

from rrins.host_tools.conformance.check import NotApplicableError, Subject, expect_mode
from rrins.host_tools.testing.bench import Bench
from rrins.host_tools.testing.expectation import Where

_COMMANDS = ("AXIS_INNER_COMMAND", "AXIS_OUTER_COMMAND")
_MODULUS = 15
_END_S = 5.0


def start_up(subject: Subject) -> None:
    """Heartbeat, status, self-test, standby."""
    bench = subject.bench(navigate_at_s=3600)
    bench.expect("HEARTBEAT_FIRMWARE", within=1.5)
    bench.expect("FIRMWARE_STATUS", within=0.3)
    expect_mode(bench, "STANDBY", 2)
    bench.expect("FIRMWARE_STATUS", within=1.05, at_least=10)
    bench.expect("HEARTBEAT_FIRMWARE", within=2.05, at_least=2)
    bench.expect_not("NAV_LATITUDE", within=0.5)


def self_test(subject: Subject) -> None:
    """A sensor that is absent from power-on."""
    faults = [{"kind": "gyro_absent", "sensor": 1, "at_s": 0.0}]
    bench = subject.bench(faults=faults, redundancy={"enabled": False})
    where = {"mode": "FAULT", "fault": "SELF_TEST_FAILED"}
    bench.expect("FIRMWARE_STATUS", within=11, where=where)
    assert bench.time_s > 9.5, f"the self-test failed after {bench.time_s:.1f} s, not 10 s"
    bench.clear_faults()
    bench.send("MODE_COMMAND", mode_request="STANDBY")
    expect_mode(bench, "STANDBY", 2)


def commands(subject: Subject) -> None:
    """A command for each axis in each epoch, with its counter; the outer axis' is the last."""
    bench = subject.navigating()
    first = {name: len(bench.messages(name)) for name in _COMMANDS}
    begin = round(bench.time_s * bench.scenario.rate_hz)
    bench.advance(1)
    for name in _COMMANDS:
        came = list(bench.messages(name))[first[name] :]
        assert len(came) == bench.scenario.rate_hz, (
            f"{len(came)} {name} in {bench.scenario.rate_hz} epochs"
        )
        wrong = [k for k, one in enumerate(came) if one["alive_counter"] != (begin + k) % _MODULUS]
        assert not wrong, f"{name} has the counter of another epoch in {len(wrong)} of {len(came)}"
        assert all(one["crc_holds"] for one in came), f"{name} has a wrong CRC"


def modes(subject: Subject) -> None:
    """All modes in turn, on request."""
    bench = subject.bench(navigate_at_s=3600)
    expect_mode(bench, "STANDBY", 2)
    _request(bench, "ALIGN", "ALIGNMENT")
    bench.advance(2)
    assert bench.mode == "ALIGNMENT", "ALIGN alone goes on into navigation"
    _request(bench, "NAVIGATE_STRAPDOWN", "NAVIGATION_STRAPDOWN")
    bench.expect("AXIS_INNER_COMMAND", within=0.05, where={"command": "HOLD"})
    _request(bench, "NAVIGATE_ROTATING", "NAVIGATION_ROTATING")
    bench.expect("AXIS_INNER_COMMAND", within=0.05, where={"command": "POSITION"})
    bench.expect("NAV_LATITUDE", within=1.05, at_least=20)
    _request(bench, "NAVIGATE_STRAPDOWN", "NAVIGATION_STRAPDOWN")
    _request(bench, "STANDBY", "STANDBY")
    bench.expect_not("NAV_LATITUDE", within=0.5)


def shutdown(subject: Subject) -> None:
    """SHUTDOWN switches the axes off, and the program ends."""
    bench = subject.navigating()
    process = bench.process
    bench.send("MODE_COMMAND", mode_request="SHUTDOWN")
    bench.expect("AXIS_OUTER_COMMAND", within=0.02, where={"command": "OFF"})
    deadline = time.monotonic() + _END_S
    while process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    assert process.poll() is not None, f"the program still runs {_END_S:g} s after SHUTDOWN"
    assert process.poll() == 0, f"the program ends with status {process.poll()} after SHUTDOWN"


def _request(bench: Bench, request: str, mode: str) -> None:
    bench.send("MODE_COMMAND", mode_request=request)
    expect_mode(bench, mode, 2)


def axis_fault(subject: Subject) -> None:
    """An axis that stands still while it should turn, for 20 s."""
    bench = subject.navigating()
    bench.inject("axis_stall", axis="inner", for_s=20.0)
    where: Where = {"mode": "NAVIGATION_STRAPDOWN", "axis_inner_not_following": 1}
    bench.expect("FIRMWARE_STATUS", within=8, where=where)
    bench.expect("AXIS_INNER_COMMAND", within=0.05, where={"command": "HOLD"})
    bench.advance(1)
    assert bench.navigation is not None, "navigation has ended"
    expect_mode(bench, "NAVIGATION_ROTATING", 30)


def axis_silent(subject: Subject) -> None:
    """An axis whose status does not come for longer than `axis_silence_s`."""
    bench = subject.navigating()
    bench.inject("drop", message="AXIS_OUTER_STATUS", for_s=1.5)
    where: Where = {"mode": "NAVIGATION_STRAPDOWN", "axis_outer_not_following": 1}
    bench.expect("FIRMWARE_STATUS", within=1.5, where=where)


def uds(subject: Subject) -> None:
    """TesterPresent, a session, an unknown service."""
    bench = subject.bench(navigate_at_s=3600)
    expect_mode(bench, "STANDBY", 2)
    bench.send_frame(_diagnostic(bytes([0x02, 0x3E, 0x00])))
    bench.advance(0.5)
    if not bench.messages("DIAG_RESPONSE"):
        raise NotApplicableError("it has no UDS: nothing answers TesterPresent")
    answers = [_answer(bench, request) for request in (b"\x3e\x00", b"\x10\x01", b"\xba\x00")]
    assert answers[0][:2] == b"\x7e\x00", f"TesterPresent is answered by {answers[0].hex(' ')}"
    assert answers[1][:2] == b"\x50\x01", f"the default session is answered {answers[1].hex(' ')}"
    assert answers[2] == b"\x7f\xba\x11", f"an unknown service is answered {answers[2].hex(' ')}"


def _diagnostic(single: bytes) -> can.Message:
    """Return a request to the computer: an ISO-TP single frame, padded."""
    return can.Message(arbitration_id=0x7E0, is_extended_id=False, data=single.ljust(8, b"\xaa"))


def _answer(bench: Bench, request: bytes) -> bytes:
    """Return the answer to a request; both fit into a single frame, else its first bytes."""
    seen = len(bench.messages("DIAG_RESPONSE"))
    bench.send_frame(_diagnostic(bytes([len(request)]) + request))
    bench.advance(0.5)
    answers = list(bench.messages("DIAG_RESPONSE"))[seen:]
    assert answers, f"no answer to {request.hex(' ')} within 0.5 s"
    last = answers[-1]
    payload = bytes(int(last[f"byte_{k}"]) for k in range(1, 8))
    return payload[: int(last["length_or_index"])]
