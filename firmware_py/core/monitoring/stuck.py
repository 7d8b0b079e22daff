"""Finds sensors that repeat the same increment for long.

Where the data sheet promises noise, and the sensor has shown it, so many equal counts in a row are
as rare as a false alarm may be, and suffice. Without noise, the others have to vary meanwhile:

Whether a sensor repeats itself is seen in what it sends. The increment expected of it by the others
is the fused vector along its input axis. A sensor is stuck if this has changed by more than
quantisation explains while its increment stayed constant, and at least two others have moved with
it: a vector cannot change along a single axis of four, but a fault or the noise of one sensor can
look so. Nor does it tell anything where the others have moved by far more: they turn about the
sensor's axis, and it is constant rightly. In both cases the comparison begins anew.
The fused vector depends on the set of sensors: epochs that lack one do not count, and when one
drops out for longer, or returns, all tests restart.
Three sensors are always consistent: there a sensor is stuck that repeats a nonzero increment while
another changes by several counts from epoch to epoch.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.records.diagnostic_records import Repetition
from rrins.firmware_py.core.records.memory import Fusion

_VARIED_COUNTS = 4.0
_MOVED_COUNTS = 1.5
_MOVED_SHARE = 0.05
"""Of the largest movement among the others: by less, a sensor does not move with it."""
_MOTION_SHARE = 0.01
"""Of the same: by less, what is expected of a sensor changes in a turn about its axis."""
_CHANGED_COUNTS = 8.0
_REDUNDANT_FROM = 4
_WITNESSES = 2
_MEAN_EPOCHS = 64.0
_PATIENCE_EPOCHS = 10  # of lost frames in a row


@compiled
def follow(repetition: Repetition, count: int, measured: Floats, usable: int) -> None:
    """Note what usable sensors send, before anything is made of it."""
    repetition.lacking = repetition.lacking + 1 if usable != repetition.compared else 0
    if repetition.lacking > 0:
        lost = usable & repetition.compared == usable
        if lost and repetition.lacking <= _PATIENCE_EPOCHS:
            return
        repetition.lacking = 0
        repetition.unchanged[:] = 0
        repetition.varied = 0
        repetition.compared = usable
    repetition.largest_change = 0.0
    repetition.repeats = False
    for k in range(count):
        if usable >> k & 1 == 0:
            continue
        change = abs(measured[k] - repetition.last[k])
        repetition.last[k] = measured[k]
        if change != 0.0:
            repetition.largest_change = max(repetition.largest_change, change)
            usual = min(change, 2.0 * repetition.promised[k])  # a start or a jump is not noise
            repetition.changes[k] += (usual - repetition.changes[k]) / _MEAN_EPOCHS
            repetition.unchanged[k] = 0
        else:
            repetition.unchanged[k] += 1
            repetition.repeats = True


@compiled
def _expected(fusion: Fusion, vector_s: Floats, sensor: int) -> float:
    """Return the component of the fused vector along a sensor's input axis."""
    return (
        fusion.H[sensor, 0] * vector_s[0]
        + fusion.H[sensor, 1] * vector_s[1]
        + fusion.H[sensor, 2] * vector_s[2]
    )


@compiled
def _refer(repetition: Repetition, expected: float, sensor: int, count: int) -> None:
    """Begin to compare what is expected of a sensor, and what the others send, with now."""
    repetition.expected[sensor] = expected
    for k in range(count):
        repetition.reference[sensor, k] = repetition.last[k]


@compiled
def _is_of_motion(repetition: Repetition, difference: float, sensor: int, count: int) -> bool:
    """Return whether a vector's motion changes what is expected of a sensor by `difference`."""
    largest = 0.0
    for k in range(count):
        if repetition.compared >> k & 1:
            largest = max(largest, abs(repetition.last[k] - repetition.reference[sensor, k]))
    least = max(_MOVED_COUNTS * repetition.resolution, _MOVED_SHARE * largest)
    witnesses = 0
    for k in range(count):
        moved = abs(repetition.last[k] - repetition.reference[sensor, k])
        if repetition.compared >> k & 1 and moved > least:
            witnesses += 1
    return difference > _MOTION_SHARE * largest and witnesses >= _WITNESSES


@compiled
def judge(repetition: Repetition, fusion: Fusion, vector_s: Floats, epochs: int) -> None:
    """Set `stuck`: the sensors that repeat themselves wrongly, one bit each.

    `epochs` is how long a sensor must repeat itself, an even number.
    """
    if repetition.lacking > 0:
        return
    usable = repetition.compared
    if not repetition.repeats:
        repetition.varied &= ~usable
        repetition.stuck = 0
        return
    standing = used = noiseless = 0
    for k in range(fusion.count):
        if usable >> k & 1 == 0:
            continue
        used += 1
        unchanged = repetition.unchanged[k]
        noisy = repetition.changes[k] >= repetition.promised[k]
        if noisy and 0 < repetition.enough[k] <= unchanged:
            noiseless |= 1 << k
        if unchanged == 0:
            repetition.varied &= ~(1 << k)
        elif 2 * unchanged >= epochs:
            expected = _expected(fusion, vector_s, k)
            difference = abs(expected - repetition.expected[k])
            if 2 * unchanged == epochs:
                _refer(repetition, expected, k, fusion.count)
            elif difference > _VARIED_COUNTS * repetition.resolution:
                if _is_of_motion(repetition, difference, k, fusion.count):
                    repetition.varied |= 1 << k
                else:
                    _refer(repetition, expected, k, fusion.count)
            if unchanged >= epochs:
                standing |= 1 << k
    repetition.stuck = noiseless
    if standing == 0:
        return
    if used >= _REDUNDANT_FROM:
        repetition.stuck |= standing & repetition.varied
    elif repetition.largest_change > _CHANGED_COUNTS * repetition.resolution:
        for k in range(fusion.count):
            if standing >> k & 1 and repetition.last[k] != 0.0:
                repetition.stuck |= 1 << k
