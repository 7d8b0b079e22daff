"""The bus in virtual time. Frames and times are worked out by hand or from `frame_bits`."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.dbc.frame import EFF_FLAG, ERR_FLAG, RTR_FLAG, frame_array
from rrins.host_tools.wire.bits import agreed_bits, frame_bits
from rrins.host_tools.wire.confinement import NodeState
from rrins.host_tools.wire.timing import WireModel

BIT = 1000  # ns at 1 Mbit/s
FAR = 10_000_000_000


def frames_of(*rows):
    """Frames from rows of identifier and payload."""
    frames = frame_array(len(rows))
    for frame, (can_id, payload) in zip(frames, rows, strict=True):
        frame["can_id"] = can_id
        frame["length"] = len(payload)
        frame["data"] = int.from_bytes(payload.ljust(8, b"\0"), "little")
    return frames


def bits_of(can_id, payload):
    return int(frame_bits(can_id, len(payload), np.uint64(int.from_bytes(payload, "little"))))


class Bus:
    """A model and the arrays around it."""

    def __init__(self, *nodes, bitrate=1_000_000, capacity=1024, **options):
        self.model = WireModel(bitrate, nodes or ("a", "b", "c"), **options)
        self.frames = frame_array(capacity)
        self.times = np.zeros(capacity, dtype=np.int64)
        self.nodes = np.zeros(capacity, dtype=np.int64)
        self.receivers = np.zeros(capacity, dtype=np.int64)

    def submit(self, node, *rows, at=0):
        return self.model.submit(node, frames_of(*rows), len(rows), at)

    def run(self, until=FAR):
        """Identifier, end in ns and node of each frame that has ended."""
        count = self.model.run(until, self.frames, self.times, self.nodes, self.receivers)
        ids = (int(can_id) for can_id in self.frames["can_id"][:count])
        rows = zip(ids, self.times[:count], self.nodes[:count], strict=True)
        return [(can_id, int(time), int(node)) for can_id, time, node in rows]

    def node(self, name):
        return self.model.statistics()["nodes"][name]


def test_a_frame_ends_its_bits_after_it_was_submitted():
    bus = Bus()
    bus.submit(1, (0x123, b"\x01\x02"), at=7_000)
    end = 7_000 + bits_of(0x123, b"\x01\x02") * BIT
    assert bus.run(end - 1) == []
    assert bus.run(end) == [(0x123, end, 1)]
    assert bus.frames["length"][0] == 2
    assert bus.frames["data"][0] == 0x0201
    assert bus.receivers[0] == 0b101


def test_frames_are_three_bits_apart():
    bus = Bus()
    bus.submit(0, (0x10, b"x"), (0x20, b"yz"))
    first = bits_of(0x10, b"x") * BIT
    second = first + (3 + bits_of(0x20, b"yz")) * BIT
    assert bus.run() == [(0x10, first, 0), (0x20, second, 0)]


@pytest.mark.parametrize(
    ("submitted", "order"),  # node, identifier and time
    [
        ([(0, 0x300, 0), (0, 0x100, 0), (1, 0x200, 0), (1, 0, 0)], [0, 0x100, 0x200, 0x300]),
        (  # standard data wins against remote, and that against extended
            [
                (0, 0x100 << 18 | EFF_FLAG, 0),
                (1, 0x100 | RTR_FLAG, 0),
                (2, 0x101, 0),
                (0, 0x100, 0),
            ],
            [0x100, 0x100 | RTR_FLAG, 0x100 << 18 | EFF_FLAG, 0x101],
        ),
        ([(0, 0x7FF, 0), (1, 0, 1)], [0x7FF, 0]),  # a transmission is not interrupted
    ],
)
def test_the_strongest_identifier_of_all_nodes_goes_first(submitted, order):
    bus = Bus()
    for node, can_id, at in submitted:
        bus.submit(node, (can_id, b""), at=at)
    rows = bus.run()
    assert [can_id for can_id, _, _ in rows] == order
    senders = {can_id: node for node, can_id, _ in submitted}
    assert [node for _, _, node in rows] == [senders[can_id] for can_id in order]


def test_equal_identifiers_of_a_node_stay_in_order():
    bus = Bus()
    bus.submit(0, *((0x55, bytes([k])) for k in range(20)))
    bus.run()
    assert bus.frames["data"][:20].tolist() == list(range(20))


def test_full_arrays_stop_the_wire():
    bus = Bus(capacity=4)
    bus.submit(0, *((k, b"") for k in range(10)))
    found = [bus.run(), bus.run(), bus.run()]
    assert [len(rows) for rows in found] == [4, 4, 2]
    assert [row[0] for rows in found for row in rows] == list(range(10))
    assert bus.model.now_ns == FAR


def test_the_load_of_a_saturated_wire_is_one():
    bus = Bus()
    for _ in range(8):
        bus.submit(0, *((k, b"12345678") for k in range(256)), at=bus.model.now_ns)
        bus.run(bus.model.now_ns + 20_000_000)
    statistics = bus.model.statistics()
    assert statistics["load"] == 1.0
    assert statistics["window_load"] == statistics["worst_window_load"] == 1.0


def test_the_load_is_that_of_the_bits():
    bus = Bus(window_ns=10_000_000)
    bus.submit(0, (0x1, b"abc"), (0x2, b""), at=1_000_000)
    bus.submit(1, (EFF_FLAG | 5, b"abc"), at=12_000_000)
    bus.run(20_000_000)
    first = (bits_of(0x1, b"abc") + bits_of(0x2, b"") + 6) * BIT
    second = (bits_of(EFF_FLAG | 5, b"abc") + 3) * BIT
    statistics = bus.model.statistics()
    assert statistics["busy_ns"] == first + second
    assert statistics["load"] == (first + second) / 20_000_000
    assert statistics["window_load"] == second / 10_000_000
    assert statistics["worst_window_load"] == first / 10_000_000
    assert statistics["identifiers"][0x2] == {
        "sent": 1,
        "errors": 0,
        "retransmissions": 0,
        "busy_ns": (bits_of(0x2, b"") + 3) * BIT,
        "worst_delay_ns": (bits_of(0x1, b"abc") + 3) * BIT,
        "worst_response_ns": first - 3 * BIT,
    }
    assert statistics["extended"]["sent"] == 1
    bus.run(40_000_000)
    assert bus.model.statistics()["window_load"] == 0


def test_a_full_node_loses_what_is_more():
    bus = Bus()
    assert bus.submit(0, *((k, b"") for k in range(300))) == 256
    assert bus.submit(1, (0x400, b"")) == 1
    assert len(bus.run()) == 257
    assert bus.node("a")["overflowed"] == 44
    assert bus.node("a")["most_waiting"] == 256


def test_what_is_no_frame_is_lost():
    bus = Bus()
    frames = frames_of((0x1, b""), (0x1 | ERR_FLAG, b""))
    frames["length"][0] = 9
    assert bus.model.submit(0, frames, 2, 0) == 0
    assert bus.node("a")["invalid"] == 2


def test_a_destroyed_frame_is_sent_again():
    bus = Bus()
    bus.submit(0, (0x10, b"x"))
    bus.submit(1, (0x08, b"y"))
    bus.model.fail_next(0x10, times=2)
    good, own = bits_of(0x08, b"y"), bits_of(0x10, b"x")
    # Up to the ACK slot, 8 bits before the end; flags 7, delimiter 8, intermission 3.
    failed = own - 8 + 7 + 8 + 3
    assert bus.run() == [
        (0x08, good * BIT, 1),
        (0x10, (good + 3 + 2 * failed + own) * BIT, 0),
    ]
    row = bus.model.statistics()["identifiers"][0x10]
    assert (row["sent"], row["errors"], row["retransmissions"]) == (1, 2, 2)
    assert row["worst_delay_ns"] == (good + 3 + 2 * failed) * BIT
    sender, receiver = bus.node("a"), bus.node("b")
    assert (sender["tec"], sender["rec"]) == (15, 0)
    assert (receiver["tec"], receiver["rec"]) == (0, 1)


def test_without_retransmission_a_destroyed_frame_is_lost():
    bus = Bus(retransmission=False)
    bus.model.fail_next()
    bus.submit(0, (0x10, b""), (0x20, b""))
    assert [row[0] for row in bus.run()] == [0x20]
    assert bus.node("a")["abandoned"] == 1


def test_a_passive_sender_lets_others_go_first():
    bus = Bus()
    bus.model.fail_next(0x10, times=16)
    bus.submit(0, (0x10, b"x"))
    own, other = bits_of(0x10, b"x"), bits_of(0x700, b"")
    passive = 16 * (own + 10) * BIT
    bus.run(passive - 1)
    assert bus.model.state(0) is NodeState.ERROR_PASSIVE
    bus.submit(1, (0x700, b""), at=passive + 1)
    ends = passive + 1 + other * BIT
    assert bus.run() == [(0x700, ends, 1), (0x10, ends + (3 + own) * BIT, 0)]
    assert bus.model.state(0) is NodeState.ERROR_ACTIVE


def test_a_node_goes_off_the_bus_and_comes_back():
    bus = Bus()
    bus.model.fail_next(node=0, times=1000)
    bus.submit(0, (0x10, b"x"), (0x11, b""))
    off = (32 * (bits_of(0x10, b"x") + 10) + 16 * 8) * BIT
    back = off + 128 * 11 * BIT
    bus.run(off)
    assert bus.node("a")["state"] == "bus_off"
    assert bus.node("a")["errors"] == 32
    assert bus.node("a")["discarded"] == 2
    assert bus.submit(0, (0x10, b""), at=off) == 0
    bus.run(back - 1)
    assert bus.model.state(0) is NodeState.BUS_OFF
    bus.run(back)
    assert bus.model.state(0) is NodeState.ERROR_ACTIVE
    assert (bus.node("a")["tec"], bus.node("a")["bus_offs"]) == (0, 1)


def test_traffic_counts_for_a_node_off_the_bus():
    bus = Bus()
    bus.model.fail_next(node=0, times=32)
    bus.submit(0, (0x10, b"x"))
    off = (32 * (bits_of(0x10, b"x") + 10) + 16 * 8) * BIT
    bus.run(off)
    # 127 frames without a gap show 11 recessive bits each, and one such sequence is left.
    bus.submit(1, *((0x20, b"") for _ in range(127)), at=off)
    frames = 127 * (bits_of(0x20, b"") + 3) * BIT
    assert len(bus.run(off + frames + 11 * BIT - 1)) == 127
    assert bus.receivers[126] == 0b100
    assert bus.model.state(0) is NodeState.BUS_OFF
    bus.run(off + frames + 11 * BIT)
    assert bus.model.state(0) is NodeState.ERROR_ACTIVE


def test_without_recovery_a_node_stays_off_the_bus():
    bus = Bus(recovery=False)
    bus.model.fail_next(times=32)
    bus.submit(0, (0x10, b""))
    bus.run()
    assert bus.model.state(0) is NodeState.BUS_OFF


def test_a_lone_node_is_never_acknowledged_and_never_leaves():
    bus = Bus("only")
    bus.submit(0, (0x10, b"x"))
    assert bus.run(100_000_000) == []
    assert bus.node("only")["tec"] == 128
    assert bus.model.state(0) is NodeState.ERROR_PASSIVE
    # Up to the ACK slot, flag 6, delimiter 8, intermission 3; 8 more once it is passive.
    attempt = bits_of(0x10, b"x") - 8 + 6 + 8 + 3
    passive_attempts = (100_000 + 3 - 16 * attempt) // (attempt + 8)
    assert bus.node("only")["errors"] == 16 + passive_attempts


def test_a_cut_wire_carries_nothing_until_it_is_mended():
    bus = Bus()
    bus.model.cut(True)
    bus.submit(0, (0x10, b""))
    bus.submit(1, (0x20, b""))
    assert bus.run(50_000_000) == []
    assert [bus.node(name)["tec"] for name in "abc"] == [128, 128, 0]
    assert bus.node("c")["rec"] == 0
    bus.model.cut(False)
    assert [row[0] for row in bus.run()] == [0x10, 0x20]
    assert [bus.node(name)["tec"] for name in "abc"] == [127, 127, 0]


def test_a_silent_node_neither_sends_nor_acknowledges():
    bus = Bus("a", "b")
    bus.submit(1, (0x10, b""))
    bus.model.silence(1, True)
    assert bus.submit(1, (0x11, b"")) == 0
    bus.submit(0, (0x20, b""))
    assert bus.run(50_000_000) == []
    assert bus.node("b")["discarded"] == 2
    assert (bus.node("a")["tec"], bus.node("b")["rec"]) == (128, 0)
    bus.model.silence(1, False)
    assert [row[0] for row in bus.run()] == [0x20]


def test_the_same_frame_of_two_nodes_goes_out_once():
    bus = Bus()
    bus.submit(1, (0x20, b"x"))
    bus.submit(2, (0x20, b"x"))
    assert bus.run() == [(0x20, bits_of(0x20, b"x") * BIT, 1)]
    assert bus.receivers[0] == 0b001
    assert [bus.node(name)["sent"] for name in "abc"] == [0, 1, 1]


def test_different_frames_of_the_same_identifier_collide_until_one_is_passive():
    bus = Bus()
    bus.submit(0, (0x20, b"\x81"))
    bus.submit(1, (0x20, b"\x80"))
    one, two = bits_of(0x20, b"\x81"), bits_of(0x20, b"\x80")
    differ = int(agreed_bits(0x20, 1, np.uint64(0x81), 1, np.uint64(0x80)))
    # Flags 12, delimiter 8, intermission 3; 16 times, until both are passive and wait 8 bits more.
    passive = 16 * (differ + 12 + 8 + 3) + 8
    first = passive + two
    assert bus.run() == [
        (0x20, first * BIT, 1),
        # The loser, passive, was a sender of the frame before and waits as well.
        (0x20, (first + 3 + 8 + one) * BIT, 0),
    ]
    assert [bus.node(name)["errors"] for name in "abc"] == [17, 16, 0]
    # 128 - 1, one more for a frame received, and 128 + 8 - 1.
    assert [bus.node(name)["tec"] for name in "abc"] == [135, 127, 0]
    assert bus.node("c")["rec"] == 14


@pytest.mark.parametrize("bitrate", [0, 5_000, 3_000_000, 999_999, 2_000_000])
def test_bit_rates_that_no_wire_has(bitrate):
    with pytest.raises(ValueError, match="bit rate"):
        WireModel(bitrate)


def test_misuse_is_refused():
    bus = Bus()
    with pytest.raises(ValueError, match="node 3"):
        bus.submit(3, (0x1, b""))
    with pytest.raises(ValueError, match="2 frames out of an array of 1"):
        bus.model.submit(0, frame_array(1), 2, 0)
    with pytest.raises(ValueError, match="shorter"):
        bus.model.run(0, frame_array(9), bus.times[:8], bus.nodes)
    bus.run(1000)
    with pytest.raises(ValueError, match="has run to 1000 ns"):
        bus.submit(0, (0x1, b""), at=999)
    with pytest.raises(ValueError, match="has run to 1000 ns"):
        bus.run(999)
    for _ in range(16):
        bus.model.fail_next()
    with pytest.raises(ValueError, match="16 orders"):
        bus.model.fail_next()


events = st.lists(
    st.tuples(
        st.integers(0, 2),  # node
        st.integers(0, 15),  # identifier
        st.binary(max_size=8),
        st.integers(0, 3_000_000),  # ns
    ),
    max_size=40,
)
failures = st.integers(0, 40)


@settings(max_examples=60)
@given(events, failures, st.lists(st.integers(0, 20_000_000), max_size=10))
def test_the_wire_carries_what_is_given_to_it_however_it_is_run(rows, failed, stops):
    whole, parts = Bus(), Bus()
    for bus in (whole, parts):
        if failed:
            bus.model.fail_next(times=failed)
        for node, can_id, payload, time in rows:
            # A node's identifiers are its own, as on a real bus.
            bus.submit(node, (can_id * 4 + node, payload), at=time)
    found = whole.run(FAR)
    pieces = []
    for until in [*sorted(stops), FAR]:
        pieces += parts.run(until)
    assert pieces == found
    assert parts.model.mediums["node"].tobytes() == whole.model.mediums["node"].tobytes()
    assert parts.model.statistics() == whole.model.statistics()
    # All frames come through, unless a node was taken off the bus.
    lost = sum(whole.node(name)["discarded"] for name in "abc")
    assert len(found) + lost == len(rows)
    times = [time for _, time, _ in found]
    assert all(later - time > 44 * BIT for time, later in pairwise(times))
    assert whole.model.statistics()["busy_ns"] <= FAR
