"""Arbitration: which node wins the bus, and the outcome of each transmission.

The strongest arbitration field wins (Bosch, *CAN Specification 2.0*, 1991, part A, 2 and 3.1.1).
Lengths of a transmission that fails, from SOF to the end of the error delimiter:

==============  ================================================================================
outcome         bits
==============  ================================================================================
unacknowledged  up to the ACK slot, error flag 6, delimiter 8: nobody else is there
corrupted       up to the ACK slot, flags 6 + 1, delimiter 8: the receivers find a wrong CRC and
                do not acknowledge, so that the sender's flag begins with the ACK delimiter and
                theirs one bit later
collided        up to the first bit in which the senders differ, flags 12, delimiter 8: the longest
                superposition
==============  ================================================================================

Two senders of the same identifier with different frames: the first bit that differs is a bit error
of the one that sends it recessive. If that one is error-active its flag destroys the frame for
both, and both count a transmit error. If it is error-passive, its flag is recessive and disturbs
nobody: the other's frame goes through. Senders of the same frame superpose, and all have sent it.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.host_tools.wire.bits import (
    ACK_DELIMITER_BITS,
    EOF_BITS,
    agreed_bits,
    frame_bits,
    wire_word,
)
from rrins.host_tools.wire.confinement import (
    ERROR_DELIMITER_BITS,
    ERROR_FLAG_BITS,
    LONGEST_FLAGS_BITS,
    NodeState,
    state_of,
)
from rrins.host_tools.wire.state import WireState, failure_ordered, first_ready

SENT = 0
UNACKNOWLEDGED = 1
CORRUPTED = 2
COLLIDED = 3
"""Outcome of a transmission."""

_ACTIVE = int(NodeState.ERROR_ACTIVE)
_ALONE_BITS = ERROR_FLAG_BITS + ERROR_DELIMITER_BITS - ACK_DELIMITER_BITS - EOF_BITS
"""Bits that an error frame behind the ACK slot adds to a frame."""

_NO_KEY = 1 << 32  # above every arbitration field


@compiled
def _precedes(medium: WireState, place: int, other: int) -> bool:
    """Return whether one of two frames with the same arbitration field sends dominant first."""
    one, two = medium.entry[place], medium.entry[other]
    if one.length != two.length:
        return one.length < two.length
    first = wire_word(one.can_id, one.length, one.payload)
    return bool(first < wire_word(two.can_id, two.length, two.payload))


@compiled
def _arbitrate(medium: WireState, time_ns: int) -> int:
    """Let each node offer a frame; return the winning arbitration field."""
    key = _NO_KEY
    for index in range(medium.node_count):
        node = medium.node[index]
        node.chosen = -1
        if node.count > 0 and node.free_ns <= time_ns:
            node.chosen = first_ready(medium, index, time_ns)
            if node.chosen >= 0:
                key = min(key, medium.entry[node.chosen].key)
    return key


@compiled
def _rank(medium: WireState, key: int) -> int:
    """Find the senders of the winning frame and those that differ from it; return its entry."""
    sending = medium.transmission[0]
    best = -1
    for index in range(medium.node_count):
        chosen = medium.node[index].chosen
        if chosen < 0 or medium.entry[chosen].key != key:
            continue
        if best < 0 or _precedes(medium, chosen, best):
            best = chosen
            sending.leader = index
    sending.senders = 0
    sending.losers = 0
    for index in range(medium.node_count):
        chosen = medium.node[index].chosen
        if chosen < 0 or medium.entry[chosen].key != key:
            continue
        if chosen == best or not _precedes(medium, best, chosen):
            sending.senders |= 1 << index
        else:
            sending.losers |= 1 << index
    return best


@compiled
def _collision_bits(medium: WireState, best: int) -> int:
    """Return the bits up to the first bit error of an error-active loser, 0 if there is none."""
    sending = medium.transmission[0]
    entry = medium.entry[best]
    bits = 0
    for index in range(medium.node_count):
        if sending.losers >> index & 1 and state_of(medium.fault[index]) == _ACTIVE:
            other = medium.entry[medium.node[index].chosen]
            agreed = agreed_bits(
                entry.can_id, entry.length, entry.payload, other.length, other.payload
            )
            bits = agreed if bits == 0 else min(bits, agreed)
    return bits


@compiled
def _try_alone(medium: WireState) -> int:
    """Let every node send its frame on its separate piece of wire; return the most bits."""
    sending = medium.transmission[0]
    sending.outcome = UNACKNOWLEDGED
    sending.senders = 0
    sending.losers = 0
    longest = 0
    for index in range(medium.node_count):
        chosen = medium.node[index].chosen
        if chosen >= 0:
            entry = medium.entry[chosen]
            longest = max(longest, frame_bits(entry.can_id, entry.length, entry.payload))
            sending.senders |= 1 << index
    return longest + _ALONE_BITS


@compiled
def _share(medium: WireState, key: int) -> int:
    """Determine the outcome of the winning frame; return its bits."""
    sending = medium.transmission[0]
    best = _rank(medium, key)
    entry = medium.entry[best]
    sending.can_id = entry.can_id
    sending.length = entry.length
    sending.payload = entry.payload
    if sending.losers:
        agreed = _collision_bits(medium, best)
        if agreed > 0:
            sending.outcome = COLLIDED
            return agreed + LONGEST_FLAGS_BITS + ERROR_DELIMITER_BITS
    acknowledged = False
    sending.receivers = 0
    for index in range(medium.node_count):
        taking_part = (sending.senders | sending.losers) >> index & 1
        if not taking_part and not medium.fault[index].bus_off:
            sending.receivers |= 1 << index
            acknowledged = acknowledged or not medium.node[index].silent
    bits = frame_bits(entry.can_id, entry.length, entry.payload)
    if not acknowledged:
        sending.outcome = UNACKNOWLEDGED
        return bits + _ALONE_BITS
    if failure_ordered(medium, entry.can_id, sending.senders):
        sending.outcome = CORRUPTED
        return bits + _ALONE_BITS + 1
    sending.outcome = SENT
    return bits


@compiled
def settle(medium: WireState, time_ns: int) -> int:
    """Settle the transmission that begins at a time when some node is ready.

    Writes who sends, who receives and the outcome; returns the bits (int64) up to the end of EOF
    or of the error delimiter.
    """
    key = _arbitrate(medium, time_ns)
    return _try_alone(medium) if medium.cut else _share(medium, key)
