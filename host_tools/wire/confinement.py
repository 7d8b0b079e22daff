"""Fault confinement: the error counters of a node, and the resulting state.

ISO 11898-1; the rules by their numbers in Bosch, *CAN Specification 2.0*, 1991, part A, 7:

=====  =============================================================================  =========
rule   what                                                                           modelled
=====  =============================================================================  =========
1      a receiver detects an error: REC + 1                                           yes
2      a receiver sees a dominant bit first after its error flag: REC + 8             no: (1)
3      a transmitter sends an error flag: TEC + 8                                     yes
3.1    not if it is error-passive, misses the ACK and sees no dominant bit            yes
       while it sends its passive error flag
3.2    not for a stuff error in arbitration whose stuff bit was sent recessive        no: (2)
4, 5   a bit error while an active error flag or an overload flag is sent             no: (2)
6      many dominant bits after a flag                                                no: (2)
7      a frame is sent without error: TEC - 1, not below 0                            yes
8      a frame is received without error: REC - 1, not below 0; from above 127        yes
       to a value between 119 and 127, here 127
9-12   error-passive above 127, error-active again, bus off above 255, recovery       yes
=====  =============================================================================  =========

(1) in each error of the model all receivers notice it in the same bit, so that none of them has
sent its flag before the others. (2) the model has no such errors, and no overload frames.

TEC or REC above 127 makes a node error-passive, TEC above 255 takes it off the bus. It comes back,
if it may, with both counters at 0 when the bus has shown 11 recessive bits in a row 128 times.
"""

from __future__ import annotations

from enum import IntEnum

from rrins.compiled.compilation import compiled
from rrins.compiled.record import I8, Record

ERROR_FLAG_BITS = 6
"""Length of one node's error flag, active or passive."""

LONGEST_FLAGS_BITS = 12
"""Longest superposition of error flags: one node's six bits are the others' stuff error."""

ERROR_DELIMITER_BITS = 8

SUSPEND_BITS = 8
"""Bits after the intermission for which an error-passive transmitter lets others go first."""

RECOVERY_SEQUENCES = 128
"""Sequences of recessive bits that a node waits for when it is off the bus."""

RECOVERY_SEQUENCE_BITS = 11

_PASSIVE_ABOVE = 127
_BUS_OFF_ABOVE = 255
_COUNTER_MAXIMUM = 255
_TRANSMIT_STEP = 8


class NodeState(IntEnum):
    """Fault confinement states of a node."""

    ERROR_ACTIVE = 0
    ERROR_PASSIVE = 1
    BUS_OFF = 2


class Confinement(Record):
    """One node's fault confinement; zeroed, it is a node after its reset."""

    tec: I8
    rec: I8
    bus_off: I8  #: 0 or 1
    sequences_left: I8  #: of 11 recessive bits, until a node off the bus is back


_ERROR_ACTIVE = int(NodeState.ERROR_ACTIVE)
_ERROR_PASSIVE = int(NodeState.ERROR_PASSIVE)
_BUS_OFF = int(NodeState.BUS_OFF)


@compiled
def state_of(node: Confinement) -> int:
    """Return the state of a node, a value of `NodeState`."""
    if node.bus_off:
        return _BUS_OFF
    if node.tec > _PASSIVE_ABOVE or node.rec > _PASSIVE_ABOVE:
        return _ERROR_PASSIVE
    return _ERROR_ACTIVE


@compiled
def transmitted(node: Confinement) -> None:
    """Count a frame that the node has sent without error (rule 7)."""
    node.tec = max(0, node.tec - 1)


@compiled
def received(node: Confinement) -> None:
    """Count a frame that the node has received without error (rule 8)."""
    node.rec = min(_PASSIVE_ABOVE, max(0, node.rec - 1))


@compiled
def receive_error(node: Confinement) -> None:
    """Count an error that the node has detected as a receiver (rule 1).

    REC stays within eight bits, as in a controller's register.
    """
    node.rec = min(_COUNTER_MAXIMUM, node.rec + 1)


@compiled
def transmit_error(node: Confinement) -> int:
    """Count an error that the node has detected as a transmitter (rule 3).

    Returns whether (int) that has taken the node off the bus.
    """
    node.tec += _TRANSMIT_STEP
    if node.tec <= _BUS_OFF_ABOVE or node.bus_off:
        return 0
    node.bus_off = 1
    node.sequences_left = RECOVERY_SEQUENCES
    return 1


@compiled
def acknowledge_error(node: Confinement, dominant: bool) -> int:
    """Count a missing acknowledgement (rules 3 and 3.1).

    `dominant` says whether somebody else's error flag was on the bus while the node sent its own.
    Returns whether (int) that has taken the node off the bus: never if nobody else is there,
    because an error-passive node counts no more.
    """
    if state_of(node) == _ERROR_PASSIVE and not dominant:
        return 0
    return transmit_error(node)


@compiled
def recessive(node: Confinement, sequences: int) -> int:
    """Let a node off the bus see `sequences` times 11 recessive bits.

    Returns whether (int) it is back on the bus.
    """
    node.sequences_left -= sequences
    if node.sequences_left > 0:
        return 0
    node.tec = 0
    node.rec = 0
    node.bus_off = 0
    node.sequences_left = 0
    return 1
