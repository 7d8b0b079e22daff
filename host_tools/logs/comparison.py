"""Where two sequences of frames differ: the first epoch and signal, and a count per signal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Integers
from rrins.dbc.frame import Frame, FrameArray, frame_array
from rrins.host_tools.files import JsonObject
from rrins.host_tools.logs.signals import (
    SignalOfMessage,
    crc_of_frames_holds,
    name_of_identifier,
    signals_of,
)

KEPT_BY_THE_CLOCK = frozenset(
    {
        ("FIRMWARE_STATUS", "load_percent"),
        ("FIRMWARE_STATUS", "clock_error_ppm"),
        ("FIRMWARE_FAULTS", "overruns"),
    }
)
"""Signals that report timing, not results: a real-time run differs in them from its own replay.
They are not compared."""

BEFORE_SYNC = -(1 << 38)
"""Key of the first frame of a message before the first SYNC; later ones count up from it."""

_KEY_SHIFT, _IDENTIFIER_SHIFT, _MOST_ALIKE = 24, 12, 4095


@dataclass(frozen=True)
class Sent:
    """Frames of one sequence, with their comparison keys."""

    frames: FrameArray
    key: Integers  #: step or epoch, never decreasing; before the first SYNC see `BEFORE_SYNC`
    epoch: Integers  #: epoch to report; negative before the first SYNC

    def only(self, mask: NDArray[np.bool_]) -> Sent:
        """Return the selected frames."""
        return Sent(self.frames[mask], self.key[mask], self.epoch[mask])


def nothing_sent() -> Sent:
    """Return an empty sequence."""
    none = np.zeros(0, dtype=np.int64)
    return Sent(frame_array(0), none, none)


def joined(blocks: Sequence[Sent]) -> Sent:
    """Return the frames of all blocks, concatenated."""
    return Sent(
        Frame.joined([block.frames for block in blocks]),
        np.concatenate([block.key for block in blocks]),
        np.concatenate([block.epoch for block in blocks]),
    )


@dataclass(frozen=True)
class Difference:
    """A signal that differs in one frame.

    `signal` is None if only one side has the frame; `values` are texts.
    """

    key: int
    position: int
    epoch: int
    message: str
    signal: str | None
    values: tuple[str, str]


@dataclass
class Tally:
    """Count of differences in one signal."""

    frames: int = 0
    first_epoch: int = 0
    largest: float | None = None
    unit: str = ""


class Comparison:
    """Compares two sequences of frames, block by block.

    Parameters
    ----------
    names : pair of str
        Names of the two sequences in texts.
    messages : set of str, optional
        Messages to compare; by default every message of the DBC.

    Attributes
    ----------
    first : Difference or None
    tallies : dict
        By (message, signal), in order of first difference.
    frames : int
        Frames compared.
    others : int
        Frames of either side that are not in the DBC and were not compared.
    """

    def __init__(self, names: tuple[str, str], messages: frozenset[str] | None = None) -> None:
        self.names = names
        self.first: Difference | None = None
        self.tallies: dict[tuple[str, str | None], Tally] = {}
        self.frames = 0
        self.others = 0
        self._messages = messages

    @property
    def is_same(self) -> bool:
        """Whether no difference has been found so far."""
        return self.first is None

    def text(self) -> str:
        """Return the first difference as a line."""
        first = self.first
        if first is None:
            others = f"; {self.others} unknown to the DBC were not compared"
            return f"no difference in {self.frames} frames" + (others if self.others else "")
        what = first.message if first.signal is None else f"{first.message}.{first.signal}"
        ours, theirs = (
            f"{value} in {name}" for value, name in zip(first.values, self.names, strict=True)
        )
        when = f"at epoch {first.epoch}"
        if first.epoch < 0:
            when = f"before the first SYNC, in frame {first.key - BEFORE_SYNC + 1} of its message"
        return f"the first difference is {when}: {what} is {ours}, {theirs}"

    def summary(self) -> JsonObject:
        """Return the result as plain values, with signals in order of first difference."""
        rows = sorted(self.tallies.items(), key=lambda item: item[1].first_epoch)
        return {
            "frames": self.frames,
            "is_same": self.is_same,
            "first_epoch": None if self.first is None else _known_epoch(self.first.epoch),
            "first_message": None if self.first is None else self.first.message,
            "first_signal": None if self.first is None else self.first.signal,
            "first_values": None if self.first is None else list(self.first.values),
            "signals": [
                {
                    "signal": f"{message}.{signal}" if signal else f"{message} (whole frames)",
                    "first_epoch": _known_epoch(tally.first_epoch),
                    "frames": tally.frames,
                    "largest": tally.largest,
                    "unit": tally.unit,
                }
                for (message, signal), tally in rows
            ],
        }

    def add(self, ours: Sent, theirs: Sent) -> None:
        """Compare a block; it must contain all frames of its keys."""
        ours, theirs = self._wanted(ours), self._wanted(theirs)
        mine, yours = _identities(ours), _identities(theirs)
        _, left, right = np.intersect1d(mine, yours, assume_unique=True, return_indices=True)
        self.frames += len(left)
        found = list(self._missing_frames(ours, np.setdiff1d(mine, yours, True), mine, 0))
        found += self._missing_frames(theirs, np.setdiff1d(yours, mine, True), yours, 1)
        differs = (ours.frames["data"][left] != theirs.frames["data"][right]) | (
            ours.frames["length"][left] != theirs.frames["length"][right]
        )
        left, right = left[differs], right[differs]
        for identifier in np.unique(ours.frames["can_id"][left]).tolist():
            of_message = ours.frames["can_id"][left] == identifier
            found += self._differing_signals(
                str(name_of_identifier(identifier)),
                ours,
                theirs,
                left[of_message],
                right[of_message],
            )
        if found:
            first = min(found, key=lambda one: (one.key, one.position))
            if self.first is None or first.key < self.first.key:
                self.first = first

    def _wanted(self, sent: Sent) -> Sent:
        identifiers = sent.frames["can_id"]
        names = {n: name_of_identifier(n) for n in np.unique(identifiers).tolist()}
        wanted = [
            n
            for n, name in names.items()
            if name is not None and (self._messages is None or name in self._messages)
        ]
        unknown = [n for n, name in names.items() if name is None]
        self.others += int(np.isin(identifiers, unknown).sum())
        return sent.only(np.isin(identifiers, wanted))

    def _missing_frames(
        self, sent: Sent, alone: Integers, identities: Integers, side: int
    ) -> Iterator[Difference]:
        """Yield the first frame of each message that only one side has."""
        rows = np.flatnonzero(np.isin(identities, alone))
        for identifier in np.unique(sent.frames["can_id"][rows]).tolist():
            of_message = rows[sent.frames["can_id"][rows] == identifier]
            row = int(of_message[0])
            name = str(name_of_identifier(identifier))
            values = ("there", "missing") if side == 0 else ("missing", "there")
            yield self._count_difference(sent, row, len(of_message), name, None, values)

    def _count_difference(
        self,
        sent: Sent,
        row: int,
        frames: int,
        message: str,
        signal: str | None,
        values: tuple[str, str],
        largest: float | None = None,
        unit: str = "",
    ) -> Difference:
        epoch = int(sent.epoch[row])
        tally = self.tallies.setdefault((message, signal), Tally(first_epoch=epoch, unit=unit))
        tally.frames += frames
        tally.first_epoch = min(tally.first_epoch, epoch)
        if largest is not None:
            tally.largest = max(largest, tally.largest or 0.0)
        return Difference(int(sent.key[row]), row, epoch, message, signal, values)

    def _differing_signals(
        self,
        message: str,
        ours: Sent,
        theirs: Sent,
        left: NDArray[np.intp],
        right: NDArray[np.intp],
    ) -> Iterator[Difference]:
        """Yield the first difference of each signal in pairs of frames of one message."""
        mine, yours = ours.frames[left], theirs.frames[right]
        is_sound = crc_of_frames_holds(mine, message) & crc_of_frames_holds(yours, message)
        explained = np.zeros(len(left), dtype=np.bool_)
        signals = signals_of(message)
        checked = [s for s in signals if s.name != "crc"] + [s for s in signals if s.name == "crc"]
        for signal in checked:
            differs = signal.raw(mine["data"]) != signal.raw(yours["data"])
            if (
                signal.name == "crc"
            ):  # a consequence of other differences, unless it is the only one
                differs &= ~explained & ~is_sound
            elif (message, signal.name) in KEPT_BY_THE_CLOCK:
                explained |= differs & is_sound
                differs &= ~is_sound
            explained |= differs
            if differs.any():
                yield self._signal_difference(
                    signal, ours, left[differs], mine[differs], yours[differs]
                )
        odd = ~explained & (~is_sound | (mine["length"] != yours["length"]))
        if odd.any():
            row = int(left[odd][0])
            values = (_payload(mine[odd][0]), _payload(yours[odd][0]))
            yield self._count_difference(
                ours, row, int(odd.sum()), message, "(bits outside all signals)", values
            )

    def _signal_difference(
        self,
        signal: SignalOfMessage,
        ours: Sent,
        rows: NDArray[np.intp],
        mine: FrameArray,
        yours: FrameArray,
    ) -> Difference:
        values = (signal.text(int(mine["data"][0])), signal.text(int(yours["data"][0])))
        apart = None
        if not signal.choices:
            apart = float(np.max(signal.apart(mine["data"], yours["data"])))
        return self._count_difference(
            ours, int(rows[0]), len(rows), signal.message, signal.name, values, apart, signal.unit
        )


def _known_epoch(epoch: int) -> int | None:
    """Return an epoch for the summary: None before the first SYNC."""
    return epoch if epoch >= 0 else None


def _payload(frame: Frame) -> str:
    return int(frame["data"]).to_bytes(8, "little")[: int(frame["length"])].hex(" ").upper()


def _identities(sent: Sent) -> Integers:
    """Return a number for each frame that encodes its key, its message and its occurrence."""
    identifiers = sent.frames["can_id"].astype(np.int64)
    base = (sent.key << _KEY_SHIFT) | (identifiers << _IDENTIFIER_SHIFT)
    return base + np.minimum(occurrences(base), _MOST_ALIKE)


def occurrences(numbers: Integers) -> Integers:
    """Return how often each number has occurred before."""
    order = np.argsort(numbers, kind="stable")
    ordered = numbers[order]
    begins = np.diff(ordered, prepend=ordered[:1] - 1) != 0
    found = np.empty_like(numbers)
    places = np.arange(len(ordered))
    found[order] = places - np.maximum.accumulate(np.where(begins, places, 0))
    return found
