"""What is kept of the frames on a bus, as one record of fixed size, and the step that fills it.

Of each identifier the last frame, counts and the sequence of its alive counter are kept; of each
signal of the DBC the last value, the smallest and largest, and histories. A frame costs some
200 ns, so that a bus in lockstep at many times real time can be followed.

Times are bus time, integer nanoseconds: what the bus gives with its frames.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dbc.codec import SIGNAL, Codec, unpack
from dbc.e2e import COUNTER_MODULUS, MESSAGE, counter_of, crc_holds
from dbc.frame import EFF_FLAG, ERR_FLAG, RTR_FLAG
from host_tools.bus.bits import INTERMISSION_BITS, frame_bits
from host_tools.bus.load import occupy

ENTRIES = 512
"""Identifiers that are told apart; frames of any others are only counted."""

LEVELS = 3
"""Histories of each signal, from short and fine to long and coarse."""

BIN_NS = (500_000_000, 5_000_000_000, 50_000_000_000)
"""Bus time that a bin of each history covers."""

BINS = 120
"""Bins of a history: 1 min, 10 min and 100 min."""

LOAD_WINDOW_NS = 1_000_000_000
"""Bus time over which the largest load is looked for."""

EMPTY_LOW = 2**63 - 1
"""Low end of a range of raw values that holds none."""

EMPTY_HIGH = -(2**63)
"""High end of a range of raw values that holds none."""

_INDEX = 2048  # of the hash table, a power of two well above ENTRIES
_NONE = -1
_BACK_NS = 1_000_000_000  # a bus clock that goes back, or ahead, by more has been set anew
_AHEAD_NS = 3_600_000_000_000
_PERIOD_SHARE = 1 / 16  # of a new interval in the period that is learned
_SAME_EPOCH = 0.5  # of a period: a frame that came within it of SYNC belongs to SYNC's epoch

ENTRY = np.dtype(
    (
        np.record,
        [
            ("message", MESSAGE),
            ("is_known", "u1"),  # in the DBC: rows of the DBC come first and in its order
            ("follows_epoch", "u1"),  # its counter is the epoch, as that of SYNC is
            ("length", "u1"),
            ("can_id", "<u4"),  # with the flags of SocketCAN
            ("data", "<u8"),  # of the last frame
            ("is_sound", "u1"),  # whether the last frame had the right length and CRC
            ("first_signal", "<i8"),
            ("signals", "<i8"),
            ("count", "<i8"),
            ("sound_count", "<i8"),
            ("crc_errors", "<i8"),
            ("lost", "<i8"),
            ("out_of_turn", "<i8"),  # twice, late, or of another epoch than the last SYNC
            ("first_ns", "<i8"),
            ("last_ns", "<i8"),
            ("counter", "<i8"),  # the alive counter that the next one is compared with, -1 for none
            ("counter_ns", "<i8"),
            ("period_ns", "<f8"),  # learned, 0 at first
            ("bin", "<i8", (LEVELS,)),  # number of the newest bin
        ],
    )
)
"""An identifier."""

SIGNAL_TALLY = np.dtype(
    (
        np.record,
        [
            ("signal", SIGNAL),
            ("raw", "<i8"),  # of the last frame that was sound
            ("low", "<i8"),
            ("high", "<i8"),
            ("history_low", "<i8", (LEVELS, BINS)),
            ("history_high", "<i8", (LEVELS, BINS)),
        ],
    )
)
"""A signal: raw values, as they are in the frame."""

LOAD = np.dtype(
    (
        np.record,
        [
            ("busy_ns", "<i8"),
            ("window_ns", "<i8"),
            ("window_end_ns", "<i8"),
            ("window_busy_ns", "<i8"),
            ("last_window_busy_ns", "<i8"),
            ("worst_window_busy_ns", "<i8"),
        ],
    )
)
"""How busy the wire is; see `host_tools.bus.load`."""


def tally_of(codec: Codec, bitrate: int) -> NDArray[Any]:
    """Return an empty tally for the messages of a codec: an array of one record.

    Parameters
    ----------
    codec : Codec
    bitrate : int
        Of the wire, bit/s, for its load.
    """
    tally_dtype = np.dtype(
        (
            np.record,
            [
                ("is_started", "u1"),
                ("first_ns", "<i8"),
                ("now_ns", "<i8"),
                ("bit_ns", "<f8"),
                ("frames", "<i8"),
                ("error_frames", "<i8"),
                ("unlisted", "<i8"),  # frames of identifiers that found no room
                ("clock_jumps", "<i8"),
                ("count", "<i8"),  # entries in use
                ("sync", "<i8"),  # entry of SYNC
                ("load", LOAD),
                ("index", "<i2", (_INDEX,)),
                ("entries", ENTRY, (ENTRIES,)),
                ("signals", SIGNAL_TALLY, (len(codec.signals),)),
            ],
        )
    )
    tallies = np.zeros(1, dtype=tally_dtype)
    tally = tallies[0]
    tally["bit_ns"] = 1e9 / bitrate
    tally["index"] = _NONE
    tally["entries"]["counter"] = _NONE
    tally["entries"]["bin"] = _NONE
    tally["signals"]["signal"] = codec.signals
    tally["sync"] = codec.message_index("SYNC")
    _list_messages(tally, codec)
    forget(tallies)
    return tallies


def _list_messages(tally: Any, codec: Codec) -> None:
    """Enter all messages of the DBC, in its order."""
    sync = codec.database.get_message_by_name("SYNC")
    for row, message in enumerate(codec.database.messages):
        place = _find(tally, np.uint32(message.frame_id))
        entry = tally["entries"][place]
        entry["message"] = codec.messages[row]
        entry["is_known"] = 1
        # What others send in an epoch may rightly come after the SYNC of the next one.
        is_of_sync = message.senders == sync.senders and message.cycle_time == sync.cycle_time
        entry["follows_epoch"] = is_of_sync
        entry["signals"] = len(message.signals)
        if message.signals:
            entry["first_signal"] = codec.signal_index(message.name, message.signals[0].name)


def forget(tallies: NDArray[Any]) -> None:
    """Set counts, extremes and histories to nothing; last frames stay."""
    tally = tallies[0]
    for name in ("frames", "error_frames", "unlisted", "clock_jumps"):
        tally[name] = 0
    tally["first_ns"] = tally["now_ns"]
    tally["load"]["busy_ns"] = tally["load"]["worst_window_busy_ns"] = 0
    for name in ("count", "sound_count", "crc_errors", "lost", "out_of_turn"):
        tally["entries"][name] = 0
    for name in ("low", "history_low"):
        tally["signals"][name] = EMPTY_LOW
    for name in ("high", "history_high"):
        tally["signals"][name] = EMPTY_HIGH


@njit(cache=True)
def _find(tally: Any, can_id: Any) -> Any:
    """Return the entry of an identifier, a new one if need be; -1 when there is no room."""
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


@njit(cache=True)
def _set_clock(tally: Any, time_ns: Any) -> None:
    """Go on from a time that has nothing to do with those before."""
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
        for level in range(LEVELS):
            entry.bin[level] = _NONE
    for row in range(len(tally.signals)):
        signal = tally.signals[row]
        for level in range(LEVELS):
            for place in range(BINS):
                signal.history_low[level, place] = EMPTY_LOW
                signal.history_high[level, place] = EMPTY_HIGH


@njit(cache=True)
def _follow_counter(tally: Any, entry: Any, time_ns: Any) -> None:
    """Tell by the alive counter how many frames are missing since the one before.

    The counter tells it modulo 15; of the steps that fit, the one is taken that is nearest to the
    time gone by in periods. A step of 0 or less is a frame that came twice or late.
    """
    counter = counter_of(entry["data"])
    if entry.counter == _NONE:
        entry.counter = counter
        entry.counter_ns = time_ns
        return
    gone_ns = time_ns - entry.counter_ns
    expected = gone_ns / entry.period_ns if entry.period_ns > 0 else 1.0
    step = (counter - entry.counter) % COUNTER_MODULUS
    step += COUNTER_MODULUS * np.int64(np.rint((expected - step) / COUNTER_MODULUS))
    if step < 1 or counter >= COUNTER_MODULUS:
        entry.out_of_turn += 1
        return
    entry.lost += step - 1
    entry.counter = counter
    entry.counter_ns = time_ns
    if gone_ns > 0:
        period_ns = gone_ns / step
        if entry.period_ns > 0:
            period_ns = entry.period_ns + (period_ns - entry.period_ns) * _PERIOD_SHARE
        entry.period_ns = period_ns
    sync = tally.entries[tally.sync]
    if entry.follows_epoch and sync.counter != _NONE and sync.period_ns > 0:
        is_of_epoch = abs(time_ns - sync.counter_ns) < _SAME_EPOCH * sync.period_ns
        if step == 1 and is_of_epoch and counter != sync.counter:
            entry.out_of_turn += 1


@njit(cache=True)
def _clear_bins(tally: Any, entry: Any, level: int, newest: Any) -> None:
    """Make the bins up to `newest` ready."""
    first = max(entry.bin[level] + 1, newest - BINS + 1)
    for number in range(first, newest + 1):
        for row in range(entry.first_signal, entry.first_signal + entry.signals):
            tally.signals[row].history_low[level, number % BINS] = EMPTY_LOW
            tally.signals[row].history_high[level, number % BINS] = EMPTY_HIGH
    entry.bin[level] = newest


@njit(cache=True)
def _take_values(tally: Any, entry: Any, time_ns: Any) -> None:
    for level in range(LEVELS):
        number = time_ns // BIN_NS[level]
        if number > entry.bin[level]:
            _clear_bins(tally, entry, level, number)
    for row in range(entry.first_signal, entry.first_signal + entry.signals):
        signal = tally.signals[row]
        raw = unpack(entry["data"], signal.signal)
        signal.raw = raw
        signal.low = min(signal.low, raw)
        signal.high = max(signal.high, raw)
        for level in range(LEVELS):
            place = entry.bin[level] % BINS
            signal.history_low[level, place] = min(signal.history_low[level, place], raw)
            signal.history_high[level, place] = max(signal.history_high[level, place], raw)


@njit(cache=True)
def _take_frame(tally: Any, frame: Any, time_ns: Any) -> None:
    tally.frames += 1
    if frame.can_id & ERR_FLAG:
        tally.error_frames += 1
        return
    length = min(frame.length, np.uint8(8))
    bits = frame_bits(frame.can_id, length, frame["data"]) + INTERMISSION_BITS
    occupy(tally.load, time_ns, time_ns + np.int64(bits * tally.bit_ns))
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
    if not crc_holds(frame, entry.message):
        entry.is_sound = 0
        entry.crc_errors += 1
        return
    entry.sound_count += 1
    _follow_counter(tally, entry, time_ns)
    _take_values(tally, entry, time_ns)


@njit(cache=True)
def take(tallies: Any, frames: Any, count: int, time_ns: int) -> None:
    """Take the first `count` frames of an array, all of one bus time.

    Parameters
    ----------
    tallies : ndarray
        Of one record, see `tally_of`.
    frames : FrameArray
    count : int
    time_ns : int
        A time that lies more than a second before the newest one, or an hour after it, sets the
        clock anew: ages and histories begin again.
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
        _take_frame(tally, frames[k], time_ns)


STANDARD_IDENTIFIER = 0x7FF
"""Mask of an identifier of 11 bits."""

EXTENDED_IDENTIFIER = 0x1FFF_FFFF
"""Mask of an identifier of 29 bits."""


def identifier_of(can_id: int) -> tuple[int, bool, bool]:
    """Return identifier, whether it is extended, and whether the frame is a remote frame."""
    is_extended = bool(can_id & EFF_FLAG)
    mask = EXTENDED_IDENTIFIER if is_extended else STANDARD_IDENTIFIER
    return can_id & mask, is_extended, bool(can_id & RTR_FLAG)
