"""Consecutive transmissions, and their effect on the nodes.

Interframe space, suspend transmission and fault confinement: Bosch, *CAN Specification 2.0*, 1991,
part A, 3.1.5 and 7. What becomes of a transmission is told in `rrins.host_tools.wire.arbitration`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Records
from rrins.dbc.frame import FrameArray
from rrins.host_tools.wire.arbitration import SENT, UNACKNOWLEDGED, settle
from rrins.host_tools.wire.bits import INTERMISSION_BITS
from rrins.host_tools.wire.confinement import (
    RECOVERY_SEQUENCE_BITS,
    SUSPEND_BITS,
    NodeState,
    acknowledge_error,
    receive_error,
    received,
    recessive,
    state_of,
    transmit_error,
    transmitted,
)
from rrins.host_tools.wire.load import occupy
from rrins.host_tools.wire.state import (
    IdentifierCounts,
    WireState,
    discard_all,
    identifier_row,
    next_start_ns,
    remove,
)

_ACTIVE = int(NodeState.ERROR_ACTIVE)
_PASSIVE = int(NodeState.ERROR_PASSIVE)


@compiled
def _show_recessive(medium: WireState, sequences: int) -> None:
    """Let the nodes that are off the bus see sequences of recessive bits."""
    if not medium.recovery:
        return
    for index in range(medium.node_count):
        if medium.fault[index].bus_off:
            medium.nodes_off -= recessive(medium.fault[index], sequences)


@compiled
def _idle_until(medium: WireState, time_ns: int) -> None:
    """Advance an idle bus to a time, for the nodes that are bus-off."""
    sequence_ns = RECOVERY_SEQUENCE_BITS * medium.bit_ns
    sequences = (time_ns - medium.idle_from_ns) // sequence_ns
    if medium.nodes_off > 0 and sequences > 0:
        medium.idle_from_ns += sequences * sequence_ns
        _show_recessive(medium, sequences)


@compiled
def _withdraw(medium: WireState, index: int) -> None:
    """Note what a node sends; take it out of the queue if it will not be sent again."""
    sending = medium.transmission[0]
    node = medium.node[index]
    entry = medium.entry[node.chosen]
    node.sending_id = entry.can_id
    node.sending_ready_ns = entry.ready_ns
    node.sending_attempts = entry.attempts
    if sending.outcome == SENT and sending.senders >> index & 1:
        remove(medium, index, node.chosen)
    elif medium.retransmission:
        entry.attempts += 1
    else:
        node.abandoned += 1
        remove(medium, index, node.chosen)


@compiled
def _begin(medium: WireState, time_ns: int) -> None:
    """Begin the transmission of a time at which some node is ready."""
    sending = medium.transmission[0]
    bits = settle(medium, time_ns)
    sending.active = 1
    sending.start_ns = time_ns
    sending.end_ns = time_ns + bits * medium.bit_ns
    sending.busy_ns = (bits + INTERMISSION_BITS) * medium.bit_ns
    medium.free_ns = time_ns + sending.busy_ns
    occupy(medium, time_ns, medium.free_ns)
    for index in range(medium.node_count):
        if (sending.senders | sending.losers) >> index & 1:
            _withdraw(medium, index)


@compiled
def _count_error(medium: WireState, index: int, row: IdentifierCounts, dominant: bool) -> None:
    sending = medium.transmission[0]
    node, fault = medium.node[index], medium.fault[index]
    node.errors += 1
    row.errors += 1
    if sending.outcome == UNACKNOWLEDGED and not sending.losers >> index & 1:
        off = acknowledge_error(fault, dominant)
    else:
        off = transmit_error(fault)
    if off:
        medium.nodes_off += 1
        node.bus_offs += 1
        discard_all(medium, index)


@compiled
def _finish_sender(medium: WireState, index: int, dominant: bool) -> None:
    """Account the end of the transmission for one that sent."""
    sending = medium.transmission[0]
    node, fault = medium.node[index], medium.fault[index]
    row = medium.identifier[identifier_row(node.sending_id)]
    node.busy_ns += sending.busy_ns
    row.busy_ns += sending.busy_ns
    if node.sending_attempts > 0:
        node.retransmissions += 1
        row.retransmissions += 1
    if sending.outcome == SENT and sending.senders >> index & 1:
        node.sent += 1
        row.sent += 1
        row.worst_delay_ns = max(row.worst_delay_ns, sending.start_ns - node.sending_ready_ns)
        row.worst_response_ns = max(row.worst_response_ns, sending.end_ns - node.sending_ready_ns)
        transmitted(fault)
    else:
        _count_error(medium, index, row, dominant)
    if state_of(fault) == _PASSIVE:
        node.free_ns = medium.free_ns + SUSPEND_BITS * medium.bit_ns


@compiled
def _finish(medium: WireState) -> None:
    """Account the end of the transmission for all nodes."""
    sending = medium.transmission[0]
    sending.active = 0
    if medium.nodes_off > 0:
        # Behind an ACK slot or error flag: delimiter and EOF or delimiter, then intermission.
        _show_recessive(medium, 1)
    medium.idle_from_ns = medium.free_ns
    active_flags = 0
    for index in range(medium.node_count):
        if sending.senders >> index & 1 and state_of(medium.fault[index]) == _ACTIVE:
            active_flags += 1
    for index in range(medium.node_count):
        if (sending.senders | sending.losers) >> index & 1:
            _finish_sender(medium, index, active_flags > 0 and not medium.cut)
        elif medium.cut or medium.node[index].silent or medium.fault[index].bus_off:
            continue
        elif sending.outcome == SENT:
            received(medium.fault[index])
        else:
            receive_error(medium.fault[index])


@compiled
def advance(
    mediums: Records[WireState],
    until_ns: int,
    frames: FrameArray,
    times_ns: NDArray[np.int64],
    senders: NDArray[np.int64],
    receivers: NDArray[np.int64],
) -> int:
    """Run the wire up to a time; return how many frames ended by then.

    A frame that is ready at `until_ns` waits: others may still be submitted for that time. If the
    arrays are full the wire stops before the frame that has no room.

    Parameters
    ----------
    mediums : Records[WireState]
        Changed in place.
    until_ns : int
    frames : FrameArray
        The frames sent, in the order of the bus.
    times_ns, senders, receivers : arrays of the same length
        End of each frame's EOF, its node, and a bit for each node that received it.
    """
    medium = mediums[0]
    sending = medium.transmission[0]
    count = 0
    while True:
        if sending.active:
            if sending.end_ns > until_ns:
                break
            if sending.outcome == SENT:
                if count == len(frames):
                    medium.now_ns = max(medium.now_ns, sending.start_ns)
                    return count
                frame = frames[count]
                frame.can_id = sending.can_id
                frame.length = sending.length
                frame.flags = 0
                frame.reserved = 0
                frame.raw_dlc = 0
                frame.data = sending.payload
                times_ns[count] = sending.end_ns
                senders[count] = sending.leader
                receivers[count] = sending.receivers
                count += 1
            _finish(medium)
        start_ns = next_start_ns(medium, until_ns)
        if start_ns >= until_ns:
            _idle_until(medium, until_ns)
            break
        _idle_until(medium, start_ns)
        _begin(medium, start_ns)
    medium.now_ns = max(medium.now_ns, until_ns)
    return count
