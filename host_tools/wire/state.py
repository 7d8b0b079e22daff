"""The wire and the nodes on it in virtual time, as one record of fixed size."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.compiled.record import I8, U1, U4, U8, Record, Records
from rrins.dbc.frame import EFF_FLAG, ERR_FLAG, Frame, FrameArray
from rrins.host_tools.wire.bits import arbitration_key
from rrins.host_tools.wire.confinement import Confinement

NODES = 16
"""Nodes that a wire has room for."""

NODE_CAPACITY = 256
"""Most frames waiting in one node."""

FAILURES = 16
"""Most open orders to destroy transmissions."""

STANDARD_IDENTIFIERS = 2048
"""Also the row of the statistics in which all extended identifiers are together."""

ANY = -1
"""Stands for any identifier or any node in an order to destroy transmissions."""


class QueueEntry(Record):
    """A frame that waits in a node."""

    key: I8  #: see `rrins.host_tools.wire.bits.arbitration_key`
    sequence: I8  #: order of submission over all nodes
    ready_ns: I8  #: submitted for this time
    attempts: I8  #: transmissions that failed
    payload: U8
    can_id: U4
    length: U1


class WireNode(Record):
    """A node: its fault confinement and its waiting frames are in arrays of their own."""

    count: I8  #: frames waiting
    silent: I8  #: 0 or 1
    free_ns: I8  #: suspended until then
    chosen: I8  #: index of the frame put forward for arbitration, -1 for none
    # Of the transmission that it takes part in.
    sending_id: I8
    sending_ready_ns: I8
    sending_attempts: I8
    # Statistics.
    submitted: I8
    sent: I8
    errors: I8  #: own transmissions that an error frame ended
    retransmissions: I8
    busy_ns: I8
    overflowed: I8  #: lost, because the queue was full
    discarded: I8  #: lost, because the node was silent or off the bus
    abandoned: I8  #: lost, because nothing is sent again
    invalid: I8  #: lost, because they are not frames of a bus
    bus_offs: I8
    most_waiting: I8


class IdentifierCounts(Record):
    """Statistics of an identifier."""

    sent: I8
    errors: I8
    retransmissions: I8
    busy_ns: I8
    worst_delay_ns: I8
    worst_response_ns: I8


class OrderedFailure(Record):
    """An order to destroy the next transmissions that match; `ANY` matches all."""

    left: I8
    identifier: I8
    node: I8


class Transmission(Record):
    """The transmission on the wire; what becomes of it is settled when it begins."""

    active: I8
    outcome: I8
    start_ns: I8
    end_ns: I8  #: of EOF, or of the error delimiter
    busy_ns: I8  #: with the intermission
    senders: I8  #: a bit per node
    losers: I8  #: error-passive nodes whose bit error disturbed nobody
    receivers: I8
    leader: I8  #: lowest of the senders
    payload: U8
    can_id: U4
    length: U1


class WireState(Record):
    """A wire with its nodes; times are integer nanoseconds of virtual time."""

    bit_ns: I8
    node_count: I8
    retransmission: I8
    recovery: I8
    cut: I8
    start_ns: I8
    now_ns: I8
    free_ns: I8  #: end of the last intermission
    idle_from_ns: I8  #: recessive bits are counted up to here
    nodes_off: I8
    sequence: I8
    busy_ns: I8  #: up to free_ns, which may lie ahead of now_ns
    window_ns: I8
    window_end_ns: I8
    window_busy_ns: I8
    last_window_busy_ns: I8
    worst_window_busy_ns: I8
    transmission: Annotated[Records[Transmission], 1]
    failure: Annotated[Records[OrderedFailure], FAILURES]
    fault: Annotated[Records[Confinement], NODES]
    node: Annotated[Records[WireNode], NODES]
    entry: Annotated[Records[QueueEntry], NODES * NODE_CAPACITY]  #: those of a node lie together
    identifier: Annotated[Records[IdentifierCounts], STANDARD_IDENTIFIERS + 1]


@compiled
def identifier_row(can_id: int) -> int:
    """Return the row (int64) of an identifier in the statistics."""
    word = np.int64(can_id)
    return int(np.int64(STANDARD_IDENTIFIERS) if word & EFF_FLAG else word & 0x7FF)


@compiled
def identifier_of(can_id: int) -> int:
    """Return an identifier (int64) with `EFF_FLAG` if it is extended, without other flags."""
    word = np.int64(can_id)
    return int(word & (EFF_FLAG | 0x1FFF_FFFF) if word & EFF_FLAG else word & 0x7FF)


@compiled
def first_ready(medium: WireState, index: int, time_ns: int) -> int:
    """Return the entry (int64) that a node puts forward at a time, -1 for none.

    The node behaves like a controller with a mailbox for each waiting frame: the frame with the
    strongest arbitration field first, and of equal ones the one submitted first.
    """
    entries = medium.entry
    best, key, sequence = -1, 0, 0
    first = index * NODE_CAPACITY
    for place in range(first, first + medium.node[index].count):
        entry = entries[place]
        if entry.ready_ns > time_ns:
            continue
        if best < 0 or entry.key < key or (entry.key == key and entry.sequence < sequence):
            best, key, sequence = place, entry.key, entry.sequence
    return best


@compiled
def next_start_ns(medium: WireState, latest_ns: int) -> int:
    """Return when the next arbitration begins, or `latest_ns` if none begins before."""
    soonest = latest_ns
    for index in range(medium.node_count):
        node = medium.node[index]
        free_ns = max(medium.free_ns, node.free_ns)
        if free_ns >= soonest:
            continue
        first = index * NODE_CAPACITY
        for place in range(first, first + node.count):
            soonest = min(soonest, max(free_ns, medium.entry[place].ready_ns))
            if soonest <= free_ns:
                break
    return soonest


@compiled
def remove(medium: WireState, index: int, place: int) -> None:
    """Remove an entry from a node; the node's last entry fills the gap."""
    node = medium.node[index]
    node.count -= 1
    last = index * NODE_CAPACITY + node.count
    if place == last:
        return
    entry = medium.entry[place]
    moved = medium.entry[last]
    entry.key = moved.key
    entry.sequence = moved.sequence
    entry.ready_ns = moved.ready_ns
    entry.attempts = moved.attempts
    entry.payload = moved.payload
    entry.can_id = moved.can_id
    entry.length = moved.length


@compiled
def discard_all(medium: WireState, index: int) -> None:
    """Empty a node's queue, as a driver does when its controller leaves the bus."""
    node = medium.node[index]
    node.discarded += node.count
    node.count = 0


@compiled
def _put(medium: WireState, index: int, frame: Frame, time_ns: int) -> int:
    node = medium.node[index]
    node.submitted += 1
    if frame.can_id & ERR_FLAG or frame.length > 8:
        node.invalid += 1
        return 0
    if node.silent or medium.fault[index].bus_off:
        node.discarded += 1
        return 0
    if node.count == NODE_CAPACITY:
        node.overflowed += 1
        return 0
    entry = medium.entry[index * NODE_CAPACITY + node.count]
    node.count += 1
    node.most_waiting = max(node.most_waiting, node.count)
    entry.key = arbitration_key(frame.can_id)
    entry.sequence = medium.sequence
    medium.sequence += 1
    entry.ready_ns = time_ns
    entry.attempts = 0
    entry.payload = frame["data"]
    entry.can_id = frame.can_id
    entry.length = frame.length
    return 1


@compiled
def submit(
    mediums: Records[WireState], index: int, frames: FrameArray, count: int, time_ns: int
) -> int:
    """Queue the first `count` frames in a node for a time; return how many it accepted.

    The others are lost and counted: no frame of a bus, the node silent or off the bus now, or its
    queue full.
    """
    medium = mediums[0]
    taken = 0
    for k in range(count):
        taken += _put(medium, index, frames[k], time_ns)
    return taken


@compiled
def failure_ordered(medium: WireState, can_id: int, senders: int) -> int:
    """Return whether (int) a transmission must be destroyed, and count it."""
    for place in range(FAILURES):
        order = medium.failure[place]
        if (
            order.left > 0
            and (order.identifier == ANY or order.identifier == identifier_of(can_id))
            and (order.node == ANY or senders >> order.node & 1)
        ):
            order.left -= 1
            return 1
    return 0


def power_on(
    bit_ns: int,
    node_count: int,
    *,
    start_ns: int,
    retransmission: bool,
    recovery: bool,
    window_ns: int,
) -> Records[WireState]:
    """Return an idle wire, an array of one record."""
    mediums = WireState.zeros()
    medium = mediums[0]
    medium.bit_ns = bit_ns
    medium.node_count = node_count
    medium.retransmission = retransmission
    medium.recovery = recovery
    medium.window_ns = window_ns
    medium.window_end_ns = start_ns + window_ns
    medium.start_ns = medium.now_ns = medium.free_ns = medium.idle_from_ns = start_ns
    return mediums
