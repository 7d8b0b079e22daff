"""The wire and the nodes on it in virtual time, as one record of fixed size."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dbc.frame import EFF_FLAG, ERR_FLAG, FrameArray
from host_tools.bus.bits import arbitration_key
from host_tools.bus.confinement import CONFINEMENT

NODES = 16
"""Nodes that a wire has room for."""

NODE_CAPACITY = 256
"""Frames that wait in one node at most."""

FAILURES = 16
"""Orders to destroy transmissions that may be open at once."""

STANDARD_IDENTIFIERS = 2048
"""Also the row of the statistics in which all extended identifiers are together."""

ANY = -1
"""Stands for any identifier or any node in an order to destroy transmissions."""


def _record(fields: list[Any]) -> np.dtype[Any]:
    return np.dtype((np.record, fields))


ENTRY = _record(
    [
        ("key", "<i8"),  # see `host_tools.bus.bits.arbitration_key`
        ("sequence", "<i8"),  # order of submission over all nodes
        ("ready_ns", "<i8"),  # submitted for this time
        ("attempts", "<i8"),  # transmissions that failed
        ("payload", "<u8"),
        ("can_id", "<u4"),
        ("length", "u1"),
    ]
)
"""A frame that waits in a node."""

NODE = _record(
    [
        ("count", "<i8"),  # frames waiting
        ("silent", "<i8"),  # 0 or 1
        ("free_ns", "<i8"),  # suspended until then
        ("chosen", "<i8"),  # index of the frame put forward for arbitration, -1 for none
        # Of the transmission that it takes part in.
        ("sending_id", "<i8"),
        ("sending_ready_ns", "<i8"),
        ("sending_attempts", "<i8"),
        # Statistics.
        ("submitted", "<i8"),
        ("sent", "<i8"),
        ("errors", "<i8"),  # own transmissions that an error frame ended
        ("retransmissions", "<i8"),
        ("busy_ns", "<i8"),
        ("overflowed", "<i8"),  # lost, because the queue was full
        ("discarded", "<i8"),  # lost, because the node was silent or off the bus
        ("abandoned", "<i8"),  # lost, because nothing is sent again
        ("invalid", "<i8"),  # lost, because they are no frames of a bus
        ("bus_offs", "<i8"),
        ("most_waiting", "<i8"),
    ]
)
"""A node: its fault confinement and its waiting frames are in arrays of their own."""

IDENTIFIER = _record(
    [
        ("sent", "<i8"),
        ("errors", "<i8"),
        ("retransmissions", "<i8"),
        ("busy_ns", "<i8"),
        ("worst_delay_ns", "<i8"),
        ("worst_response_ns", "<i8"),
    ]
)
"""Statistics of an identifier."""

FAILURE = _record([("left", "<i8"), ("identifier", "<i8"), ("node", "<i8")])
"""An order to destroy the next transmissions that match; `ANY` matches all."""

TRANSMISSION = _record(
    [
        ("active", "<i8"),
        ("outcome", "<i8"),
        ("start_ns", "<i8"),
        ("end_ns", "<i8"),  # of EOF, or of the error delimiter
        ("busy_ns", "<i8"),  # with the intermission
        ("senders", "<i8"),  # a bit per node
        ("losers", "<i8"),  # error-passive nodes whose bit error disturbed nobody
        ("receivers", "<i8"),
        ("leader", "<i8"),  # lowest of the senders
        ("payload", "<u8"),
        ("can_id", "<u4"),
        ("length", "u1"),
    ]
)
"""The transmission on the wire; what becomes of it is settled when it begins."""

MEDIUM = _record(
    [
        ("bit_ns", "<i8"),
        ("node_count", "<i8"),
        ("retransmission", "<i8"),
        ("recovery", "<i8"),
        ("cut", "<i8"),
        ("start_ns", "<i8"),
        ("now_ns", "<i8"),
        ("free_ns", "<i8"),  # end of the last intermission
        ("idle_from_ns", "<i8"),  # recessive bits are counted up to here
        ("nodes_off", "<i8"),
        ("sequence", "<i8"),
        ("busy_ns", "<i8"),  # up to free_ns, which may lie ahead of now_ns
        ("window_ns", "<i8"),
        ("window_end_ns", "<i8"),
        ("window_busy_ns", "<i8"),
        ("last_window_busy_ns", "<i8"),
        ("worst_window_busy_ns", "<i8"),
        ("transmission", TRANSMISSION, (1,)),
        ("failure", FAILURE, (FAILURES,)),
        ("fault", CONFINEMENT, (NODES,)),
        ("node", NODE, (NODES,)),
        ("entry", ENTRY, (NODES * NODE_CAPACITY,)),  # those of a node lie together
        ("identifier", IDENTIFIER, (STANDARD_IDENTIFIERS + 1,)),
    ]
)
"""A wire with its nodes; times are integer nanoseconds of virtual time."""


@njit(cache=True)
def identifier_row(can_id: Any) -> Any:
    """Return the row (int64) of an identifier in the statistics."""
    word = np.int64(can_id)
    return np.int64(STANDARD_IDENTIFIERS) if word & EFF_FLAG else word & 0x7FF


@njit(cache=True)
def identifier_of(can_id: Any) -> Any:
    """Return an identifier (int64) with `EFF_FLAG` if it is extended, without other flags."""
    word = np.int64(can_id)
    return word & (EFF_FLAG | 0x1FFF_FFFF) if word & EFF_FLAG else word & 0x7FF


@njit(cache=True)
def first_ready(medium: Any, index: Any, time_ns: Any) -> Any:
    """Return the entry (int64) that a node puts forward at a time, -1 for none.

    The node behaves like a controller with a mailbox for each waiting frame: the frame with the
    strongest arbitration field first, and of equal ones the one submitted first.
    """
    entries = medium.entry
    best = np.int64(-1)
    key = np.int64(0)
    sequence = np.int64(0)
    first = index * NODE_CAPACITY
    for place in range(first, first + medium.node[index].count):
        entry = entries[place]
        if entry.ready_ns > time_ns:
            continue
        if best < 0 or entry.key < key or (entry.key == key and entry.sequence < sequence):
            best, key, sequence = np.int64(place), entry.key, entry.sequence
    return best


@njit(cache=True)
def next_start_ns(medium: Any, latest_ns: Any) -> Any:
    """Return when the next arbitration begins, or `latest_ns` if none begins before."""
    soonest = np.int64(latest_ns)
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


@njit(cache=True)
def remove(medium: Any, index: Any, place: Any) -> None:
    """Take an entry out of a node; the node's last one fills its place."""
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


@njit(cache=True)
def discard_all(medium: Any, index: Any) -> None:
    """Empty a node's queue, as a driver does when its controller leaves the bus."""
    node = medium.node[index]
    node.discarded += node.count
    node.count = 0


@njit(cache=True)
def _put(medium: Any, index: Any, frame: Any, time_ns: Any) -> Any:
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


@njit(cache=True)
def submit(mediums: NDArray[Any], index: int, frames: FrameArray, count: int, time_ns: int) -> int:
    """Put the first `count` frames into a node's queue for a time; return how many it took.

    The others are lost and counted: no frame of a bus, the node silent or off the bus now, or its
    queue full.
    """
    medium = mediums[0]
    taken = 0
    for k in range(count):
        taken += _put(medium, index, frames[k], time_ns)
    return taken


@njit(cache=True)
def failure_ordered(medium: Any, can_id: Any, senders: Any) -> Any:
    """Return whether (int) a transmission is to be destroyed, and count it."""
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
) -> NDArray[Any]:
    """Return an idle wire, an array of one record of dtype `MEDIUM`."""
    mediums = np.zeros(1, dtype=MEDIUM)
    medium = mediums[0]
    medium["bit_ns"] = bit_ns
    medium["node_count"] = node_count
    medium["retransmission"] = retransmission
    medium["recovery"] = recovery
    medium["window_ns"] = window_ns
    medium["window_end_ns"] = start_ns + window_ns
    for field in ("start_ns", "now_ns", "free_ns", "idle_from_ns"):
        medium[field] = start_ns
    return mediums
