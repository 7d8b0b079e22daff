"""Finds sensors that give the same increment for long while the others vary.

What the others would have the sensor measure is the fused vector along its input axis. When that
has changed by more than counting explains since the sensor's increment stands, the sensor is stuck.
Fewer sensors have another fused vector: when one falls out or comes back, all begin anew. Three
sensors alone fit each other always: there one is stuck that gives the same increment, not
zero, while another changes by several counts from epoch to epoch.
"""

from __future__ import annotations

from typing import Any

from numba import njit

_VARIED_COUNTS = 4.0
_CHANGED_COUNTS = 8.0
_REDUNDANT_FROM = 4


@njit(cache=True)
def _expected(fusion: Any, vector_s: Any, sensor: int) -> float:
    """Return what the fused vector is along a sensor's input axis."""
    return (
        fusion.H[sensor, 0] * vector_s[0]
        + fusion.H[sensor, 1] * vector_s[1]
        + fusion.H[sensor, 2] * vector_s[2]
    )


@njit(cache=True)
def _look(
    fusion: Any,
    measured: Any,
    vector_s: Any,
    usable: int,
    last: Any,
    unchanged: Any,
    expected: Any,
    varied: int,
    compared: int,
    resolution: float,
    epochs: int,
) -> tuple[int, int]:
    """Return the stuck sensors and those whose expected increment has varied, a bit each."""
    if usable != compared:
        unchanged[:] = 0
        varied = 0
    largest_change = 0.0
    standing = 0
    used = 0
    for k in range(fusion.count):
        if usable >> k & 1 == 0:
            continue
        used += 1
        change = abs(measured[k] - last[k])
        if change != 0.0:
            largest_change = max(largest_change, change)
            last[k] = measured[k]
            unchanged[k] = 0
            varied &= ~(1 << k)
            continue
        unchanged[k] += 1
        if 2 * unchanged[k] == epochs:
            expected[k] = _expected(fusion, vector_s, k)
        elif 2 * unchanged[k] > epochs:
            difference = _expected(fusion, vector_s, k) - expected[k]
            if abs(difference) > _VARIED_COUNTS * resolution:
                varied |= 1 << k
            if unchanged[k] >= epochs:
                standing |= 1 << k
    if standing == 0:
        return 0, varied
    if used >= _REDUNDANT_FROM:
        return standing & varied, varied
    if largest_change <= _CHANGED_COUNTS * resolution:
        return 0, varied
    for k in range(fusion.count):
        if last[k] == 0.0:
            standing &= ~(1 << k)
    return standing, varied


@njit(cache=True)
def gyros(fusion: Any, measured: Any, dtheta_s: Any, usable: int, monitor: Any) -> int:
    """Return the stuck gyros, a bit each, of those that are usable."""
    stuck, monitor.gyro_varied = _look(
        fusion,
        measured,
        dtheta_s,
        usable,
        monitor.gyro_last,
        monitor.gyro_unchanged,
        monitor.gyro_expected,
        monitor.gyro_varied,
        monitor.gyro_compared,
        monitor.gyro_resolution,
        monitor.stuck_epochs,
    )
    monitor.gyro_compared = usable
    return stuck


@njit(cache=True)
def accelerometers(fusion: Any, measured: Any, dv_s: Any, usable: int, monitor: Any) -> int:
    """Return the stuck accelerometers, a bit each, of those that are usable."""
    stuck, monitor.accelerometer_varied = _look(
        fusion,
        measured,
        dv_s,
        usable,
        monitor.accelerometer_last,
        monitor.accelerometer_unchanged,
        monitor.accelerometer_expected,
        monitor.accelerometer_varied,
        monitor.accelerometer_compared,
        monitor.accelerometer_resolution,
        monitor.stuck_epochs,
    )
    monitor.accelerometer_compared = usable
    return stuck
