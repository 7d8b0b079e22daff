"""Worst-case response times of periodic messages on a CAN bus.

R. I. Davis, A. Burns, R. J. Bril, J. J. Lukkien, *Controller Area Network (CAN) schedulability
analysis: Refuted, revisited and revised*, Real-Time Systems 35 (2007), 239-272, section 3: the test
with all instances in the busy period. It holds for nodes that always put their strongest frame
forward, and without errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from rrins.host_tools.wire.bits import arbitration_key
from rrins.host_tools.wire.timing import bit_time_ns


@dataclass(frozen=True)
class Message:
    """A periodic message.

    Attributes
    ----------
    identifier : int
        With `EFF_FLAG` of `rrins.dbc.frame` if it is extended, `RTR_FLAG` if it is remote.
    bits : int
        Longest frame with its intermission; see `longest_bits`.
    period_ns : int
        Shortest time from one to the next.
    jitter_ns : int
        How much later than the event that calls for it a frame may be submitted.
    """

    identifier: int
    bits: int
    period_ns: int
    jitter_ns: int = 0


def longest_bits(length: int, extended: bool = False) -> int:
    """Return the bits of the longest data frame of `length` bytes, with its intermission.

    Davis et al. (2007), section 2: 55 + 10 s and 80 + 10 s.
    """
    return (80 if extended else 55) + 10 * length


def response_bounds(messages: Sequence[Message], bitrate: int) -> dict[int, int | None]:
    """Return for each identifier how long in ns a frame takes at most, None for no bound.

    From the event that calls for a frame to the end of the intermission after it.
    """
    bit_ns = bit_time_ns(bitrate)
    ordered = sorted(messages, key=lambda message: int(arbitration_key(message.identifier)))
    identifiers = {message.identifier for message in ordered}
    if len(identifiers) < len(ordered):
        raise ValueError("two messages have the same identifier")
    for message in ordered:
        if message.bits <= 0 or message.period_ns <= 0 or message.jitter_ns < 0:
            raise ValueError(f"{message}: bits and period must be above 0, jitter 0 at least")
    return {
        message.identifier: _bound(ordered, rank, bit_ns) for rank, message in enumerate(ordered)
    }


def _demand(messages: Sequence[Message], time_ns: int, bit_ns: int) -> int:
    """Return the messages' worst-case demand on the bus within a time, in ns."""
    return sum(
        -(-(time_ns + message.jitter_ns) // message.period_ns) * message.bits * bit_ns
        for message in messages
    )


def _bound(ordered: Sequence[Message], rank: int, bit_ns: int) -> int | None:
    message = ordered[rank]
    higher, own = ordered[:rank], ordered[: rank + 1]
    if sum(Fraction(each.bits * bit_ns, each.period_ns) for each in own) >= 1:
        return None
    length_ns = message.bits * bit_ns
    blocking_ns = max((each.bits for each in ordered[rank + 1 :]), default=0) * bit_ns
    # The longest busy period and the instances in it.
    busy_ns, before_ns = length_ns, 0
    while busy_ns != before_ns:
        before_ns = busy_ns
        busy_ns = blocking_ns + _demand(own, before_ns, bit_ns)
    instances = -(-(busy_ns + message.jitter_ns) // message.period_ns)
    worst_ns = 0
    waiting_ns = blocking_ns
    for instance in range(instances):
        # The queueing delay of this instance; it begins with the last one's.
        waiting_ns = max(waiting_ns, blocking_ns + instance * length_ns)
        before_ns = -1
        while waiting_ns != before_ns:
            before_ns = waiting_ns
            waiting_ns = (
                blocking_ns + instance * length_ns + _demand(higher, before_ns + bit_ns, bit_ns)
            )
        response_ns = message.jitter_ns + waiting_ns - instance * message.period_ns + length_ns
        worst_ns = max(worst_ns, response_ns)
    return worst_ns
