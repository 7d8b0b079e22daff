"""Bounds of response times, against the paper and against the wire."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.dbc.frame import EFF_FLAG, frame_array
from rrins.host_tools.wire.bits import bit_sequence
from rrins.host_tools.wire.response_time import Message, longest_bits, response_bounds
from rrins.host_tools.wire.timing import WireModel

MS = 1_000_000


def test_the_example_of_davis_and_others():
    # Davis et al. (2007), table 1: 125-bit frames at 125 kbit/s. The older analysis looks at the
    # first instance of C only, which takes 3 ms; the second one takes 3.5 ms.
    messages = [
        Message(0xA, 125, 2_500_000),
        Message(0xB, 125, 3_500_000),
        Message(0xC, 125, 3_500_000),
    ]
    bounds = response_bounds(messages, 125_000)
    assert bounds == {0xA: 2 * MS, 0xB: 3 * MS, 0xC: 3_500_000}


def test_a_message_alone_takes_its_own_time_and_its_jitter():
    assert response_bounds([Message(1, 135, 5 * MS, 7_000)], 1_000_000) == {1: 135_000 + 7_000}


def test_a_weaker_message_blocks_once_and_a_stronger_one_goes_first():
    messages = [Message(3, 135, 5 * MS), Message(1, 65, 5 * MS), Message(2, 95, 5 * MS)]
    bounds = response_bounds(messages, 1_000_000)
    assert bounds == {1: 200_000, 2: 295_000, 3: 295_000}


def test_too_much_has_no_bound():
    messages = [Message(1, 100, 200_000), Message(2, 100, 200_000), Message(3, 50, 9 * MS)]
    bounds = response_bounds(messages, 1_000_000)
    assert bounds == {1: 200_000, 2: None, 3: None}


def test_priority_is_that_of_the_wire():
    messages = [Message(EFF_FLAG | 0x100 << 18, 160, MS), Message(0x101, 135, MS)]
    bounds = response_bounds(messages, 1_000_000)
    assert bounds[EFF_FLAG | 0x100 << 18] == bounds[0x101] == 295_000


def test_the_longest_frames():
    assert [longest_bits(8), longest_bits(8, extended=True), longest_bits(0)] == [135, 160, 55]


@pytest.mark.parametrize(
    "messages",
    [[Message(1, 100, MS), Message(1, 90, MS)], [Message(1, 0, MS)], [Message(1, 1, MS, -1)]],
)
def test_nonsense_is_refused(messages):
    with pytest.raises(ValueError, match="identifier"):
        response_bounds(messages, 1_000_000)


periods = st.integers(4, 40).map(lambda count: count * 100_000)


@settings(max_examples=40)
@given(st.lists(st.tuples(periods, periods, st.binary(max_size=8)), min_size=1, max_size=6))
def test_the_wire_keeps_the_bound(rows):
    bitrate = 500_000
    messages = []
    model = WireModel(bitrate, (*(f"node {k}" for k in range(len(rows))), "listener"))
    for node, (period, offset, payload) in enumerate(rows):
        data = int.from_bytes(payload, "little")
        messages.append(Message(node, len(bit_sequence(node, len(payload), data)) + 3, period))
        frames = frame_array(1)
        frames["can_id"], frames["length"], frames["data"] = node, len(payload), data
        for time in range(offset, offset + 200 * period, period):
            model.submit(node, frames, 1, time)
    out, times, nodes = frame_array(2048), np.zeros(2048, np.int64), np.zeros(2048, np.int64)
    assert model.run(2_000 * MS, out, times, nodes) == 200 * len(rows)
    bounds = response_bounds(messages, bitrate)
    identifiers = model.statistics()["identifiers"]
    for identifier, bound in bounds.items():
        if bound is not None:
            assert identifiers[identifier]["worst_response_ns"] <= bound


def test_frames_that_all_come_at_once_reach_the_bound():
    payload = b"\x55" * 8
    data = int.from_bytes(payload, "little")
    messages = [Message(k, len(bit_sequence(k, 8, data)) + 3, 5 * MS) for k in range(13)]
    bounds = response_bounds(messages, 1_000_000)
    model = WireModel(1_000_000)
    frames = frame_array(13)
    frames["can_id"], frames["length"], frames["data"] = np.arange(13), 8, data
    model.submit(0, frames, 13, 0)
    out, times, nodes = frame_array(64), np.zeros(64, np.int64), np.zeros(64, np.int64)
    assert model.run(5 * MS, out, times, nodes) == 13
    # The weakest is blocked by nothing; the bound has the intermission.
    assert times[12] + 3_000 == bounds[12]
