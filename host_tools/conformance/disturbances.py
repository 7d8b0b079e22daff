"""Disturbances of the runs that a program has to answer as our own firmware does."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final

from rrins.host_tools.conformance import stimuli as s
from rrins.host_tools.conformance.stimuli import Stimulus
from rrins.host_tools.conformance.trial import Stimuli

_SENSORS: Final = tuple(f"SENSOR_{number}" for number in range(1, 5))
_AXES: Final = ("AXIS_INNER_STATUS", "AXIS_OUTER_STATUS")
RECEIVED: Final = ("SYNC", "MODE_COMMAND", *_SENSORS, "ALTIMETER", *_AXES)
"""Messages that every navigation computer receives, with four sensor groups and an altimeter."""

_VALUE: Final = {
    "SYNC": ("epoch", 3),
    "MODE_COMMAND": ("mode_request", 1),
    "ALTIMETER": ("height", 77_000),
    **dict.fromkeys(_SENSORS, ("gyro_dtheta", 12_345)),
    **dict.fromkeys(_AXES, ("encoder_angle_deg", 400_000)),
}
"""A signal of each message, and a raw value that it does not have."""


_LONG_S: Final = 1e6
_AXIS_S: Final = 0.03
"""An axis that is lost for longer while it accelerates looks like an encoder that jumps."""


def _motion(begin_s: float = 1.8) -> Stimulus:
    """Return motion that makes every lost or wrong increment matter."""
    return Stimulus(begin_s, _LONG_S, s.shake(0.01, 0.01))


def _each(begin_s: float, every_s: float, for_s: float, what: str, make: Any) -> Iterator[Stimulus]:
    """Yield a change of each message, one after the other."""
    for number, name in enumerate(RECEIVED):
        shorter_s = min(for_s, _AXIS_S) if name in _AXES else for_s
        yield Stimulus(begin_s + number * every_s, shorter_s, make(name), f"{name} {what}")


def _variants(
    for_s: float, change: Callable[[str, int], s.Change], values: Iterable[int], what: str
) -> Stimuli:
    """Return a change of each message, with one value after the other."""
    found = [_motion()]
    for number, value in enumerate(values):
        found += _each(
            2.0 + 2.5 * number,
            0.25,
            for_s,
            what.format(value),
            lambda name, value=value: change(name, value),
        )
    return found


# ---- frames in: every message


def crc() -> Stimuli:
    """Return each message with a wrong bit, in the CRC and elsewhere."""
    bits = (0x1000, 0x01, 1 << 30, 1 << 63)
    return _variants(0.15, s.corrupt, bits, "with bits {:#x} inverted")


def length() -> Stimuli:
    """Return each message with fewer bytes."""
    return _variants(0.15, s.shorten, (7, 0, 3), "with {} bytes")


def counter() -> Stimuli:
    """Return each message with another counter."""
    return _variants(0.1, s.count_on, (1, 14, 7), "with a counter {} too high")


def repetition() -> Stimuli:
    """Return twice, and a request whose counter stands still."""
    stuck = s.keep_counter("MODE_COMMAND", 3)
    return [
        _motion(),
        *_each(2.0, 0.25, 0.2, "twice", s.repeat),
        Stimulus(5.0, 1.5, stuck, "MODE_COMMAND with counter 3"),
        Stimulus(5.5, 1.0, s.set_raw("MODE_COMMAND", "mode_request", 1), "STANDBY requested"),
    ]


def contradiction() -> Stimuli:
    """Return each message twice, with two contents."""
    found = [_motion()]
    for is_first, begin_s in ((True, 2.0), (False, 4.5)):
        for number, name in enumerate((*_SENSORS, *_AXES, "ALTIMETER", "SYNC")):
            change = s.contradict(name, *_VALUE[name], is_first)
            words = f"{name} twice, with two contents"
            found.append(Stimulus(begin_s + number * 0.25, 0.1, change, words))
    for number, name in enumerate((*_AXES, *_AXES)):
        change = s.contradict(name, "state", 4, number < 2)
        words = f"{name} twice, one in FAULT"
        found.append(Stimulus(7.0 + number * 0.25, 0.01, change, words))
    return found


def gap() -> Stimuli:
    """Return each message lost for a while."""
    found = [_motion()]
    for for_s, begin_s in ((0.005, 2.0), (0.035, 4.5), (0.1, 7.0)):
        found += _each(begin_s, 0.25, for_s, "lost", s.drop)
    return found


def late() -> Stimuli:
    """Return each message late."""
    return _variants(0.1, s.late, (1, 2, 9), "late by {} epochs")


def strange() -> Stimuli:
    """Return frames that are not for it."""
    sync = s.identifier("SYNC")
    return [
        _motion(),
        Stimulus(2.0, 0.5, s.insert(s.Sent(0x00F, 8, 0)), "0x00F, which the contract has not"),
        Stimulus(2.5, 0.5, s.insert(s.Sent(0x80000000 | sync, 8, 0)), "an extended frame"),
        Stimulus(3.0, 0.5, s.insert(s.Sent(0x40000000 | 0x041, 8, 0)), "a remote frame"),
        Stimulus(3.5, 0.5, s.insert(s.Sent(0x044, 8, 1)), "SENSOR_5, which is not fitted, CRC"),
        Stimulus(4.0, 0.5, s.insert(s.Sent(0x7FF, 0, 0)), "0x7FF"),
        Stimulus(4.5, 0.5, s.insert(s.Sent(0x120, 8, 0)), "NAV_LATITUDE, its own"),
        Stimulus(5.0, 0.5, s.insert(*[s.Sent(0x555, 8, 7)] * 300), "300 frames more"),
    ]


def at_random(seed: int) -> Stimuli:
    """Return chance."""
    return [_motion(), Stimulus(0.1, _LONG_S, s.at_random(seed, 0.02), "chance")]


def saturated_counters() -> Stimuli:
    """Return more faults than the counters hold."""
    request = s.protected("MODE_COMMAND", s.with_value("MODE_COMMAND", "mode_request", 0, 4), 3)
    return [
        _motion(),
        Stimulus(2.0, 0.3, s.insert(*[s.Sent(0x041, 8, 0x55)] * 30), "30 wrong CRCs an epoch"),
        *(Stimulus(2.5, 7.0, s.drop(name), "SENSOR_1 to SENSOR_4 lost") for name in _SENSORS),
        Stimulus(2.5, 0.3, s.insert(*[request] * 30), "a request repeated 30 times an epoch"),
    ]


# ---- SYNC


def without_sync() -> Stimuli:
    """Return losses of SYNC."""
    return [
        _motion(),
        *(
            Stimulus(2.0 + k, epochs * 0.005, s.drop("SYNC"), f"SYNC lost for {epochs} epochs")
            for k, epochs in enumerate((1, 9, 10, 11, 20, 41))
        ),
        *(  # the status of every 20th epoch tells of the ninth, tenth and eleventh without
            Stimulus(
                8.0 + 0.5 * k - before * 0.005, 0.1, s.drop("SYNC"), f"{before + 1} epochs lost"
            )
            for k, before in enumerate((8, 9, 10))
        ),
        Stimulus(9.5, 3.0, s.drop("SYNC"), "SYNC lost"),
    ]


def stray_sync() -> Stimuli:
    """Return a second SYNC of another epoch, now and then."""
    found = [_motion()]
    for number, ahead in enumerate((1, 2, 100, 200, 201, 5000, -1, -3, -200, -201, -5000)):
        for is_first in (False, True):
            begin_s = 2.0 + 0.3 * number + (4.0 if is_first else 0.0)
            change = s.stray_sync(ahead, is_first)
            found.append(Stimulus(begin_s, 0.005, change, f"SYNC of epoch {ahead:+d} in addition"))
    return found


def restarted_sync() -> Stimuli:
    """Return jumps of the epoch count: those within 200 epochs are not followed."""
    jumps = (100, -150, 200, -200, 201, -201, 1001, -1650)
    return [
        _motion(),
        *(
            Stimulus(2.0 + 0.8 * k, 0.4, s.shift_epochs(by), f"an epoch count {by:+d} off")
            for k, by in enumerate(jumps)
        ),
        *(
            Stimulus(9.0 + at_s, 0.005, s.shift_epochs(by), f"an epoch count {by:+d} off, once")
            for at_s, by in ((0.0, 1001), (0.2, -999), (0.205, -998), (0.4, 1001), (0.405, 1003))
        ),
        *(
            Stimulus(9.6 + 0.1 * is_first, 0.005, s.stray_sync(5000, is_first), "a SYNC twice")
            for is_first in (False, False, True, True)
        ),
        Stimulus(9.9, 0.01, s.drop("SYNC"), "no SYNC"),
        Stimulus(9.905, 0.005, s.stray_sync(700, True), "a SYNC 700 ahead alone"),
    ]


def wrapping() -> Stimuli:
    """Return epochs that wrap."""
    return [_motion(), Stimulus(0.0, _LONG_S, s.shift_epochs((1 << 24) - 586), "SYNC wraps")]


def wrapped() -> Stimuli:
    """Return epochs that have wrapped."""
    by = 4 * (1 << 24) + 1_000_003
    return [_motion(), Stimulus(0.0, _LONG_S, s.shift_epochs(by), "SYNC has wrapped")]


# ---- sensors


def _status(raw: int, *sensors: int) -> Iterator[s.Change]:
    for number in sensors:
        yield s.set_raw(f"SENSOR_{number}", "status", raw)


def flagged() -> Stimuli:
    """Return each flag of each sensor, alone and in two of four."""
    found = [_motion()]
    begin_s = 2.0
    for raw in (1, 2, 3, 4, 6, 8, 9, 12):
        for sensors in ((1,), (2,), (3,), (4,), (1, 3), (2, 4)):
            words = f"status {raw} of {', '.join(f'SENSOR_{k}' for k in sensors)}"
            found += [Stimulus(begin_s, 0.045, one, words) for one in _status(raw, *sensors)]
            begin_s += 0.1
    return found


def _gap_of(epochs: int, raw: int | None, begin_s: float) -> Iterator[Stimulus]:
    """Yield a gap in the data of all sensors: their frames lost, or with a status."""
    for number, name in enumerate(_SENSORS, 1):
        change = s.drop(name) if raw is None else next(_status(raw, number))
        how = "lost" if raw is None else f"with status {raw}"
        yield Stimulus(begin_s, epochs * 0.005, change, f"all sensors {how} for {epochs} epochs")


def bridged(*gaps: tuple[int, int | None]) -> Stimuli:
    """Return gaps, each of so many epochs and with a status."""
    found = [_motion()]
    for number, (epochs, raw) in enumerate(gaps):
        found += _gap_of(epochs, raw, 2.5 + 0.4 * number)
    return found


def self_test() -> Stimuli:
    """Return unsound epochs of every kind, at 50 Hz.

    Twelve sound epochs come first, then ten between two: whatever is not counted, or takes back
    another number than ten, ends the self-test in another epoch.
    """
    kinds = [
        (s.drop("SYNC"), "SYNC lost"),
        *((s.drop(name), f"{name} lost") for name in (*_AXES, *_SENSORS)),
        *((s.set_raw(name, "state", 4), f"{name} reports FAULT") for name in _AXES),
        *((change, "a sensor saturated or absent") for raw in (1, 2, 4, 8)
          for change in _status(raw, 1, 4)),
        (s.contradict("AXIS_OUTER_STATUS", "encoder_angle_deg", 9, True), "two contents"),
    ]  # fmt: skip
    return [Stimulus(0.26 + 0.22 * k, 0.02, *kind) for k, kind in enumerate(kinds)]


def bad_at_first(for_s: float) -> Stimuli:
    """Return a sensor that is absent at first."""
    return [Stimulus(0.0, for_s, s.set_raw("SENSOR_1", "status", 4), "gyro 1 absent")]


# ---- modes


def none_between() -> Stimuli:
    """Return requests that are none, or unknown."""
    request = "mode_request"
    return [
        _motion(),
        Stimulus(4.0, 0.5, s.set_raw("MODE_COMMAND", request, 0), "NONE requested"),
        Stimulus(5.0, 0.5, s.set_raw("MODE_COMMAND", request, 3), "NAVIGATE_STRAPDOWN requested"),
        Stimulus(6.0, 0.5, s.set_raw("MODE_COMMAND", request, 9), "request 9"),
        Stimulus(7.0, 0.5, s.set_raw("MODE_COMMAND", request, 3), "NAVIGATE_STRAPDOWN requested"),
        Stimulus(7.5, 0.5, s.set_raw("MODE_COMMAND", request, 0), "NONE requested"),
        Stimulus(8.0, 0.5, s.set_raw("MODE_COMMAND", request, 3), "NAVIGATE_STRAPDOWN requested"),
    ]


def fault_then(begin_s: float, *more: Stimulus) -> Stimuli:
    """Return the loss of all sensors, and what else there is."""
    return [_motion(), *_gap_of(40, None, begin_s), *more]


def shutdown(at_s: float, *before: Stimulus) -> Stimuli:
    """Return SHUTDOWN at a time."""
    down = s.protected("MODE_COMMAND", s.with_value("MODE_COMMAND", "mode_request", 0, 5), 13)
    return [*before, Stimulus(at_s, 1.0, s.insert(down, is_first=False), "SHUTDOWN requested")]


# ---- axes


def axis_faults() -> Stimuli:
    """Return faults of the axes while they turn, rest and home."""
    found = [_motion()]
    for number, name in enumerate((*_AXES, *_AXES)):
        at_s = 6.0 + 9.0 * number
        found.append(Stimulus(at_s, 0.04, s.set_raw(name, "state", 4), f"{name} reports FAULT"))
    return found


def silent_axes() -> Stimuli:
    """Return a silence that is permitted and one that is not, of the axis that rests."""
    found = []
    for name, at_s in zip(reversed(_AXES), (3.0, 11.0), strict=True):
        found.append(Stimulus(at_s, 0.4, s.drop(name), f"{name} silent for 0.4 s"))
        found.append(Stimulus(at_s + 2.0, 0.42, s.drop(name), f"{name} silent for 0.42 s"))
    return found


def not_standing() -> Stimuli:
    """Return an axis that does not hold when it is to be tried again."""
    return [
        Stimulus(6.0, 0.04, s.set_raw("AXIS_INNER_STATUS", "state", 4), "inner axis in FAULT"),
        Stimulus(6.04, 2.0, s.set_raw("AXIS_INNER_STATUS", "state", 2), "inner axis MOVING"),
        Stimulus(14.0, 0.04, s.set_raw("AXIS_OUTER_STATUS", "state", 4), "outer axis in FAULT"),
        Stimulus(14.9, 0.3, s.drop("AXIS_INNER_STATUS"), "inner axis silent"),
    ]


def offset(inner_deg: float, outer_deg: float) -> Stimuli:
    """Return encoders that begin elsewhere."""
    step = 23040 / 2**32
    found = [_motion()]
    for name, offset_deg in zip(_AXES, (inner_deg, outer_deg), strict=True):
        change = s.add_raw(name, "encoder_angle_deg", round(offset_deg / step))
        found.append(Stimulus(0.0, _LONG_S, change))
    return found


# ---- navigation


def pushed(*sensors: tuple[int, float]) -> Stimuli:
    """Return accelerations without end, in m/s an epoch."""
    return [
        Stimulus(1.6, _LONG_S, s.add_raw(f"SENSOR_{k}", "accelerometer_dv", round(dv / 1.25e-7)))
        for k, dv in sensors
    ]


def scaled(share: float) -> Stimuli:
    """Return a specific force that is wrong by a share, in a level tetrahedron at 50 Hz."""
    step = 9.8 * 0.02 / 1.25e-7
    return [
        Stimulus(0.0, _LONG_S, s.add_raw(f"SENSOR_{k}", "accelerometer_dv", round(part * step)))
        for k, part in enumerate((-share, share / 3, share / 3, share / 3), 1)
    ]


def without_north() -> Stimuli:
    """Return gyros that do not feel the Earth turn about north, in the same tetrahedron."""
    raw = round(7.292115e-5 * math.cos(math.radians(40.3554)) * 0.02 / 4e-9 * math.sqrt(2 / 3))
    return [
        Stimulus(0.0, _LONG_S, s.add_raw(f"SENSOR_{k}", "gyro_dtheta", by))
        for k, by in ((3, -raw), (4, raw))
    ]


def turning(inner: int, outer: int) -> Stimuli:
    """Return axes that report a rate, raw, until the alignment."""
    found = []
    for name, raw in zip(_AXES, (inner, outer), strict=True):
        change = s.set_raw(name, "encoder_rate_dps", raw)
        found.append(Stimulus(0.0, 11.0, change, f"{name} turns at {raw * 0.002:g} deg/s"))
    return found


def silent_altimeter() -> Stimuli:
    """Return losses of the altimeter."""
    return [
        _motion(),
        Stimulus(4.0, 0.6, s.drop("ALTIMETER"), "ALTIMETER lost for 0.6 s"),
        Stimulus(6.0, 3.0, s.drop("ALTIMETER"), "ALTIMETER lost for 3 s"),
        Stimulus(12.0, 2.0, s.corrupt("ALTIMETER", 1 << 20), "ALTIMETER with a wrong CRC"),
        Stimulus(15.0, 0.5, s.set_raw("ALTIMETER", "height", -2_000_000), "ALTIMETER at -2000 m"),
    ]


def shaken() -> Stimuli:
    """Return motion about all axes."""
    return [Stimulus(1.6, _LONG_S, s.shake(0.04, 0.02))]


def in_motion() -> Stimuli:
    """Return a little of it, from power-on."""
    return [_motion(0.0)]


def one_absent() -> Stimuli:
    """Return each sensor absent for a while, under motion."""
    found = list(shaken())
    for number in range(1, 5):
        for raw, at_s in ((4, 2.0), (8, 4.0), (12, 3.0)):
            words = f"status {raw} of SENSOR_{number}"
            change = next(_status(raw, number))
            found.append(Stimulus(at_s + 0.2 * number, 0.05, change, words))
    return found


def gaps() -> Stimuli:
    """Return gaps that are bridged."""
    return bridged((1, None), (2, 4), (7, 8), (20, 12), (20, 4), (3, 8))


def no_sync_at_first() -> Stimuli:
    """Return the hardware's frames without SYNC for a second."""
    return [
        Stimulus(0.0, 1.0, s.drop("SYNC"), "no SYNC yet"),
        *(Stimulus(0.0, 0.6, s.drop(name), f"no {name} yet") for name in _SENSORS),
    ]


def fault_shutdown() -> Stimuli:
    """Return SHUTDOWN in FAULT."""
    return fault_then(4.0, *shutdown(5.0))
