"""Signals of the contract by name: units, columns of values, names that a person may have meant."""

from __future__ import annotations

import difflib
import functools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dbc.codec import load, to_physical, unpack
from dbc.e2e import crc_holds
from dbc.frame import FrameArray
from host_tools.logs.errors import RecordError

PROTECTION = ("crc", "alive_counter")
"""Signals that every message has for its protection."""

_SUFFIXES = {
    "deg": "deg",
    "deg/s": "dps",
    "rad": "rad",
    "m/s": "mps",
    "m": "m",
    "s": "s",
    "ms": "ms",
    "us": "us",
    "%": "percent",
    "ppm": "ppm",
}
"""How a unit of the DBC ends a name; see docs/conventions.md."""


@dataclass(frozen=True)
class SignalOfMessage:
    """A signal of a message, and how to get it out of frames.

    Attributes
    ----------
    message, name : str
    unit : str
        As the DBC writes it; empty without one.
    comment : str
    choices : mapping of int to str
        Names of its values; empty for a number.
    scale : float
    span : float
        Whole range of its field.
    is_whole : bool
        Whether its values are whole numbers.
    row : int
        In `Codec.signals`.
    """

    message: str
    name: str
    unit: str
    comment: str
    choices: Mapping[int, str]
    scale: float
    span: float
    is_whole: bool
    row: int

    @property
    def full_name(self) -> str:
        """Return `MESSAGE.signal`."""
        return f"{self.message}.{self.name}"

    @property
    def column(self) -> str:
        """Return the name with the unit at its end, as the project writes units."""
        suffix = _suffix(self.unit)
        has_one = not suffix or self.name.endswith(f"_{suffix}")
        return self.name if has_one else f"{self.name}_{suffix}"

    def raw(self, words: NDArray[np.uint64]) -> NDArray[np.int64]:
        """Return the raw integers in payload words."""
        out = np.zeros(len(words), dtype=np.int64)
        _unpack_column(words, load().signals, self.row, out)
        return out

    def values(self, words: NDArray[np.uint64]) -> NDArray[Any]:
        """Return the values in payload words, whole numbers as int64, others as float64."""
        if self.is_whole and self.scale == 1:
            return self.raw(words)
        out = np.zeros(len(words), dtype=np.float64)
        _decode_column(words, load().signals, self.row, out)
        return out.astype(np.int64) if self.is_whole else out

    def apart(self, ours: NDArray[np.uint64], theirs: NDArray[np.uint64]) -> NDArray[Any]:
        """Return by how much the values in payload words differ, angles the shorter way round."""
        difference = np.abs(self.values(ours) - self.values(theirs))
        if self.unit == "deg" and self.span % 360 == 0:
            return np.minimum(difference, self.span - difference)
        return difference

    def text(self, word: int) -> str:
        """Return the value in a payload word as a person reads it, to its resolution."""
        words = np.array([word], dtype=np.uint64)
        raw = int(self.raw(words)[0])
        if raw in self.choices:
            return f"{self.choices[raw]} ({raw})"
        value = self.values(words)[0]
        unit = f" {self.unit}" if self.unit else ""
        if self.is_whole:
            return f"{value}{unit}"
        digits = max(0, -math.floor(math.log10(self.scale)))
        return f"{value:.{digits}f}{unit}"


def _suffix(unit: str) -> str:
    known = _SUFFIXES.get(unit)
    if known is not None:
        return known
    words = unit.replace("/", "_per_").replace("°", "deg").replace("µ", "u")
    return "".join(letter if letter.isalnum() or letter == "_" else "" for letter in words)


@njit(cache=True)
def _unpack_column(words: Any, signals: Any, row: int, out: Any) -> None:
    for k in range(len(words)):
        out[k] = unpack(words[k], signals[row])


@njit(cache=True)
def _decode_column(words: Any, signals: Any, row: int, out: Any) -> None:
    for k in range(len(words)):
        out[k] = to_physical(unpack(words[k], signals[row]), signals[row])


@njit(cache=True)
def _crc_column(frames: Any, messages: Any, row: int, out: Any) -> None:
    for k in range(len(frames)):
        out[k] = crc_holds(frames[k], messages[row])


def crc_of_frames_holds(frames: FrameArray, message: str) -> NDArray[np.bool_]:
    """Return whether the end-to-end CRC of each frame of a message holds."""
    out = np.zeros(len(frames), dtype=np.bool_)
    codec = load()
    _crc_column(np.ascontiguousarray(frames), codec.messages, codec.message_index(message), out)
    return out


@functools.cache
def signals_of(message: str) -> tuple[SignalOfMessage, ...]:
    """Return the signals of a message, in the order of the DBC."""
    codec = load()
    described = codec.database.get_message_by_name(message)
    return tuple(
        SignalOfMessage(
            message,
            signal.name,
            signal.unit or "",
            signal.comment or "",
            codec.choices(message, signal.name),
            float(signal.scale),
            float(signal.scale) * 2.0**signal.length,
            float(signal.scale).is_integer() and float(signal.offset).is_integer(),
            codec.signal_index(message, signal.name),
        )
        for signal in described.signals
    )


def message_names() -> list[str]:
    """Return the names of all messages, in the order of their identifiers."""
    messages = sorted(load().database.messages, key=lambda message: message.frame_id)
    return [message.name for message in messages]


def name_of_identifier(identifier: int) -> str | None:
    """Return the message of an identifier; None of one that is not in the contract."""
    return _names_by_identifier().get(identifier)


@functools.cache
def _names_by_identifier() -> dict[int, str]:
    return {message.frame_id: message.name for message in load().database.messages}


def _all_signals() -> dict[str, SignalOfMessage]:
    return {s.full_name: s for name in message_names() for s in signals_of(name)}


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return a hint at the end of an error: the nearest known words, or nothing."""
    known = list(known)
    near = difflib.get_close_matches(word, known, 3, cutoff=0.5)
    if not near:
        lowered = {name.lower(): name for name in known}
        near = [lowered[n] for n in difflib.get_close_matches(word.lower(), lowered, 3, 0.5)]
    return f"; did you mean {' or '.join(near)}?" if near else ""


def find_signals(words: Sequence[str]) -> list[SignalOfMessage]:
    """Return the signals that words name.

    A word is `MESSAGE.signal`, a signal's name where only one message has it, or a pattern with
    `*`, `?` or `[…]` of either, which finds the protection's signals only where it names them.

    Raises
    ------
    RecordError
        When a word names nothing, or could mean several signals; with what it may have meant.
    """
    found: dict[str, SignalOfMessage] = {}
    for word in words:
        for signal in _matches(word):
            found.setdefault(signal.full_name, signal)
    return list(found.values())


def _matches(word: str) -> list[SignalOfMessage]:
    known = _all_signals()
    if word in known:
        return [known[word]]
    if any(letter in word for letter in "*?["):
        matching = [
            signal
            for name, signal in known.items()
            if fnmatchcase(name if "." in word else signal.name, word)
            and (signal.name not in PROTECTION or word.endswith(signal.name))
        ]
    else:
        matching = [signal for signal in known.values() if signal.name == word]
        if len(matching) > 1:
            names = [signal.full_name for signal in matching]
            shown = ", ".join(names[:4]) + (", …" if len(names) > 4 else "")
            raise RecordError(f"signal {word}: of {len(names)} messages: {shown}; or *.{word}")
    if matching:
        return matching
    short = {signal.name for signal in known.values()}
    hint = did_you_mean(word, known if "." in word else short | set(known))
    raise RecordError(f"signal {word}: the DBC has none{hint}")
