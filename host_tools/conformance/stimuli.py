"""Changes of the hardware's frames on their way to a navigation computer, the same in every run."""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from rrins.dbc.codec import load
from rrins.dbc.e2e import COUNTER_MODULUS, crc8

SENSORS = 16


class Sent(NamedTuple):
    """A classic frame."""

    can_id: int
    length: int
    data: int  #: payload, the first byte lowest


Earlier = Sequence[list[Sent]]
"""The hardware's frames of the epochs before, the last one last."""

Change = Callable[[list[Sent], int, Earlier], list[Sent]]
"""Returns the frames of an epoch, given those of the hardware, its number and `Earlier`."""


class Stimulus(NamedTuple):
    """A change for some time."""

    begin_s: float
    for_s: float
    change: Change
    name: str = ""  #: in words, for the report


class Tap:
    """Applies the stimuli of a run to the frames of each epoch."""

    def __init__(self, stimuli: Sequence[Stimulus], rate_hz: int) -> None:
        self._spans = [
            (round(one.begin_s * rate_hz), round((one.begin_s + one.for_s) * rate_hz), one)
            for one in stimuli
        ]
        self._earlier: deque[list[Sent]] = deque(maxlen=SENSORS)

    def apply(self, frames: list[Sent], epoch: int) -> list[Sent]:
        """Return the frames of an epoch as they arrive."""
        changed = frames
        for begin, end, stimulus in self._spans:
            if begin <= epoch < end:
                changed = stimulus.change(changed, epoch, self._earlier)
        self._earlier.append(frames)
        return changed

    def words(self, epoch: int) -> str:
        """Return what is or was last done to the frames."""
        names = [
            f"{stimulus.name} since {begin}"
            for begin, _, stimulus in self._spans
            if begin <= epoch and stimulus.name
        ]
        return names[-1] if names else ""


class _Bits(NamedTuple):
    """Where a signal is in the payload."""

    shift: int
    mask: int  #: of the raw value
    sign: int  #: the bit of the sign; 0: unsigned


@cache
def _bits(message: str, signal: str) -> _Bits:
    row = load().signals[load().signal_index(message, signal)]
    length = int(row.length)
    return _Bits(int(row.shift), (1 << length) - 1, 1 << length - 1 if row.signed else 0)


@cache
def _crc_table() -> list[int]:
    return [int(crc8(np.uint64(byte << 8), 2, 0)) for byte in range(256)]


@cache
def _protection(message: str) -> tuple[int, int]:
    """Return a message's identifier and the CRC of its data ID."""
    row = load().messages[load().message_index(message)]
    return int(row.can_id), int(crc8(np.uint64(0), 1, row.data_id))


def identifier(message: str) -> int:
    """Return the identifier of a message."""
    return load().frame_id(message)


def protected(message: str, data: int, counter: int) -> Sent:
    """Return a payload as a frame with counter and CRC."""
    can_id, crc = _protection(message)
    data = data & ~0xFFF | counter % COUNTER_MODULUS << 8
    table = _crc_table()
    for byte in data.to_bytes(8, "little")[1:]:
        crc = table[crc ^ byte]
    return Sent(can_id, 8, data | crc)


def value_of(message: str, signal: str, data: int) -> int:
    """Return the raw value of a signal in a payload."""
    bits = _bits(message, signal)
    raw = data >> bits.shift & bits.mask
    return raw - (bits.sign << 1) if raw & bits.sign else raw


def with_value(message: str, signal: str, data: int, raw: int) -> int:
    """Return a payload with the raw value of a signal."""
    bits = _bits(message, signal)
    return data & ~(bits.mask << bits.shift) | (raw & bits.mask) << bits.shift


def counter(data: int) -> int:
    """Return the counter of a payload."""
    return data >> 8 & 0xF


def _each(message: str, become: Callable[[Sent], list[Sent]]) -> Change:
    can_id = identifier(message)

    def change(frames: list[Sent], _epoch: int, _earlier: Earlier) -> list[Sent]:
        return [new for one in frames for new in (become(one) if one.can_id == can_id else [one])]

    return change


def drop(message: str) -> Change:
    """Lose a message."""
    return _each(message, lambda _: [])


def corrupt(message: str, bits: int) -> Change:
    """Invert bits of the payload; the CRC stays."""
    return _each(message, lambda one: [one._replace(data=one.data ^ bits)])


def shorten(message: str, length: int = 7) -> Change:
    """Send fewer bytes."""
    return _each(message, lambda one: [Sent(one.can_id, length, one.data & (1 << 8 * length) - 1)])


def count_on(message: str, by: int) -> Change:
    """Send another counter, with the right CRC."""
    return _each(message, lambda one: [protected(message, one.data, counter(one.data) + by)])


def keep_counter(message: str, value: int) -> Change:
    """Always send the same counter, with the right CRC."""
    return _each(message, lambda one: [protected(message, one.data, value)])


def repeat(message: str) -> Change:
    """Send every frame twice."""
    return _each(message, lambda one: [one, one])


def set_raw(message: str, signal: str, raw: int) -> Change:
    """Send another value of a signal, with the right CRC."""
    return _each(message, lambda one: [_edited(message, signal, one, raw)])


def add_raw(message: str, signal: str, raw: int) -> Change:
    """Add to a signal, which wraps, with the right CRC."""
    return _each(
        message,
        lambda one: [_edited(message, signal, one, value_of(message, signal, one.data) + raw)],
    )


def _edited(message: str, signal: str, one: Sent, raw: int) -> Sent:
    return protected(message, with_value(message, signal, one.data, raw), counter(one.data))


def contradict(message: str, signal: str, raw: int, is_first: bool) -> Change:
    """Send a second frame of the epoch that says something else."""

    def both(one: Sent) -> list[Sent]:
        other = _edited(message, signal, one, raw)
        return [other, one] if is_first else [one, other]

    return _each(message, both)


def late(message: str, epochs: int) -> Change:
    """Send what was due some epochs before in place of the message of the epoch."""
    can_id = identifier(message)

    def change(frames: list[Sent], _epoch: int, earlier: Earlier) -> list[Sent]:
        rest = [one for one in frames if one.can_id != can_id]
        old = earlier[-epochs] if len(earlier) >= epochs else []
        return rest + [one for one in old if one.can_id == can_id]

    return change


def insert(*extra: Sent, is_first: bool = True) -> Change:
    """Send more frames in every epoch."""

    def change(frames: list[Sent], _epoch: int, _earlier: Earlier) -> list[Sent]:
        return [*extra, *frames] if is_first else [*frames, *extra]

    return change


def stray_sync(ahead: int, is_first: bool, counter_by: int = 0) -> Change:
    """Send another SYNC of an epoch that is so many ahead."""

    def change(frames: list[Sent], epoch: int, _earlier: Earlier) -> list[Sent]:
        number = (epoch + ahead) % (1 << 24)
        data = with_value("SYNC", "epoch", 0, number)
        stray = protected("SYNC", data, (epoch + ahead + counter_by) % COUNTER_MODULUS)
        return [stray, *frames] if is_first else [*frames, stray]

    return change


def shift_epochs(by: int) -> Change:
    """Let the hardware count so many epochs more, in SYNC and in all counters of epochs."""
    every = {identifier(name): name for name in of_every_epoch()}

    def change(frames: list[Sent], epoch: int, _earlier: Earlier) -> list[Sent]:
        shifted = []
        for one in frames:
            name = every.get(one.can_id)
            if name is None:
                shifted.append(one)
                continue
            data = one.data
            if name == "SYNC":
                data = with_value(name, "epoch", data, (epoch + by) % (1 << 24))
            shifted.append(protected(name, data, (epoch + by) % COUNTER_MODULUS))
        return shifted

    return change


def of_every_epoch() -> tuple[str, ...]:
    """Return the messages of the hardware whose counter is the epoch."""
    sensors = tuple(f"SENSOR_{number}" for number in range(1, SENSORS + 1))
    return ("SYNC", *sensors, "ALTIMETER", "AXIS_INNER_STATUS", "AXIS_OUTER_STATUS")


def shake(gyro: float, accelerometer: float) -> Change:
    """Add motion to the increments of all sensors: sines of other frequency, share of the range."""
    names = {identifier(f"SENSOR_{number}"): number for number in range(1, SENSORS + 1)}
    full = 1 << 23

    def shaken(one: Sent, name: str, phase: float) -> Sent:
        data = one.data
        parts = (("gyro_dtheta", gyro, 0.0), ("accelerometer_dv", accelerometer, 1.0))
        for signal, share, offset in parts:
            more = round(share * full * math.sin(phase + offset))
            data = with_value(name, signal, data, value_of(name, signal, data) + more)
        return protected(name, data, counter(data))

    def change(frames: list[Sent], epoch: int, _earlier: Earlier) -> list[Sent]:
        return [
            shaken(one, f"SENSOR_{number}", epoch * (0.31 + 0.07 * number))
            if (number := names.get(one.can_id))
            else one
            for one in frames
        ]

    return change


def at_random(seed: int, share: float) -> Change:
    """Do something to a share of all frames: lose, corrupt, shorten, repeat, contradict, delay."""
    draw = random.Random(seed)
    names = {identifier(name): name for name in (*of_every_epoch(), "MODE_COMMAND")}

    def spoilt(one: Sent, name: str, earlier: Earlier) -> list[Sent]:
        how = draw.randrange(6)
        if how == 0:
            return []
        if how == 1:
            return [one._replace(data=one.data ^ 1 << draw.randrange(64))]
        if how == 2:
            return [Sent(one.can_id, draw.randrange(8), 0)]
        if how == 3:
            return [one, one]
        if how == 4 and name.startswith("SENSOR_"):
            raw = value_of(name, "gyro_dtheta", one.data) ^ 0x155
            return [one, _edited(name, "gyro_dtheta", one, raw)]
        back = draw.randrange(1, 9)
        old = earlier[-back] if len(earlier) >= back else []
        return [each for each in old if each.can_id == one.can_id]

    def change(frames: list[Sent], _epoch: int, earlier: Earlier) -> list[Sent]:
        arrived: list[Sent] = []
        for one in frames:
            name = names.get(one.can_id)
            is_hit = name is not None and draw.random() < share
            arrived += spoilt(one, name or "", earlier) if is_hit else [one]
        return arrived

    return change
