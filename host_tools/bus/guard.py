"""Rights of third parties on a bus with the two sides of a rehearsal: the host knows who sends.

- What the contract gives to one side is taken from that side only, while it is attached. Frames
  with such an identifier from anybody else, and error frames, which are a controller's, are not
  delivered. They are counted, and their sender is named. A host can be told to let them through.
- Only the sides close epochs. Whoever else claims to is cut off.
- While epochs run, a third party has so many frames in each. Whoever sends more waits for the next
  epochs, as on a wire that is taken, and a batch larger than any is cut off: the sides lose no
  frame, and a rehearsal goes on beside a flood.

A side is whoever carries its name. Nobody is held to anything on a bus without sides.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Iterable
from typing import Final, NamedTuple, TypedDict

from rrins.dbc.frame import ERR_FLAG
from rrins.host_tools.bus import datagram
from rrins.host_tools.bus.peer import Peer

FIRMWARE: Final = "firmware"
HARDWARE: Final = "hardware"
SIDES: Final = (FIRMWARE, HARDWARE)
"""Names of the two sides on a bus."""

FRAMES_PER_EPOCH: Final = 16
"""Frames that a third party may send in an epoch, lastingly."""
BURST: Final = 64
"""Frames that it may send at once after a rest."""
LARGEST_BATCH: Final = 256
"""Most frames of a third party's batch; they use up the epochs that follow."""

_ROOM: Final = 1024  # frames of all third parties in an epoch: a side has room for 4096
_LINE_NS: Final = 10_000_000_000  # between two lines about frames that are not delivered
_MOST_SENDERS: Final = 16  # counted by name
_OTHERS: Final = "others"

_now: Final = time.monotonic_ns


class BusSummary(TypedDict):
    """Frames that a host has refused."""

    refused_frames: int  #: that the contract gives to a side, from somebody else
    senders: dict[str, int]  #: the same by sender
    cut_off: int  #: peers that were disconnected for what they had sent
    held_back: list[str]  #: peers that had to wait, as they sent too much


class Refused(NamedTuple):
    """Frames that a host has not delivered, as they were another's.

    Attributes
    ----------
    frames : int
        Of all senders.
    line : str
        Who has sent the last ones; empty if there were none.
    """

    frames: int
    line: str


NOTHING_REFUSED: Final = Refused(0, "")


class _Owned(NamedTuple):
    """A message that the contract gives to one side."""

    name: str
    side: str


@functools.cache
def _owned() -> dict[int, _Owned]:
    """Return the messages of the contract that one of the sides sends, by identifier."""
    from rrins.dbc.codec import load  # half a second, for which a bus without sides does not wait

    codec = load()
    return {
        codec.frame_id(message.name): _Owned(message.name, side)
        for message in codec.facts.messages
        for side in SIDES
        if list(message.senders) == [side.upper()]
    }


class Guard:
    """Holds third parties to what they may do.

    Parameters
    ----------
    foreign_senders : bool
        Whether anybody may send what the contract gives to a side.

    Attributes
    ----------
    is_on : bool
        Whether a side is on the bus.
    epoch : int
        Epochs that the hardware has opened.
    refused : int
        Frames that were not delivered.
    cut_off : int
        Peers that were disconnected for what they had sent.
    """

    def __init__(self, foreign_senders: bool) -> None:
        self._foreign_senders = foreign_senders
        self._sides: tuple[str, ...] = ()
        self._senders: dict[str, int] = {}
        self._held_back: dict[str, None] = {}
        self._room = _ROOM
        self._next_line_ns = 0
        self.is_on = False
        self.epoch = 0
        self.refused = 0
        self.cut_off = 0
        self.last_line = ""

    def meet(self, names: Iterable[str]) -> None:
        """Take note of who is on the bus, the host among them."""
        self._sides = tuple(side for side in SIDES if side in names)
        self.is_on = bool(self._sides)
        if self.is_on:
            _owned()  # before epochs follow each other

    @property
    def has_hardware(self) -> bool:
        """Whether the hardware is on the bus, whose time is everybody's."""
        return HARDWARE in self._sides

    def open_epoch(self, epochs: int = 1) -> None:
        """Begin an epoch, or some: those who had to wait may send again."""
        self.epoch += epochs
        self._room = _ROOM

    def must_wait(self, peer: Peer) -> bool:
        """Return whether a third party has sent its share of this epoch."""
        if not self.epoch:
            return False
        gained = (self.epoch - peer.epoch) * FRAMES_PER_EPOCH
        peer.allowance = min(BURST, peer.allowance + gained)
        peer.epoch = self.epoch
        return peer.allowance <= 0 or self._room <= 0

    def hold_back(self, peer: Peer) -> str:
        """Take note that a third party has to wait; return a line about that, once for each."""
        name = str(peer)
        if name in self._held_back or len(self._held_back) >= _MOST_SENDERS:
            return ""
        self._held_back[name] = None
        return f"sends more than {FRAMES_PER_EPOCH} frames an epoch: what is too much waits"

    def check(
        self, peer: Peer, buffer: bytearray, size: int, kind: int, flags: int, count: int
    ) -> int:
        """Check a batch of a third party, and take out what is not its own.

        Parameters
        ----------
        peer : Peer
        buffer : bytearray
            Holds the datagram, checked by `datagram.parse`, in its first `size` bytes.
        size, kind, flags, count : int
            Of the datagram.

        Returns
        -------
        int
            Size of what is left in `buffer`; 0 if that is not a frame.

        Raises
        ------
        ProtocolError
            If it closes an epoch, or is too large.
        """
        if flags & datagram.CLOSES_EPOCH:
            raise datagram.ProtocolError(
                f"a batch that closes an epoch, as only {' and '.join(SIDES)} do"
            )
        if self.epoch and count > LARGEST_BATCH:
            raise datagram.ProtocolError(
                f"a batch of {count} frames, of at most {LARGEST_BATCH} while epochs run"
            )
        if self.epoch:
            used = max(1, count)
            peer.allowance -= used
            self._room -= used
        if self._foreign_senders:
            return size
        owned, sides = _owned(), self._sides
        has_hardware = HARDWARE in sides
        keep: list[int] = []
        last = 0
        for place, can_id in enumerate(datagram.identifiers(buffer, size, kind)):
            owner = owned.get(can_id)
            is_foreign = (
                has_hardware and can_id & ERR_FLAG if owner is None else owner.side in sides
            )
            if is_foreign:
                last = can_id
            else:
                keep.append(place)
        if len(keep) == count:
            return size
        self._refuse(peer, count - len(keep), owned.get(last))
        return datagram.keep_frames(buffer, kind, keep) if keep else 0

    def _refuse(self, peer: Peer, count: int, owner: _Owned | None) -> None:
        self.refused += count
        name = str(peer)
        if name not in self._senders and len(self._senders) >= _MOST_SENDERS:
            name = _OTHERS
        self._senders[name] = self._senders.get(name, 0) + count
        what = f"{owner.name}, which is the {owner.side}'s" if owner else "error frames"
        self.last_line = (
            f"{peer} sends {what}: not delivered ({self._senders[name]} frames so far; "
            "--foreign-senders of the hardware allows it)"
        )

    def due_line(self) -> str:
        """Return a line about the last frames that were not delivered; empty if it is too early."""
        now_ns = _now()
        if now_ns < self._next_line_ns:
            return ""
        self._next_line_ns = now_ns + _LINE_NS
        return self.last_line

    def statistics(self) -> BusSummary:
        """Return what was not let through so far."""
        return {
            "refused_frames": self.refused,
            "senders": dict(self._senders),
            "cut_off": self.cut_off,
            "held_back": list(self._held_back),
        }
