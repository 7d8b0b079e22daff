"""The loop's own clock, disciplined by SYNC; integer nanoseconds throughout.

A second-order loop (proportional and integral) on the arrival of SYNC: it learns the period in
its own clock's nanoseconds, so the loop continues at the right rate when SYNC fails.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.records.memory import Clock

_PHASE_SHIFT = 4  # proportional gain 1/16
_RATE_SHIFT = 10  # integral gain 1/1024
_LIMIT_SHIFT = 4  # limits the correction by one arrival to that of 1/16 period
_JUMP_AFTER = 8  # SYNCs
_LOST_AFTER = 10  # epochs without SYNC

_PPB = 1_000_000_000


@compiled
def own_clock_ns(nominal_ns: int, error_ppm: float) -> int:
    """Return the reading, after `nominal_ns`, of a clock that runs fast by `error_ppm`."""
    error_ppb = round(error_ppm * 1000)
    whole, rest = nominal_ns // _PPB, nominal_ns % _PPB
    return nominal_ns + whole * error_ppb + rest * error_ppb // _PPB


@compiled
def power_on(clock: Clock, period_ns: int) -> None:
    """Start with the nominal period, unsynchronised."""
    clock.synchronised = False
    clock.sync_lost = False
    clock.period_q16 = period_ns << 16


@compiled
def synchronise(clock: Clock, epochs_late: int) -> None:
    """Discipline the clock by a SYNC that arrived at `clock.sync_arrival_ns`.

    `epochs_late` is the number of epochs by which the SYNC's epoch precedes the current one;
    negative when the loop has fallen behind. A late arrival says more about the bus than about the
    clock: its correction is limited, and an arrival more than half a period off corrects nothing,
    until so many follow in a row that the phase itself must have changed.
    """
    clock.sync_missed = 0
    clock.sync_lost = False
    period_ns = clock.period_q16 >> 16
    error_ns = clock.sync_arrival_ns - (clock.next_sync_ns - epochs_late * period_ns)
    if not clock.synchronised:
        clock.next_sync_ns = clock.sync_arrival_ns
        clock.fraction_q16 = 0
        clock.synchronised = True
        clock.outliers = 0
    elif abs(error_ns) > period_ns // 2:
        clock.outliers += 1
        if clock.outliers == _JUMP_AFTER:
            clock.next_sync_ns += error_ns
            clock.jumps += 1
            clock.outliers = 0
    else:
        limit_ns = period_ns >> _LIMIT_SHIFT
        error_ns = min(limit_ns, max(-limit_ns, error_ns))
        clock.next_sync_ns += error_ns >> _PHASE_SHIFT
        clock.period_q16 += (error_ns << 16) >> _RATE_SHIFT
        clock.outliers = 0


@compiled
def advance(clock: Clock) -> None:
    """Advance to the next epoch: predict when its SYNC will arrive."""
    clock.fraction_q16 += clock.period_q16
    clock.next_sync_ns += clock.fraction_q16 >> 16
    clock.fraction_q16 &= 0xFFFF
    if not clock.sync_seen:
        clock.sync_missed += 1
        clock.sync_lost = clock.sync_missed >= _LOST_AFTER


@compiled
def error_ppm(clock: Clock, period_ns: int) -> float:
    """Return the estimated rate error of the own clock, ppm; positive if it runs fast."""
    return (clock.period_q16 / (period_ns * 65536.0) - 1.0) * 1e6
