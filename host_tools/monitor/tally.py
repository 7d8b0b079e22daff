"""Statistics of the frames on a bus, as one record of fixed size, and the step that updates it.

The record holds the last frame, counts and alive counter of each identifier, and the last,
smallest and largest value and histories of each signal in the DBC. A frame takes about 200 ns, so
that the monitor keeps up with a bus in lockstep at many times real time.

Times are bus time, the timestamps of the bus in integer nanoseconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, cast

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.compiled.record import F8, I8, U1, U4, U8, Integers, Record, Records, Shorts, Words
from rrins.dbc.codec import Codec, SignalLayout, unpack
from rrins.dbc.direct import NOTHING, TIME_WORD, Direct, take
from rrins.dbc.e2e import COUNTER_MODULUS, MessageLayout, counter_of, crc_holds
from rrins.dbc.frame import EFF_FLAG, ERR_FLAG, RTR_FLAG, Frame, FrameArray
from rrins.host_tools.wire.bits import INTERMISSION_BITS, frame_bits
from rrins.host_tools.wire.load import occupy

if TYPE_CHECKING:
    from cantools.database import Message

ENTRIES = 512
"""Most identifiers that are tracked; frames of further ones are only counted."""

SIGNALS = 512
"""Most signals that the DBC can have."""

LEVELS = 3
"""Number of histories of each signal, from short and fine to long and coarse."""

BIN_NS = (500_000_000, 5_000_000_000, 50_000_000_000)
"""Bus time that a bin of each history covers."""

BINS = 120
"""Bins of a history: 1 min, 10 min and 100 min."""

LOAD_WINDOW_NS = 1_000_000_000
"""Bus time over which the peak load is taken."""

EMPTY_LOW = 2**63 - 1
"""Low end of an empty range of raw values."""

EMPTY_HIGH = -(2**63)
"""High end of an empty range of raw values."""

DIAGNOSTIC = 8192
"""Frames of diagnosis and XCP that are kept for who puts their messages together."""

MOST_AT_ONCE = 64
"""Batches that are processed before others may look at the tally."""

_INDEX = 2048  # of the hash table, a power of two well above ENTRIES
_NONE = -1
_BACK_NS = 1_000_000_000  # a bus clock that jumps back, or ahead, by more has been reset
_AHEAD_NS = 3_600_000_000_000
_PERIOD_SHARE = 1 / 16  # weight of a new interval in the learned period
_SAME_EPOCH = 0.5  # periods: a frame this close to SYNC belongs to the epoch of SYNC
_SETTLED = 8  # equal intervals in a row that are taken for the new one, though longer

_NOT_FOLLOWED, _BY_TIME, _BY_ORDER, _BY_EPOCH = range(4)  # how losses show in a counter


class TallyEntry(Record):
    """An identifier."""

    message: MessageLayout
    is_known: U1  #: in the DBC; its messages come first, in its order
    counting: U1  #: how losses show in its counter
    follows_sync: U1  #: its counter is that of the last SYNC
    is_diagnostic: U1
    length: U1
    can_id: U4  #: with the flags of SocketCAN
    data: U8  #: of the last frame
    is_sound: U1  #: whether the last frame had the right length and CRC
    first_signal: I8
    signals: I8
    count: I8
    sound_count: I8
    crc_errors: I8
    lost: I8
    out_of_turn: I8  #: repeated, late, or of another epoch than the last SYNC
    first_ns: I8
    last_ns: I8
    counter: I8  #: last alive counter, -1 for none
    counter_ns: I8
    period_ns: F8  #: learned, 0 at first
    interval: I8  #: epochs between two frames whose counter is the epoch: learned, 0 at first
    last_step: I8
    equal_steps: I8
    bin: Annotated[Integers, LEVELS]  #: number of the newest bin


class SignalTally(Record):
    """A signal: raw values as in the frame."""

    signal: SignalLayout
    raw: I8  #: of the last sound frame
    low: I8
    high: I8
    changed_ns: I8  #: time of the frame since which it has this value


class SignalHistory(Record):
    """Smallest and largest raw value of a signal in each bin."""

    low: Annotated[Integers, (LEVELS, BINS)]
    high: Annotated[Integers, (LEVELS, BINS)]


class LoadWindow(Record):
    """How busy the wire is; see `rrins.host_tools.wire.load`."""

    busy_ns: I8
    window_ns: I8
    window_end_ns: I8
    window_busy_ns: I8
    last_window_busy_ns: I8
    worst_window_busy_ns: I8


class DiagnosticFrame(Record):
    """A frame of diagnosis."""

    can_id: U4
    length: U1
    data: U8
    time_ns: I8


class Tally(Record):
    """Statistics of a bus."""

    is_started: U1
    first_ns: I8
    now_ns: I8
    bit_ns: F8
    frames: I8
    error_frames: I8
    unlisted: I8  #: frames of identifiers that did not fit
    clock_jumps: I8
    count: I8  #: entries in use
    sync: I8  #: entry of SYNC
    load: LoadWindow
    diagnostic_frames: I8  #: so far
    diagnostic: Annotated[Records[DiagnosticFrame], DIAGNOSTIC]  #: the last ones, by number
    index: Annotated[Shorts, _INDEX]
    entries: Annotated[Records[TallyEntry], ENTRIES]
    signals: Annotated[Records[SignalTally], SIGNALS]  #: in the order of the codec's
    histories: Annotated[Records[SignalHistory], SIGNALS]  #: last: by far the largest


def _head_of(tallies: np.dtype[np.void]) -> np.dtype[np.void]:
    """Return the type of the fields before the last one, `histories`."""
    fields = [(name, tallies[name]) for name in (tallies.names or ())[:-1]]
    return np.dtype((np.record, fields))


_HEAD = _head_of(Tally.dtype)


def head_of(tallies: Records[Tally]) -> Records[Tally]:
    """Return a copy without the histories, which are most of its bytes."""
    octets = tallies.view(np.uint8)[: _HEAD.itemsize]
    return cast("Records[Tally]", octets.copy().view(_HEAD))


def tally_of(codec: Codec, bitrate: int) -> Records[Tally]:
    """Return an empty tally for the messages of a codec: an array of one record.

    Parameters
    ----------
    codec : Codec
    bitrate : int
        Bit rate of the wire, bit/s, for its load.
    """
    tallies = Tally.zeros()
    tally = tallies[0]
    tally["bit_ns"] = 1e9 / bitrate
    tally["index"] = _NONE
    tally["entries"]["counter"] = _NONE
    tally["entries"]["bin"] = _NONE
    tally["signals"]["signal"][: len(codec.signals)] = codec.signals
    tally["sync"] = codec.message_index("SYNC")
    _list_messages(tally, codec)
    reset_counts(tallies)
    return tallies


def _list_messages(tally: Tally, codec: Codec) -> None:
    """Enter all messages of the DBC, in its order."""
    sync = codec.database.get_message_by_name("SYNC")
    for row, message in enumerate(codec.database.messages):
        place = _find(tally, message.frame_id)
        entry = tally["entries"][place]
        entry["message"] = codec.messages[row]
        entry["is_known"] = 1
        entry["counting"] = _counting(codec, message)
        # Frames of other senders may legitimately arrive after the next SYNC.
        entry["follows_sync"] = codec.counts_epochs(message.name) and (
            message.senders == sync.senders
        )
        entry["is_diagnostic"] = not codec.is_protected(message.name)
        entry["signals"] = len(message.signals)
        if message.signals:
            entry["first_signal"] = codec.signal_index(message.name, message.signals[0].name)


def _counting(codec: Codec, message: Message) -> int:
    """Return how losses show in the counter of a message."""
    if not codec.is_protected(message.name) or "HOST" in message.senders:
        return _NOT_FOLLOWED  # each tool has a counter of its own
    every_epoch = codec.database.get_message_by_name("SYNC").cycle_time
    if codec.counts_epochs(message.name) and message.cycle_time != every_epoch:
        return _BY_EPOCH
    return _BY_TIME if codec.send_type(message.name) == "Cyclic" else _BY_ORDER


def reset_counts(tallies: Records[Tally]) -> None:
    """Reset counts, extremes and histories; keep the last frames."""
    tally = tallies[0]
    for name in ("frames", "error_frames", "unlisted", "clock_jumps"):
        tally[name] = 0
    tally["first_ns"] = tally["now_ns"]
    tally["load"]["busy_ns"] = tally["load"]["worst_window_busy_ns"] = 0
    for name in ("count", "sound_count", "crc_errors", "lost", "out_of_turn"):
        tally["entries"][name] = 0
    for name in ("signals", "histories"):
        tally[name]["low"] = EMPTY_LOW
        tally[name]["high"] = EMPTY_HIGH


@compiled
def _find(tally: Tally, can_id: int) -> np.int64:
    """Return the entry of an identifier, creating it if needed; -1 if there is no room."""
    slot = (np.int64(can_id) * 40503 >> 5) & (_INDEX - 1)
    while tally.index[slot] != _NONE:
        place = np.int64(tally.index[slot])
        if tally.entries[place].can_id == can_id:
            return place
        slot = (slot + 1) & (_INDEX - 1)
    place = np.int64(tally["count"])
    if place == ENTRIES:
        return np.int64(_NONE)
    tally["count"] = place + 1
    tally.index[slot] = place
    tally.entries[place].can_id = can_id
    return place


@compiled
def _set_clock(tally: Tally, time_ns: int) -> None:
    """Restart from a time unrelated to earlier ones."""
    tally.load.window_ns = LOAD_WINDOW_NS
    tally.load.window_end_ns = time_ns + LOAD_WINDOW_NS
    tally.load.window_busy_ns = 0
    tally.now_ns = time_ns
    tally.first_ns = time_ns
    for place in range(tally["count"]):
        entry = tally.entries[place]
        entry.first_ns = time_ns
        entry.last_ns = time_ns
        entry.counter = _NONE
        entry.interval = 0
        for level in range(LEVELS):
            entry.bin[level] = _NONE
    for row in range(len(tally.histories)):
        history = tally.histories[row]
        for level in range(LEVELS):
            for place in range(BINS):
                history.low[level, place] = EMPTY_LOW
                history.high[level, place] = EMPTY_HIGH


@compiled
def _follow_counter(tally: Tally, entry: TallyEntry, time_ns: int) -> None:
    """Determine from the alive counter how many frames are missing since the previous one.

    The counter gives the step modulo 15; the candidate closest to the elapsed time, in periods of
    what is counted, is chosen. A step of 0 or less means a repeated or late frame.
    """
    counter = counter_of(entry["data"])
    if entry.counter == _NONE:
        entry.counter = counter
        entry.counter_ns = time_ns
        return
    sync = tally.entries[tally.sync]
    gone_ns = time_ns - entry.counter_ns
    period_ns = sync.period_ns if entry.counting == _BY_EPOCH else entry.period_ns
    expected = gone_ns / period_ns if period_ns > 0 else 1.0
    step = (counter - entry.counter) % COUNTER_MODULUS
    if entry.counting != _BY_ORDER:
        step += COUNTER_MODULUS * int(np.rint((expected - step) / COUNTER_MODULUS))
    if step < 1 or counter >= COUNTER_MODULUS:
        entry.out_of_turn += 1
        return
    if entry.counting == _BY_EPOCH:
        step = _frames_gone(entry, step) if period_ns > 0 else 1
    entry.lost += step - 1
    entry.counter = counter
    entry.counter_ns = time_ns
    if gone_ns > 0:
        period_ns = gone_ns / step
        if entry.period_ns > 0:
            period_ns = entry.period_ns + (period_ns - entry.period_ns) * _PERIOD_SHARE
        entry.period_ns = period_ns
    if entry.follows_sync and sync.counter != _NONE and sync.period_ns > 0:
        is_of_epoch = abs(time_ns - sync.counter_ns) < _SAME_EPOCH * sync.period_ns
        if step == 1 and is_of_epoch and counter != sync.counter:
            entry.out_of_turn += 1


@compiled
def _frames_gone(entry: TallyEntry, epochs: int) -> int:
    """Return how many frames ago the last one was, from the epochs since; learn the interval."""
    entry.equal_steps = entry.equal_steps + 1 if epochs == entry.last_step else 0
    entry.last_step = epochs
    is_new = entry.interval == 0 or (entry.equal_steps > 0 and epochs < entry.interval)
    if is_new or entry.equal_steps >= _SETTLED:
        entry.interval = epochs
    return max(1, int(np.rint(epochs / entry.interval)))


@compiled
def _clear_bins(tally: Tally, entry: TallyEntry, level: int, newest: int) -> None:
    """Clear the bins up to `newest`."""
    first = max(entry.bin[level] + 1, newest - BINS + 1)
    for number in range(first, newest + 1):
        for row in range(entry.first_signal, entry.first_signal + entry.signals):
            tally.histories[row].low[level, number % BINS] = EMPTY_LOW
            tally.histories[row].high[level, number % BINS] = EMPTY_HIGH
    entry.bin[level] = newest


@compiled
def _update_values(tally: Tally, entry: TallyEntry, time_ns: int) -> None:
    for level in range(LEVELS):
        number = time_ns // BIN_NS[level]
        if number > entry.bin[level]:
            _clear_bins(tally, entry, level, number)
    for row in range(entry.first_signal, entry.first_signal + entry.signals):
        signal = tally.signals[row]
        raw = unpack(entry["data"], signal.signal)
        if raw != signal.raw or signal.changed_ns == 0:
            signal.changed_ns = time_ns
        signal.raw = raw
        signal.low = min(signal.low, raw)
        signal.high = max(signal.high, raw)
        history = tally.histories[row]
        for level in range(LEVELS):
            place = entry.bin[level] % BINS
            history.low[level, place] = min(history.low[level, place], raw)
            history.high[level, place] = max(history.high[level, place], raw)


@compiled
def _keep_diagnostic(tally: Tally, frame: Frame, time_ns: int) -> None:
    kept = tally.diagnostic[tally.diagnostic_frames % DIAGNOSTIC]
    kept.can_id = frame.can_id
    kept.length = frame.length
    kept["data"] = frame["data"]
    kept.time_ns = time_ns
    tally.diagnostic_frames += 1


@compiled
def _count_frame(tally: Tally, frame: Frame, time_ns: int) -> None:
    tally.frames += 1
    if frame.can_id & ERR_FLAG:
        tally.error_frames += 1
        return
    length = frame.length if frame.length < 8 else 8
    bits = frame_bits(frame.can_id, length, frame["data"]) + INTERMISSION_BITS
    occupy(tally.load, time_ns, time_ns + int(bits * tally.bit_ns))
    place = _find(tally, frame.can_id)
    if place == _NONE:
        tally.unlisted += 1
        return
    entry = tally.entries[place]
    if entry["count"] == 0:
        entry.first_ns = time_ns
    entry["count"] += 1
    entry.last_ns = time_ns
    entry.length = length
    entry["data"] = frame["data"]
    entry.is_sound = 1
    if not entry.is_known:
        return
    if entry.is_diagnostic:
        _keep_diagnostic(tally, frame, time_ns)
    if not crc_holds(frame, entry.message):
        entry.is_sound = 0
        entry.crc_errors += 1
        return
    entry.sound_count += 1
    if entry.counting != _NOT_FOLLOWED:
        _follow_counter(tally, entry, time_ns)
    _update_values(tally, entry, time_ns)


@compiled
def count_frames(tallies: Records[Tally], frames: FrameArray, count: int, time_ns: int) -> None:
    """Process the first `count` frames of an array, all with the same bus time.

    Parameters
    ----------
    tallies : ndarray
        Array of one record, see `tally_of`.
    frames : FrameArray
    count : int
    time_ns : int
        A time more than a second before the newest one, or more than an hour after it, resets the
        clock: ages and histories restart.
    """
    tally = tallies[0]
    if not tally.is_started:
        tally.is_started = 1
        _set_clock(tally, time_ns)
    elif not -_BACK_NS <= time_ns - tally.now_ns <= _AHEAD_NS:
        tally.clock_jumps += 1
        _set_clock(tally, time_ns)
    tally.now_ns = max(tally.now_ns, time_ns)
    for k in range(count):
        _count_frame(tally, frames[k], time_ns)


@compiled
def count_timed_frames(tallies: Records[Tally], frames: FrameArray, times_ns: Integers) -> None:
    """Process frames that have a bus time each, in order of time, as those of a recording.

    Parameters
    ----------
    tallies : ndarray
        Array of one record, see `tally_of`.
    frames : FrameArray, shape (n,)
    times_ns : array of int, shape (n,)
    """
    tally = tallies[0]
    for k in range(len(frames)):
        if not tally.is_started:
            tally.is_started = 1
            _set_clock(tally, times_ns[k])
        tally.now_ns = max(tally.now_ns, times_ns[k])
        _count_frame(tally, frames[k], times_ns[k])


@compiled
def count_waiting(
    tallies: Records[Tally], lent: Records[Direct], words: Words, frames: FrameArray
) -> int:
    """Process the batches that wait at a socket, at most `MOST_AT_ONCE`; return how many.

    Parameters
    ----------
    tallies : ndarray
        Array of one record, see `tally_of`.
    lent : ndarray
        Array of one record: the socket.
    words : array, shape (rrins.dbc.direct.WORDS,)
        Holds what is left to Python.
    frames : FrameArray
        Scratch.
    """
    times_ns = words.view(np.int64)
    for batches in range(MOST_AT_ONCE):
        count = take(lent[0], words, frames)
        if count == NOTHING:
            return batches
        count_frames(tallies, frames, count, times_ns[TIME_WORD])
    return MOST_AT_ONCE


STANDARD_IDENTIFIER = 0x7FF
"""Mask of an 11-bit identifier."""

EXTENDED_IDENTIFIER = 0x1FFF_FFFF
"""Mask of a 29-bit identifier."""


def identifier_of(can_id: int) -> tuple[int, bool, bool]:
    """Return the identifier, whether it is extended, and whether it is a remote frame."""
    is_extended = bool(can_id & EFF_FLAG)
    mask = EXTENDED_IDENTIFIER if is_extended else STANDARD_IDENTIFIER
    return can_id & mask, is_extended, bool(can_id & RTR_FLAG)
