"""The state of a bus at one moment: an immutable snapshot.

Rates, ages and histories are in **bus time**, the timestamps of the bus, which are simulated time
in a rehearsal. Rates are taken over at least the last `WINDOW_NS`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from rrins.compiled.record import Integers, Records
from rrins.dbc.codec import Codec
from rrins.host_tools.bus.guard import NOTHING_REFUSED, Refused
from rrins.host_tools.monitor.tally import (
    BIN_NS,
    BINS,
    LEVELS,
    SignalTally,
    Tally,
    TallyEntry,
    identifier_of,
)

WINDOW_NS = 2_500_000_000
"""Shortest bus time over which rates and load are taken, and errors count as recent."""

SILENT_PERIODS = 5.0
"""A message is silent when it has been missing for this many of its periods,"""

SILENT_NS = 250_000_000
"""and for this bus time at least."""

PROTECTION = ("crc", "alive_counter")
"""Signals of the end-to-end protection, which every message but the diagnostic ones has."""


@dataclass(frozen=True)
class Times:
    """Time of a snapshot, and state of the bus."""

    now_ns: int
    """Bus time."""
    quiet_s: float
    """Wall clock time since the last frame of any kind."""
    speed: float | None
    """Bus time per second of wall clock time; None while unknown."""
    ended: str | None
    """Why the bus has ended; None while it is running."""
    gaps: int
    """How often the monitor fell behind, was disconnected and reattached."""
    refused: Refused = NOTHING_REFUSED
    """Frames that the host of an embedded bus has not delivered, as they were a side's."""


@dataclass(frozen=True)
class Mark:
    """An earlier moment that a snapshot is compared with."""

    now_ns: int
    frames: int
    error_frames: int
    busy_ns: int
    entries: Records[TallyEntry]
    raw: Integers


@dataclass(frozen=True)
class MessageState:
    """An identifier seen on the bus.

    Attributes
    ----------
    is_extended, is_remote : bool
    lost, out_of_turn, crc_errors : int
        Since the start: missing frames; frames that were repeated, late or of another epoch; frames
        with a wrong length or CRC.
    recent_lost, recent_out_of_turn, recent_crc_errors : int
        The same, recently.
    """

    name: str | None  #: name in the DBC; None for an identifier or kind of frame that is not in it
    identifier: int
    is_extended: bool
    is_remote: bool
    data: bytes  #: payload of the last frame
    #: whether the last frame had the right length and CRC; values are from the last sound frame
    is_sound: bool
    count: int  #: frames since the start
    #: frames per second of bus time, 0 when silent; None after a single frame
    rate_hz: float | None
    age_s: float  #: bus time since the last frame
    period_s: float | None  #: bus time between two frames, by the alive counter
    lost: int
    out_of_turn: int
    crc_errors: int
    recent_lost: int
    recent_out_of_turn: int
    recent_crc_errors: int
    is_silent: bool  #: whether a regular message has stopped
    send_type: str  #: when it is sent: Cyclic, IfActive or Event; empty for one not in the DBC

    @property
    def errors(self) -> int:
        """All errors since the start."""
        return self.lost + self.out_of_turn + self.crc_errors

    @property
    def has_recent_errors(self) -> bool:
        """Whether there were errors recently."""
        return bool(self.recent_lost + self.recent_out_of_turn + self.recent_crc_errors)

    @property
    def is_sound_or_unknown(self) -> bool:
        """Whether the last frame is sound, or cannot be checked against the DBC."""
        return self.is_sound or self.name is None

    @property
    def hexadecimal(self) -> str:
        """The identifier in hexadecimal: three digits, eight if extended."""
        return f"0x{self.identifier:08X}" if self.is_extended else f"0x{self.identifier:03X}"

    @property
    def label(self) -> str:
        """The name, or a placeholder."""
        return self.name or ("remote frame" if self.is_remote else "unknown")


@dataclass(frozen=True)
class SignalState:
    """A signal of a message, in the unit of the DBC.

    Attributes
    ----------
    name, unit, comment : str
    value, low, high : float or None
        Value of the last sound frame; smallest and largest since the start. None before the first.
    """

    name: str
    unit: str
    comment: str
    decimals: int  #: decimal places that its scale resolves
    value: float | None
    low: float | None
    high: float | None
    text: str | None  #: name of the value in the value table


def decimals_of(scale: float) -> int:
    """Return the decimal places that a scale resolves."""
    return max(0, math.ceil(-math.log10(abs(scale)) - 1e-9))


@dataclass(slots=True)
class _Entry:
    """Part of a `TallyEntry` that a snapshot needs."""

    is_known: int
    can_id: int
    length: int
    data: int
    is_sound: int
    count: int
    crc_errors: int
    lost: int
    out_of_turn: int
    first_ns: int
    last_ns: int
    period_ns: float


_ENTRY = tuple(field.name for field in fields(_Entry))


class BusState:
    """A snapshot.

    Parameters
    ----------
    codec : Codec
    tally : Tally
        A copy.
    mark : Mark
    times : Times

    Attributes
    ----------
    times : Times
    messages : tuple of MessageState
        Messages seen on the bus, in order of arbitration: lowest identifier first.
    """

    def __init__(self, codec: Codec, tally: Tally, mark: Mark, times: Times) -> None:
        self._codec = codec
        self._tally = tally
        self._mark = mark
        self.times = times
        signals = tally["signals"]
        self._raw, self._low, self._high = (signals[name] for name in ("raw", "low", "high"))
        self._scale, self._offset = codec.signals["scale"], codec.signals["offset"]
        self._names = [message.name for message in codec.database.messages]
        entries, before = (
            _rows_of(one, int(tally["count"])) for one in (tally["entries"], mark.entries)
        )
        found = [
            self._message(*one) for one in zip(range(len(entries)), entries, before, strict=True)
        ]
        seen = [message for message in found if message is not None]
        seen.sort(key=lambda m: (m.is_extended, m.identifier, m.is_remote))
        self.messages = tuple(seen)
        self._by_name = {message.name: message for message in seen if message.name is not None}

    # ---- the bus

    @property
    def time_s(self) -> float:
        """Bus time."""
        return self.times.now_ns / 1e9

    @property
    def watched_s(self) -> float:
        """Bus time since the start, or since the last reset of the counts."""
        return (self.times.now_ns - int(self._tally["first_ns"])) / 1e9

    @property
    def frames(self) -> int:
        """Frames since the start."""
        return int(self._tally["frames"])

    @property
    def error_frames(self) -> int:
        """Error frames among them, if the interface reports them."""
        return int(self._tally["error_frames"])

    @property
    def recent_error_frames(self) -> int:
        """Recent error frames."""
        return self.error_frames - self._mark.error_frames

    @property
    def unlisted(self) -> int:
        """Frames of identifiers that did not fit."""
        return int(self._tally["unlisted"])

    @property
    def rate_hz(self) -> float | None:
        """Frames per second of bus time."""
        return self._per_second(self.frames - self._mark.frames)

    @property
    def load(self) -> float | None:
        """Fraction of the recent bus time in which the wire was busy, counted in bits."""
        busy = self._per_second(int(self._tally["load"]["busy_ns"]) - self._mark.busy_ns)
        return None if busy is None else busy / 1e9

    @property
    def peak_load(self) -> float:
        """Largest load over one second of bus time since the start."""
        load = self._tally["load"]
        worst = max(int(load["worst_window_busy_ns"]), int(load["window_busy_ns"]))
        return max(worst / max(1, int(load["window_ns"])), self.load or 0.0)

    def _per_second(self, amount: int) -> float | None:
        gone_ns = self.times.now_ns - self._mark.now_ns
        return amount / gone_ns * 1e9 if gone_ns > 0 else None

    # ---- messages

    def _message(self, place: int, entry: _Entry, before: _Entry) -> MessageState | None:
        if entry.count == 0:
            return None
        identifier, is_extended, is_remote = identifier_of(entry.can_id)
        age_ns = self.times.now_ns - entry.last_ns
        name = self._names[place] if entry.is_known else None
        send_type = self._codec.send_type(name) if name is not None else ""
        is_silent = 0 < SILENT_PERIODS * entry.period_ns < age_ns and age_ns > SILENT_NS
        length = 0 if is_remote else entry.length
        return MessageState(
            name=name,
            identifier=identifier,
            is_extended=is_extended,
            is_remote=is_remote,
            data=entry.data.to_bytes(8, "little")[:length],
            is_sound=bool(entry.is_sound),
            count=entry.count,
            rate_hz=0.0 if is_silent else _rate(entry, before),
            age_s=age_ns / 1e9,
            period_s=entry.period_ns / 1e9 if entry.period_ns > 0 else None,
            lost=entry.lost,
            out_of_turn=entry.out_of_turn,
            crc_errors=entry.crc_errors,
            recent_lost=entry.lost - before.lost,
            recent_out_of_turn=entry.out_of_turn - before.out_of_turn,
            recent_crc_errors=entry.crc_errors - before.crc_errors,
            is_silent=is_silent,
            send_type=send_type,
        )

    def message(self, name: str) -> MessageState | None:
        """Return a message of the DBC; None if it was not seen on the bus."""
        return self._by_name.get(name)

    def has_values(self, name: str) -> bool:
        """Return whether a sound frame of a message of the DBC was on the bus."""
        return name in self._by_name and self.value(name, "alive_counter") is not None

    def description(self, message: MessageState) -> str:
        """Return sender and receivers of a message; the payload length if not in the DBC."""
        if message.name is None:
            return f"{len(message.data)} bytes, not in the DBC"
        described = self._codec.database.get_message_by_name(message.name)
        receivers = sorted(described.receivers)
        return f"{', '.join(described.senders)} to {', '.join(receivers)}"

    # ---- signals

    def signals(self, message: str) -> list[SignalState]:
        """Return the signals of a message of the DBC with their values."""
        described = self._codec.database.get_message_by_name(message)
        return [self.signal(message, signal.name) for signal in described.signals]

    def signal(self, message: str, name: str) -> SignalState:
        """Return a signal of a message of the DBC."""
        row = self._tally["signals"][self._codec.signal_index(message, name)]
        means_nothing = self._means_nothing(message, name)
        described = self._codec.database.get_message_by_name(message).get_signal_by_name(name)
        has_value = row["low"] <= row["high"]
        raw = int(row["raw"])
        value, low, high = (
            (_physical(row, r) for r in (raw, int(row["low"]), int(row["high"])))
            if has_value
            else (None, None, None)
        )
        choice = self._codec.choices(message, name).get(raw) if has_value else None
        return SignalState(
            name=name,
            unit=described.unit or "",
            comment=described.comment or "",
            decimals=decimals_of(float(row["signal"]["scale"])),
            value=None if means_nothing else value,
            low=low,
            high=high,
            text=choice,
        )

    def value(self, message: str, signal: str) -> float | None:
        """Return the value of a signal; None before it was seen on the bus."""
        row = self._codec.signal_index(message, signal)
        if self._low[row] > self._high[row] or self._means_nothing(message, signal):
            return None
        return _scaled(int(self._raw[row]), float(self._scale[row]), float(self._offset[row]))

    def _means_nothing(self, message: str, signal: str) -> bool:
        """Return whether the message says that a value means nothing now."""
        flag = self._codec.valid_if(message, signal)
        return flag is not None and self.value(message, flag) == 0

    def text(self, message: str, signal: str) -> str | None:
        """Return a signal's value by its name in the value table, or as a number."""
        value = self.value(message, signal)
        if value is None:
            return None
        row = self._codec.signal_index(message, signal)
        name = self._codec.choices(message, signal).get(int(self._raw[row]))
        return name or f"{value:.{decimals_of(float(self._scale[row]))}f}"

    def growth(self, message: str, signal: str) -> float:
        """Return how much a signal's value has changed recently."""
        row = self._codec.signal_index(message, signal)
        signals = self._tally["signals"]
        if signals["low"][row] > signals["high"][row] or not self._had_value(message):
            return 0.0
        scale = float(signals["signal"]["scale"][row])
        return (int(signals["raw"][row]) - int(self._mark.raw[row])) * scale

    def _had_value(self, message: str) -> bool:
        return bool(self._mark.entries[self._codec.message_index(message)]["sound_count"])

    def history(self, message: str, signal: str, level: int) -> list[tuple[float, float] | None]:
        """Return the smallest and largest value in each bin of bus time, newest last.

        Parameters
        ----------
        message, signal : str
        level : int
            0 for bins of 0.5 s over 1 min, 1 for 5 s over 10 min, 2 for 50 s over 100 min.

        Returns
        -------
        list
            `BINS` pairs; None for bins without frames.
        """
        assert 0 <= level < LEVELS
        index = self._codec.signal_index(message, signal)
        row, past = self._tally["signals"][index], self._tally["histories"][index]
        newest_kept = int(self._tally["entries"][self._codec.message_index(message)]["bin"][level])
        newest = self.times.now_ns // BIN_NS[level]
        bins: list[tuple[float, float] | None] = []
        for number in range(newest - BINS + 1, newest + 1):
            if not newest_kept - BINS < number <= newest_kept:
                bins.append(None)
                continue
            low = int(past["low"][level, number % BINS])
            high = int(past["high"][level, number % BINS])
            bins.append((_physical(row, low), _physical(row, high)) if low <= high else None)
        return bins


def _physical(signal: SignalTally, raw: int) -> float:
    """Return a value in its unit, without the rounding noise of a scale such as 0.001."""
    layout = signal.signal
    return _scaled(raw, float(layout.scale), float(layout.offset))


def _scaled(raw: int, scale: float, offset: float) -> float:
    return float(f"{raw * scale + offset:.13g}")


def _rows_of(entries: Records[TallyEntry], count: int) -> list[_Entry]:
    """Return the first entries with Python's numbers: numpy takes a record apart but slowly."""
    columns = (entries[name][:count].tolist() for name in _ENTRY)
    return [_Entry(*values) for values in zip(*columns, strict=True)]


def _rate(entry: _Entry, before: _Entry) -> float | None:
    """Return frames per second: number of intervals over the time from first to last frame."""
    intervals = entry.count - before.count
    since_ns = before.last_ns
    if not before.count:
        intervals -= 1
        since_ns = entry.first_ns
        if intervals == 0:
            return None
    if intervals == 0:
        return 0.0
    gone_ns = entry.last_ns - since_ns
    return intervals / gone_ns * 1e9 if gone_ns > 0 else None
