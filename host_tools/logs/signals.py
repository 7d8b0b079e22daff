"""Signals of the DBC by name: units, columns of values, suggestions for misspelt names."""

from __future__ import annotations

import difflib
import functools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats, Integers, Records, Words
from rrins.dbc.codec import SignalLayout, load, to_physical, unpack
from rrins.dbc.e2e import MessageLayout, crc_holds
from rrins.dbc.frame import Frame, FrameArray
from rrins.host_tools.recording.errors import RecordError

Numbers = Floats | Integers
"""Values of a signal; integers if all of its values are."""

PROTECTION = ("crc", "alive_counter")
"""Protection signals of every message."""

_SUFFIXES = {
    "deg": "deg",
    "deg/s": "dps",
    "deg/h": "dph",
    "Hz": "hz",
    "rad": "rad",
    "m/s": "mps",
    "m": "m",
    "s": "s",
    "ms": "ms",
    "us": "us",
    "%": "percent",
    "ppm": "ppm",
}
"""Name suffix for each unit of the DBC; see docs/conventions.md."""


@dataclass(frozen=True)
class SignalOfMessage:
    """A signal of a message, and how to extract it from frames.

    Attributes
    ----------
    message, name : str
    """

    message: str
    name: str
    unit: str  #: as written in the DBC; empty if it has none
    comment: str
    choices: Mapping[int, str]  #: names of its values; empty for a number
    scale: float
    span: float  #: full range of its field
    is_whole: bool  #: whether its values are integers
    row: int  #: row in `Codec.signals`.
    valid_row: int | None = None  #: of the signal without which this one means nothing

    @property
    def full_name(self) -> str:
        """Return `MESSAGE.signal`."""
        return f"{self.message}.{self.name}"

    @property
    def name_without_unit(self) -> str:
        """The name without the suffix of its unit."""
        suffix = _suffix(self.unit)
        return self.name.removesuffix(f"_{suffix}") if suffix else self.name

    @property
    def column(self) -> str:
        """Return the name with the unit as its suffix."""
        suffix = _suffix(self.unit)
        has_one = not suffix or self.name.endswith(f"_{suffix}")
        return self.name if has_one else f"{self.name}_{suffix}"

    def raw(self, words: Words) -> Integers:
        """Return the raw integers in payload words."""
        out = np.zeros(len(words), dtype=np.int64)
        _unpack_column(words, load().signals, self.row, out)
        return out

    def is_in(self, frames: FrameArray) -> NDArray[np.bool_]:
        """Return whether each frame is long enough to have the signal."""
        layout = load().signals[self.row]
        if layout["big_endian"]:  # of protected messages only, which have one length
            return np.ones(len(frames), dtype=np.bool_)
        return np.asarray(8 * frames["length"].astype(int) >= layout["shift"] + layout["length"])

    def values(self, words: Words) -> Numbers:
        """Return the values in payload words, integers as int64, others as float64.

        NaN where the message says that the value means nothing.
        """
        if self.is_whole and self.scale == 1:
            return self.raw(words)
        out = np.zeros(len(words), dtype=np.float64)
        _decode_column(words, load().signals, self.row, out)
        if self.valid_row is not None:
            valid = np.zeros(len(words), dtype=np.int64)
            _unpack_column(words, load().signals, self.valid_row, valid)
            out[valid == 0] = np.nan
        return out.astype(np.int64) if self.is_whole else out

    def apart(self, ours: Words, theirs: Words) -> Numbers:
        """Return the difference of the values in payload words; angles the shorter way round."""
        one, other = self.values(ours), self.values(theirs)
        difference = np.where(np.isnan(one) & np.isnan(other), 0.0, np.abs(one - other))
        if self.unit == "deg" and self.span % 360 == 0:
            return np.minimum(difference, self.span - difference)
        return difference

    def text(self, word: int) -> str:
        """Return the value in a payload word as readable text, to its resolution."""
        words = np.array([word], dtype=np.uint64)
        raw = int(self.raw(words)[0])
        if raw in self.choices:
            return f"{self.choices[raw]} ({raw})"
        value = self.values(words)[0]
        unit = f" {self.unit}" if self.unit else ""
        if self.is_whole:
            return f"{value}{unit}"
        if math.isnan(value):
            return "means nothing"
        digits = max(0, -math.floor(math.log10(self.scale)))
        return f"{value:.{digits}f}{unit}"


def _suffix(unit: str) -> str:
    known = _SUFFIXES.get(unit)
    if known is not None:
        return known
    words = unit.replace("/", "_per_").replace("°", "deg").replace("µ", "u")
    return "".join(letter if letter.isalnum() or letter == "_" else "" for letter in words)


@compiled
def _unpack_column(words: Words, signals: Records[SignalLayout], row: int, out: Integers) -> None:
    for k in range(len(words)):
        out[k] = unpack(words[k], signals[row])


@compiled
def _decode_column(words: Words, signals: Records[SignalLayout], row: int, out: Floats) -> None:
    for k in range(len(words)):
        out[k] = to_physical(unpack(words[k], signals[row]), signals[row])


@compiled
def _crc_column(
    frames: FrameArray, messages: Records[MessageLayout], row: int, out: NDArray[np.bool_]
) -> None:
    for k in range(len(frames)):
        out[k] = crc_holds(frames[k], messages[row])


def crc_of_frames_holds(frames: FrameArray, message: str) -> NDArray[np.bool_]:
    """Return whether the end-to-end CRC of each frame of a message is correct."""
    out = np.zeros(len(frames), dtype=np.bool_)
    codec = load()
    _crc_column(Frame.contiguous(frames), codec.messages, codec.message_index(message), out)
    return out


def has_its_length(frames: FrameArray, message: str) -> NDArray[np.bool_]:
    """Return whether each frame has its message's length.

    Packets of ISO-TP and XCP, which have no protection, are as long as their contents.
    """
    codec = load()
    if not codec.is_protected(message):
        return np.ones(len(frames), dtype=np.bool_)
    return np.asarray(frames["length"] == codec.database.get_message_by_name(message).length)


@functools.cache
def signals_of(message: str) -> tuple[SignalOfMessage, ...]:
    """Return the signals of a message in DBC order."""
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
            _row_of(message, codec.valid_if(message, signal.name)),
        )
        for signal in described.signals
    )


def _row_of(message: str, signal: str | None) -> int | None:
    return None if signal is None else load().signal_index(message, signal)


def message_names() -> list[str]:
    """Return the names of all messages in order of identifier."""
    messages = sorted(load().database.messages, key=lambda message: message.frame_id)
    return [message.name for message in messages]


def name_of_identifier(identifier: int) -> str | None:
    """Return the message name of an identifier; None if it is not in the DBC."""
    return _names_by_identifier().get(identifier)


@functools.cache
def _names_by_identifier() -> dict[int, str]:
    return {message.frame_id: message.name for message in load().database.messages}


def _all_signals() -> dict[str, SignalOfMessage]:
    return {s.full_name: s for name in message_names() for s in signals_of(name)}


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return a hint to append to an error message: the closest known words, or nothing."""
    known = list(known)
    near = difflib.get_close_matches(word, known, 3, cutoff=0.5)
    if not near:
        lowered = {name.lower(): name for name in known}
        near = [lowered[n] for n in difflib.get_close_matches(word.lower(), lowered, 3, 0.5)]
    return f"; did you mean {' or '.join(near)}?" if near else ""


def _names(signal: SignalOfMessage, is_full: bool) -> tuple[str, str]:
    """Return a signal's name in the DBC and the one with its unit, behind its message if wanted."""
    before = f"{signal.message}." if is_full else ""
    return f"{before}{signal.name}", f"{before}{signal.column}"


def find_signals(words: Sequence[str]) -> list[SignalOfMessage]:
    """Return the signals that words select.

    A word is `MESSAGE.signal`, a signal name that only one message has, or a pattern of either
    with `*`, `?` or `[…]`. A pattern matches protection signals only if it names them.

    Raises
    ------
    RecordError
        If a word matches nothing or is ambiguous; the message suggests alternatives.
    """
    found: dict[str, SignalOfMessage] = {}
    for word in words:
        for signal in _matches(word):
            found.setdefault(signal.full_name, signal)
    return list(found.values())


def _matches(word: str) -> list[SignalOfMessage]:
    known = _all_signals()
    by_column = {f"{one.message}.{one.column}": one for one in known.values()}
    if word in known or word in by_column:
        return [known.get(word) or by_column[word]]
    if any(letter in word for letter in "*?["):
        matching = [
            signal
            for signal in known.values()
            if any(fnmatchcase(one, word) for one in _names(signal, "." in word))
            and (signal.name not in PROTECTION or word.endswith(signal.name))
        ]
    else:
        matching = [signal for signal in known.values() if word in (signal.name, signal.column)]
        if len(matching) > 1:
            names = [signal.full_name for signal in matching]
            shown = ", ".join(names[:4]) + (", …" if len(names) > 4 else "")
            raise RecordError(
                f"signal {word} is in {len(names)} messages: name one of {shown}, or *.{word}"
            )
    if matching:
        return matching
    short = {signal.name for signal in known.values()}
    hint = did_you_mean(word, known if "." in word else short | set(known))
    raise RecordError(f"signal {word}: not in the DBC{hint}")
