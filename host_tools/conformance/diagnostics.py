"""Checks of UDS (ISO 14229-1) where a navigation computer has it, frame by frame."""

from __future__ import annotations

from typing import Final

import can

from rrins.dbc.codec import load
from rrins.firmware_py.diagnostics.access import DEFAULT_SECRET, key_of
from rrins.host_tools.conformance.check import NotApplicableError, Subject, check, expect_mode
from rrins.host_tools.testing.bench import Bench

_ANSWER_S: Final = 0.5
_S3_S: Final = 5.0
_LOSS_S: Final = 4.0
_FRAME: Final = 8
_TWO_FRAMES: Final = 13
_PAUSE_S: Final = 0.1
_SINGLE, _FIRST, _CONSECUTIVE = 0, 1, 2
_KINDS: Final = {"SINGLE": 0, "FIRST": 1, "CONSECUTIVE": 2, "FLOW_CONTROL": 3}
_GO_ON: Final = bytes([0x30, 0x00, 0x00])
_TESTER_PRESENT: Final = b"\x3e\x00"
_DEFAULT: Final = b"\x10\x01"
_EXTENDED: Final = b"\x10\x03"
_SEED: Final = b"\x27\x01"
_CLEAR: Final = b"\x14\xff\xff\xff"
_COUNT_FAILED: Final = b"\x19\x01\x01"
_LIST_CONFIRMED: Final = b"\x19\x02\x08"
_HARD_RESET: Final = b"\x11\x01"
_ANY_PARAMETER: Final = (0x1004, 0x1005, 0xF190)
_LOCKED: Final = b"\x33"
_NOT_HERE: Final = (b"\x7f", b"\x7e")


class _Tool:
    """A diagnostic tool on a bench.

    Raises
    ------
    NotApplicableError
        If nothing answers TesterPresent.
    """

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._ids = {
            name: load().database.get_message_by_name(name).frame_id
            for name in ("DIAG_REQUEST", "DIAG_FUNCTIONAL")
        }
        if self.ask(_TESTER_PRESENT) is None:
            raise NotApplicableError("it has no UDS: nothing answers TesterPresent")

    def _send(self, data: bytes, name: str = "DIAG_REQUEST") -> None:
        frame = data.ljust(8, b"\xaa")
        self._bench.send_frame(
            can.Message(arbitration_id=self._ids[name], is_extended_id=False, data=frame)
        )

    def rest(self, seconds: float) -> None:
        """Let time pass without a request."""
        self._bench.advance(seconds)

    def ask(self, request: bytes, name: str = "DIAG_REQUEST") -> bytes | None:
        """Return the whole answer to a request; None without one."""
        begin = len(self._bench.messages("DIAG_RESPONSE"))
        if len(request) < _FRAME:
            self._send(bytes([len(request)]) + request, name)
        else:  # two frames suffice for all that is asked here
            self._send(bytes([_FIRST << 4, len(request)]) + request[:6])
            self._bench.advance(_PAUSE_S)
            flow = self._since(begin)
            assert flow, f"no flow control for {request.hex(' ')}"
            begin = len(self._bench.messages("DIAG_RESPONSE"))
            self._send(bytes([_CONSECUTIVE << 4 | 1]) + request[6:])
        self._bench.advance(_ANSWER_S)
        frames = self._since(begin)
        while frames and frames[0][0] >> 4 == _SINGLE and frames[0][3:4] == b"\x78":
            del frames[0]  # it takes longer
        if not frames:
            return None
        kind, low = frames[0][0] >> 4, frames[0][0] & 0x0F
        if kind == _SINGLE:
            return frames[0][1 : 1 + low]
        assert kind == _FIRST, f"an answer to {request.hex(' ')} begins with a frame of type {kind}"
        length = low << 8 | frames[0][1]
        begin = len(self._bench.messages("DIAG_RESPONSE"))
        self._send(_GO_ON)
        self._bench.advance(_ANSWER_S + length * 1e-3)
        payload = frames[0][2:]
        for number, frame in enumerate(self._since(begin), 1):
            assert frame[0] == _CONSECUTIVE << 4 | number & 0x0F, (
                f"frame {number} of an answer to {request.hex(' ')} begins with {frame[0]:#04x}"
            )
            payload += frame[1:]
        assert len(payload) >= length, (
            f"{len(payload)} of {length} bytes of an answer to {request.hex(' ')} came"
        )
        return payload[:length]

    def _since(self, begin: int) -> list[bytes]:
        return [
            bytes(
                [
                    _KINDS.get(str(one["frame_type"]), 15) << 4 | int(one["length_or_index"]),
                    *(int(one[f"byte_{k}"]) for k in range(1, 8)),
                ]
            )
            for one in self._bench.messages("DIAG_RESPONSE")[begin:]
        ]

    def expect(self, request: bytes, *beginnings: bytes, why: str = "") -> bytes:
        """Return the answer to a request, which begins as one of these.

        Raises
        ------
        AssertionError
            If it does not.
        """
        answer = self.ask(request)
        wanted = " or ".join(one.hex(" ") for one in beginnings)
        came = "nothing" if answer is None else answer.hex(" ")
        context = f" ({why})" if why else ""
        assert answer is not None, f"{request.hex(' ')} is not answered{context}: {wanted} is due"
        assert answer.startswith(beginnings), (
            f"{request.hex(' ')} is answered by {came}{context}, not by {wanted}"
        )
        return answer


def _in_standby(subject: Subject) -> _Tool:
    bench = subject.bench(navigate_at_s=3600)
    expect_mode(bench, "STANDBY", 2)
    return _Tool(bench)


def _unlock(tool: _Tool) -> None:
    """Unlock it with the rehearsal's secret."""
    seed = tool.expect(_SEED, b"\x67\x01")[2:]
    answer = tool.ask(b"\x27\x02" + key_of(seed, DEFAULT_SECRET))
    if answer == b"\x7f\x27\x35":
        raise NotApplicableError("it has another secret than the rehearsal's")
    assert answer == b"\x67\x02", f"the right key is answered by {answer!r}"


def _parameter(tool: _Tool) -> bytes:
    """Return the request that writes back a parameter as it is."""
    for number in _ANY_PARAMETER:
        name = number.to_bytes(2, "big")
        answer = tool.ask(b"\x22" + name)
        if answer is not None and answer[0] == 0x62 and len(answer) <= _TWO_FRAMES:
            return b"\x2e" + name + answer[3:]
    raise NotApplicableError("it has no parameter that is known here")


def _no_session(service: bytes) -> tuple[bytes, ...]:
    return tuple(b"\x7f" + service + code for code in _NOT_HERE)


def _refused(tool: _Tool, request: bytes, codes: tuple[bytes, ...], why: str) -> None:
    beginnings = tuple(b"\x7f" + request[:1] + code for code in codes)
    tool.expect(request, *beginnings, why=why)


def _enter_extended(tool: _Tool) -> None:
    answer = tool.ask(_EXTENDED)
    if answer == b"\x7f\x10\x12":
        raise NotApplicableError("it has no extended session")
    assert answer is not None, "the extended session is not answered"
    assert answer[:2] == b"\x50\x03", f"the extended session is answered by {answer.hex(' ')}"


@check("diagnostics.md#sessions-and-security", "UDS-1")
def uds(subject: Subject) -> None:
    """Where there is UDS, TesterPresent and the default session are answered.

    What cannot be is answered by the negative response of ISO 14229-1, functional requests of
    that kind not at all.
    """
    tool = _in_standby(subject)
    tool.expect(_TESTER_PRESENT, b"\x7e\x00")
    tool.expect(_DEFAULT, b"\x50\x01")
    tool.expect(b"\xba\x00", b"\x7f\xba\x11", why="an unknown service")
    tool.expect(b"\x10\x7d", b"\x7f\x10\x12", why="an unknown session")
    tool.expect(b"\x10", b"\x7f\x10\x13", why="a request that is too short")
    tool.expect(b"\x22\xfe\x00", b"\x7f\x22\x31", b"\x7f\x22\x11", why="an unknown identifier")
    silent = tool.ask(b"\x3e\x80")
    assert silent is None, f"TesterPresent that asks for no answer has {silent!r}"
    functional = tool.ask(_TESTER_PRESENT, "DIAG_FUNCTIONAL")
    assert functional == b"\x7e\x00", f"a functional TesterPresent is answered by {functional!r}"
    for request in (b"\xba\x00", b"\x10\x7d", b"\x22\xfe\x00", b"\x3e\x7d", b"\x27\x01"):
        answer = tool.ask(request, "DIAG_FUNCTIONAL")
        assert answer is None, f"a functional {request.hex(' ')} is answered by {answer!r}"
    tool.expect(b"\x3e", b"\x7f\x3e\x13", why="a request that is too short")
    tool.expect(b"\x3e\x00\x00", b"\x7f\x3e\x13", why="a request that is too long")
    tool.expect(b"\x3e\x01", b"\x7f\x3e\x12", why="an unknown sub-function")


@check("diagnostics.md#sessions-and-security", "UDS-2")
def uds_sessions(subject: Subject) -> None:
    """A session other than the default one ends 5 s after the last request.

    TesterPresent keeps it. SecurityAccess is refused in the default session.
    """
    tool = _in_standby(subject)
    _enter_extended(tool)
    tool.expect(_DEFAULT, b"\x50\x01")
    tool.expect(_SEED, b"\x7f\x27\x7f", b"\x7f\x27\x7e", why="in the default session")
    _enter_extended(tool)
    for _ in range(4):
        tool.rest(_S3_S / 2)
        tool.expect(_TESTER_PRESENT, b"\x7e\x00")
    tool.expect(_SEED, b"\x67\x01", why="the session was kept by TesterPresent")
    tool.rest(_S3_S - 0.6)
    tool.expect(_SEED, b"\x67\x01", why=f"{_S3_S - 0.1:g} s after the last request")
    tool.rest(_S3_S - 0.3)
    tool.expect(_SEED, *_no_session(b"\x27"), why=f"{_S3_S + 0.2:g} s after the last request")
    tool.expect(b"\x10\x02", b"\x7f\x10\x7e", b"\x7f\x10\x12", why="from the default session")
    _enter_extended(tool)
    assert tool.ask(b"\x10\x81") is None, "a session without an answer has one"
    tool.expect(_SEED, *_no_session(b"\x27"), why="the default session was asked for silently")


@check("diagnostics.md#sessions-and-security", "UDS-3")
def uds_security(subject: Subject) -> None:
    """A key without a seed and a wrong key are refused, and after the third no seed is given."""
    tool = _in_standby(subject)
    _enter_extended(tool)
    answer = tool.ask(_SEED)
    assert answer is not None, "the request for a seed is not answered"
    if answer in (b"\x7f\x27\x11", b"\x7f\x27\x12"):
        raise NotApplicableError("it has no SecurityAccess")
    assert answer[:2] == b"\x67\x01", f"the request for a seed is answered by {answer.hex(' ')}"
    assert any(answer[2:]), "it is unlocked without a key: its seed is zero"
    _enter_extended(tool)
    tool.expect(b"\x27\x02\x01", b"\x7f\x27\x24", b"\x7f\x27\x13", why="a key without a seed")
    refused = []
    for _ in range(3):
        tool.expect(_SEED, b"\x67\x01")
        refused.append(tool.ask(b"\x27\x02" + bytes(8)))
    assert refused[:2] == [b"\x7f\x27\x35"] * 2, f"a wrong key is answered by {refused[0]!r}"
    assert refused[2] == b"\x7f\x27\x36", f"the third wrong key is answered by {refused[2]!r}"
    tool.expect(_SEED, b"\x7f\x27\x37", why="after three wrong keys")
    tool.expect(b"\x27\x02" + bytes(8), b"\x7f\x27\x24", why="a key, though no seed was given")
    for _ in range(2):
        tool.rest(_S3_S - 1.5)
        tool.expect(_TESTER_PRESENT, b"\x7e\x00")
    tool.expect(_SEED, b"\x7f\x27\x37", why="less than 10 s after three wrong keys")
    tool.rest(1.5)
    seed = tool.expect(_SEED, b"\x67\x01", why="10 s after three wrong keys")
    tool.expect(b"\x27\x02" + bytes(8), b"\x7f\x27\x36", why="one attempt at a time since then")
    for _ in range(3):
        tool.rest(_S3_S - 1.5)
        tool.expect(_TESTER_PRESENT, b"\x7e\x00")
    other = tool.expect(_SEED, b"\x67\x01", why="10 s later")
    assert other != seed, "a seed is given twice"
    tool.expect(b"\x27\x02\x01", b"\x7f\x27\x13", why="a key that is too short")
    seed = tool.expect(_SEED, b"\x67\x01")[2:]
    _enter_extended(tool)
    key = b"\x27\x02" + key_of(seed, DEFAULT_SECRET)
    tool.expect(key, b"\x7f\x27\x24", why="the seed is of the session before")
    _unlock(tool)
    tool.expect(_EXTENDED, b"\x50\x03")
    seed = tool.expect(_SEED, b"\x67\x01")[2:]
    tool.expect(b"\x27\x02" + bytes(8), b"\x7f\x27\x35", why="the first wrong key again")
    key = b"\x27\x02" + key_of(seed, DEFAULT_SECRET)
    tool.expect(key, b"\x7f\x27\x24", why="its seed is spent")


@check("diagnostics.md#sessions-and-security", "UDS-4 UDS-5")
def uds_access(subject: Subject) -> None:
    """All that changes the computer needs SecurityAccess; a change of session locks it again.

    Writing is tried in the default session, locked, unlocked, and after each change of session; so
    are routines, input-output control and download.
    """
    tool = _in_standby(subject)
    _enter_extended(tool)
    if tool.ask(_SEED) in (None, b"\x7f\x27\x11", b"\x7f\x27\x12"):
        raise NotApplicableError("it has no SecurityAccess")
    write = _parameter(tool)
    changing = (
        (write, "writing a parameter"),
        (b"\x31\x01\x02\x01", "repeating the self-test"),
        (b"\x31\x01\xff\x00", "erasing memory"),
        (b"\x2f\x03\x11\x02", "controlling an output"),
        (b"\x34\x00\x44\x10\x00\x00\x00\x00\x00\x00\x10", "downloading"),
    )
    for request, what in changing:
        code = tool.expect(request, b"\x7f" + request[:1], why=f"{what}, locked")[2]
        assert code != 0x78, f"{what} is begun though the computer is locked"
    _refused(tool, write, (_LOCKED,), "writing a parameter, locked")
    tool.expect(_DEFAULT, b"\x50\x01")
    _refused(tool, write, _NOT_HERE, "writing a parameter, in the default session")
    for again, what in (
        (_EXTENDED, "the extended session was entered again"),
        (_DEFAULT, "the default session was entered"),
    ):
        _enter_extended(tool)
        _unlock(tool)
        tool.expect(write, b"\x6e" + write[1:3], why="writing a parameter, unlocked")
        tool.expect(_SEED, b"\x67\x01" + bytes(4), why="the seed of an unlocked computer is zero")
        tool.expect(again, b"\x50")
        _enter_extended(tool)
        _refused(tool, write, (_LOCKED,), f"{what} since it was unlocked")
    _unlock(tool)
    tool.rest(_S3_S + 0.5)
    _enter_extended(tool)
    _refused(tool, write, (_LOCKED,), "its session had ended since it was unlocked")
    _unlock(tool)
    _refused(tool, write[:-1], (b"\x13", b"\x31"), "a parameter that is too short")
    _refused(tool, write[:2], (b"\x13",), "half an identifier")
    if write[1:3] == b"\x10\x04":
        _refused(tool, write[:3] + b"\xff" * len(write[3:]), (b"\x31",), "a gap that is no number")
    _refused(tool, b"\x2e\xfe\x00\x00", (b"\x31",), "an unknown identifier")
    tool.expect(b"\x27\x02" + bytes(8), b"\x7f\x27\x24", why="a key without a seed, unlocked")


@check("diagnostics.md#sessions-and-security", "UDS-6")
def uds_reset(subject: Subject) -> None:
    """A reset while it navigates is refused unless it is unlocked."""
    bench = subject.navigating()
    tool = _Tool(bench)
    _refused(tool, _HARD_RESET, _NOT_HERE, "a reset in the default session")
    _enter_extended(tool)
    if tool.ask(b"\x11\x7d") == b"\x7f\x11\x11":
        raise NotApplicableError("it has no ECUReset")
    for kind in (_HARD_RESET, b"\x11\x03"):
        answer = tool.ask(kind)
        assert answer in (b"\x7f\x11\x22", b"\x7f\x11\x12"), f"{kind!r} is answered by {answer!r}"
    assert bench.mode == "NAVIGATION_ROTATING", f"a refused reset ends navigation: {bench.mode}"
    _unlock(tool)
    before = len(bench.messages("FIRMWARE_STATUS"))
    tool.expect(_HARD_RESET, b"\x51\x01", why="unlocked")
    bench.advance(1)
    modes = {one["mode"] for one in bench.messages("FIRMWARE_STATUS")[before:]}
    assert "SELF_TEST" in modes, "it is answered that it resets, but it does not"
    _enter_extended(tool)
    tool.expect(_SEED, b"\x67\x01")
    _refused(tool, b"\x27\x02" + bytes(8), (b"\x35", b"\x36"), "a wrong key after a reset")


@check("diagnostics.md#trouble-codes", "UDS-7")
def uds_trouble_codes(subject: Subject) -> None:
    """The loss of SYNC makes a trouble code's test fail.

    Clearing removes the code once it is over.
    """
    bench = subject.navigating()
    tool = _Tool(bench)
    before = tool.ask(_COUNT_FAILED)
    if before in (None, b"\x7f\x19\x11", b"\x7f\x19\x12"):
        raise NotApplicableError("it does not count trouble codes")
    assert before is not None
    assert before[:2] == b"\x59\x01", f"the count is answered by {before.hex(' ')}"
    failed = int.from_bytes(before[4:6], "big")
    assert failed == 0, f"{failed} tests have failed without a fault"
    bench.inject("drop", message="SYNC", for_s=_LOSS_S)
    bench.expect("FIRMWARE_STATUS", within=_LOSS_S, where={"sync_lost": 1})
    bench.advance(_LOSS_S / 2)
    count = int.from_bytes(tool.expect(_COUNT_FAILED, b"\x59\x01")[4:6], "big")
    assert count, "the loss of SYNC makes no test of a trouble code fail"
    listed = tool.expect(_LIST_CONFIRMED, b"\x59\x02")
    assert len(listed) >= 7, "the loss of SYNC has no confirmed trouble code"
    assert (len(listed) - 3) % 4 == 0, f"a list of trouble codes has {len(listed)} bytes"
    bench.advance(_LOSS_S)
    bench.expect("FIRMWARE_STATUS", within=0.5, where={"sync_lost": 0})
    bench.advance(3)
    still = int.from_bytes(tool.expect(_COUNT_FAILED, b"\x59\x01")[4:6], "big")
    assert not still, f"{still} tests still fail, though SYNC has come back"
    kept = tool.expect(_LIST_CONFIRMED, b"\x59\x02")
    assert len(kept) >= 7, "a confirmed trouble code vanishes by itself"
    tool.expect(_CLEAR[:-1], b"\x7f\x14\x13", why="a group that is too short")
    tool.expect(b"\x14\x12\x34\x56", b"\x7f\x14\x31", why="an unknown trouble code")
    tool.expect(_COUNT_FAILED[:-1], b"\x7f\x19\x13", why="no status mask")
    tool.expect(b"\x19\x7d\x00", b"\x7f\x19\x12", why="an unknown report")
    tool.expect(_CLEAR, b"\x54")
    bench.advance(1)
    after = tool.expect(_LIST_CONFIRMED, b"\x59\x02")
    left = after[3:].hex(" ")
    assert not left, f"after clearing codes are confirmed: {left}"
