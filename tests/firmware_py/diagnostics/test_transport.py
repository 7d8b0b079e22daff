"""ISO-TP (ISO 15765-2): frame by frame, in the time of the epoch counter."""

from __future__ import annotations

import itertools

import pytest

from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.diagnostics import access
from rrins.firmware_py.diagnostics.transport import slots_per_epoch

READ_ALL = bytes.fromhex("03220202cccccccc")  # gyro increments: 131 bytes
GO_ON = bytes.fromhex("300000")


def collect(tool, epochs, frames=()):
    heard = list(tool.step(list(frames)))
    for _ in range(epochs):
        heard += tool.step()
    return heard


def test_a_single_frame_is_answered_in_the_same_epoch(tool):
    assert tool.step([bytes.fromhex("03220102cccccccc")]) == [bytes.fromhex("056201020200cccc")]


def test_a_short_frame_without_padding_is_understood(tool):
    assert tool.step([bytes.fromhex("03220102")]) == [bytes.fromhex("056201020200cccc")]


def test_a_long_response_waits_for_flow_control_and_comes_whole(tool):
    (first,) = tool.step([READ_ALL])
    assert first[:5].hex() == "1083620202"
    assert collect(tool, 5) == []
    rest = collect(tool, 20, [GO_ON])
    assert [frame[0] for frame in rest] == [0x20 | k % 16 for k in range(1, 19)]
    assert len(rest) == 18  # 131 - 6 bytes, 7 in each


@pytest.mark.parametrize("rate_hz", [50, 100, 200, 400, 1000])
def test_an_epoch_has_room_for_a_tenth_of_the_bus(tool_at, rate_hz):
    tool = tool_at(rate_hz=rate_hz)
    slots = slots_per_epoch(1_000_000_000 // rate_hz)
    assert slots == max(1, access.FRAMES_PER_SECOND // rate_hz)
    tool.step([READ_ALL])
    counts = [len(tool.step([GO_ON]))] + [len(tool.step()) for _ in range(30)]
    assert max(counts) <= slots
    assert sum(counts) == 18
    full = counts[1 : 1 + (18 - counts[0]) // slots]  # the first waits for a separation time
    assert set(full) <= {slots}


@pytest.mark.parametrize(("st_min", "period_ms"), [(0x05, 5), (0x14, 20), (0x7F, 127), (0xF5, 0)])
def test_the_separation_time_of_the_tool_is_kept(tool, st_min, period_ms):
    tool.step([READ_ALL])
    epochs = []
    for epoch in range(19 * max(1, period_ms // 5) + 10):
        frames = tool.step([bytes([0x30, 0, st_min])] if epoch == 0 else [])
        epochs += [epoch] * len(frames)
    assert len(epochs) == 18
    if period_ms:  # an epoch has four slots, 1.25 ms apart
        late_ms = [5 * (b - a) - period_ms for a, b in itertools.pairwise(epochs)]
        assert all(-5 < late < 5 for late in late_ms)
        assert 5 * (epochs[-1] - epochs[0]) >= 17 * period_ms
    else:
        assert max(epochs) == 4


def test_a_response_that_takes_long_to_send_is_announced(tool):
    frames = collect(tool, 1, [bytes.fromhex("02190acccccccccc")])  # supported trouble codes
    assert frames[0] == bytes.fromhex("037f1978cccccccc")
    assert frames[1][0] == 0x11  # the first frame follows, of more than 255 bytes
    assert len(collect(tool, 100, [GO_ON])) > access.FRAMES_PER_SECOND * access.P2_MS / 1000


def test_blocks_are_sent_as_the_tool_asks_for_them(tool):
    tool.step([READ_ALL])
    for _ in range(3):
        assert len(collect(tool, 10, [bytes.fromhex("300500")])) == 5
    assert len(collect(tool, 10, [bytes.fromhex("300500")])) == 3


def test_waiting_and_giving_up(tool):
    tool.step([READ_ALL])
    assert collect(tool, 3, [bytes.fromhex("310000")]) == []  # wait
    assert len(collect(tool, 10, [GO_ON])) == 18
    tool.step([READ_ALL])
    assert collect(tool, 3, [bytes.fromhex("320000")]) == []  # overflow: it cannot take it
    assert len(collect(tool, 3, [bytes.fromhex("03220102")])) == 1


def test_a_tool_that_goes_away_is_given_up_after_a_second(tool):
    tool.step([READ_ALL])
    tool.run(0.9)
    assert not tool.node._transport.is_idle
    tool.run(0.2)
    assert tool.node._transport.is_idle
    assert not tool.node.is_awake
    assert collect(tool, 10, [GO_ON]) == []


def test_a_long_request_is_taken_after_flow_control(tool):
    tool.ask("1003")
    request = bytes.fromhex("2e1101") + bytes(40)
    assert tool.step([bytes([0x10, 43]) + request[:6]]) == [bytes.fromhex("304001cccccccccc")]
    parts = [request[6 + 7 * k : 13 + 7 * k] for k in range(6)]
    frames = [bytes([0x20 | k + 1]) + part for k, part in enumerate(parts)]
    assert collect(tool, 1, frames) == [bytes.fromhex("037f2e33cccccccc")]


@pytest.mark.parametrize("rate_hz", [50, 200, 1000])
def test_a_tool_that_goes_on_while_the_computer_is_held_up_loses_nothing(tool_at, rate_hz):
    """Its blocks arrive whole within an epoch: as many frames as flow control asks for."""
    tool = tool_at(rate_hz=rate_hz)
    tool.ask("1003")
    request = bytes.fromhex("2e1101") + bytes(access.MESSAGE_CAPACITY - 3)
    frames = [bytes([0x1F, 0xFF]) + request[:6]]
    starts = range(6, len(request), 7)
    frames += [bytes([0x20 | k % 16]) + request[s : s + 7] for k, s in enumerate(starts, 1)]
    sent, heard = 1, collect(tool, 0, frames[:1])
    while heard and heard[0][0] == 0x30:
        block = frames[sent : sent + (heard[0][1] or len(frames))]
        sent += len(block)
        heard = collect(tool, 10, block)
    assert sent == len(frames)
    assert heard == [bytes.fromhex("037f2e33cccccccc")]


def test_a_request_that_is_not_finished_is_forgotten_after_a_second(tool):
    tool.step([bytes.fromhex("100a2e100411223344"[:16])])
    tool.run(1.1)
    assert tool.node._transport.is_idle
    assert tool.step([bytes.fromhex("03220102")]) != []


def test_a_request_with_a_frame_missing_is_forgotten(tool):
    tool.step([bytes.fromhex("1020220101010201")])
    assert collect(tool, 3, [bytes.fromhex("2201020304050607")]) == []
    assert tool.node._transport.is_idle


LOCKED = bytes.fromhex("037f2e33cccccccc")
WRITE = bytes.fromhex("2e1101") + bytes(13)  # 16 bytes: a first frame and two others
WRITE_FRAMES = [b"\x10\x10" + WRITE[:6], b"\x21" + WRITE[6:13], b"\x22" + WRITE[13:]]
IGNORED = {
    "single frame of no length": "00021003",
    "single frame of more than it has": "0410030000"[:8],
    "single frame of eight bytes": "0822f1865500",
    "first frame of two bytes": "10023e0000000000",
    "first frame of seven bytes": "100722f186220201",
    "first frame of long form for few bytes": "10000000000922f1",
    "first frame that is short": "100922f186",
    "consecutive frame": "2122f18622020100",
    "flow control": "300000cccccccccc",
    "flow control of an unknown state": "330000cccccccccc",
    "kind 4": "4322f186cccccccc",
    "kind 15": "ff22f186cccccccc",
    "nothing": "",
}


@pytest.mark.parametrize("frame", IGNORED.values(), ids=IGNORED)
def test_what_is_no_frame_of_a_classic_bus_is_ignored(tool, frame):
    """ISO 15765-2:2016, 9.6; the network layer of the tool sends none of these."""
    assert collect(tool, 3, [bytes.fromhex(frame)]) == []
    assert tool.node._transport.is_idle
    assert tool.ask("22f186") == "62f18601"
    assert tool.step([bytes.fromhex(frame)], can_id=0x7DF) == []
    assert tool.ask("22f186") == "62f18601"


@pytest.mark.parametrize(
    "frame",
    [
        *(frame for frame in IGNORED.values() if not frame.startswith("2")),
        "2100112233",  # a consecutive frame that is short
    ],
)
def test_it_does_not_disturb_a_request_that_is_coming(tool, frame):
    tool.ask("1003")
    assert len(collect(tool, 1, WRITE_FRAMES[:1])) == 1
    assert collect(tool, 1, [bytes.fromhex(frame)]) == []
    assert collect(tool, 1, WRITE_FRAMES[1:]) == [LOCKED]


@pytest.mark.parametrize("st_min", [0x80, 0xF0, 0xFA, 0xFF])
def test_a_reserved_separation_time_is_the_longest(tool, st_min):
    """ISO 15765-2:2016, 9.6.5.4: 127 ms."""
    tool.step([READ_ALL])
    heard = [tool.step([bytes([0x30, 0, st_min])] if k == 0 else []) for k in range(18 * 26)]
    epochs = [k for k, frames in enumerate(heard) for _ in frames]
    assert len(epochs) == 18
    assert all(b - a in (25, 26) for a, b in itertools.pairwise(epochs))


def test_flow_control_that_is_not_waited_for_changes_nothing(tool):
    tool.step([READ_ALL])
    heard = collect(tool, 0, [GO_ON])
    heard += collect(tool, 30, [bytes.fromhex("300100"), bytes.fromhex("320000")])
    assert len(heard) == 18


def test_flow_control_of_an_unknown_state_ends_the_response(tool):
    tool.step([READ_ALL])
    assert collect(tool, 3, [bytes.fromhex("330000")]) == []
    assert tool.node._transport.is_idle


def test_a_request_behind_the_end_of_a_response_in_one_epoch_is_answered(tool):
    tool.step([READ_ALL])
    end, present = bytes.fromhex("320000"), bytes.fromhex("023e00")
    assert [frame[:3].hex() for frame in collect(tool, 3, [end, present])] == ["027e00"]


def test_the_session_lasts_while_a_request_is_coming(tool):
    """ISO 14229-2: its time stops with the first frame, and begins anew with the response."""
    tool.unlock()
    request = bytes.fromhex("2e1101") + bytes(80)
    tool.step([b"\x10\x53" + request[:6]])
    for k in range(11):
        tool.run(0.9)
        frames = tool.step(
            [bytes([0x20 | k + 1]) + request[6 + 7 * k : 13 + 7 * k].ljust(7, b"\0")]
        )
    assert frames == [bytes.fromhex("037f2e13cccccccc")]
    assert tool.ask("22f186") == "62f18603"
    assert tool.server.is_unlocked


def test_a_request_too_long_is_refused_with_overflow(tool):
    assert tool.step([bytes.fromhex("1000000010002211")]) == [bytes.fromhex("324001cccccccccc")]


def test_a_flood_costs_a_bounded_share_of_an_epoch(tool):
    flood = [bytes.fromhex("03220102")] * 1000
    assert len(tool.step(flood)) <= slots_per_epoch(tool.bench.period_ns)
    answered = 1 + sum(len(tool.step()) for _ in range(300))
    assert answered < 200
    assert tool.node._transport.dropped >= 1000 - answered - 1
    assert tool.node._transport.is_idle


def test_responses_come_before_the_frame_that_closes_the_epoch(tool_at):
    tool = tool_at(Mode.NAVIGATION_STRAPDOWN)
    tool.step([READ_ALL])
    own = tool.bench.frames()
    go_on = tool.bench.frames()[0].copy()
    go_on["can_id"], go_on["length"], go_on["data"] = 0x7E0, 3, 0x30
    out = tool.bench.step([go_on, *own])
    assert [frame["can_id"] for frame in out].count(0x7E8) == 3
    assert out[-1]["can_id"] == 0x21


def test_what_is_said_does_not_depend_on_the_clock_on_the_wall(tool_at, monkeypatch):
    def heard(seconds_per_look):
        ticks = iter(range(10**9))
        monkeypatch.setattr(
            "time.perf_counter_ns", lambda: int(next(ticks) * seconds_per_look * 1e9)
        )
        tool = tool_at()
        tool.step([READ_ALL])
        said = [tool.step([bytes([0x30, 0, 20])] if k == 0 else []) for k in range(80)]
        tool.step([READ_ALL])
        return said + [tool.step([GO_ON] if k == 150 else []) for k in range(200)]

    assert heard(0.0) == heard(3.0)
