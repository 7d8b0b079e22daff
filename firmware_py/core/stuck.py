"""Finds sensors that repeat the same increment for long while the others vary.

The increment expected by the others is the fused vector along the sensor's input axis. A sensor is
stuck if this has changed by more than quantisation explains while its increment stayed constant.
The fused vector depends on the set of sensors: when one drops out or returns, all tests restart.
Three sensors are always consistent: there a sensor is stuck that repeats a nonzero increment while
another changes by several counts from epoch to epoch.
"""

from __future__ import annotations

from rrins.dbc.compilation import compiled
from rrins.dbc.record import Floats, Integers
from rrins.firmware_py.core.diagnostic_records import DiagnosticState
from rrins.firmware_py.core.memory import Fusion

_VARIED_COUNTS = 4.0
_CHANGED_COUNTS = 8.0
_REDUNDANT_FROM = 4


@compiled
def _expected(fusion: Fusion, vector_s: Floats, sensor: int) -> float:
    """Return the component of the fused vector along a sensor's input axis."""
    return (
        fusion.H[sensor, 0] * vector_s[0]
        + fusion.H[sensor, 1] * vector_s[1]
        + fusion.H[sensor, 2] * vector_s[2]
    )


@compiled
def _look(
    fusion: Fusion,
    measured: Floats,
    vector_s: Floats,
    usable: int,
    last: Floats,
    unchanged: Integers,
    expected: Floats,
    varied: int,
    compared: int,
    resolution: float,
    epochs: int,
) -> tuple[int, int]:
    """Return the stuck sensors and those whose expected increment has varied, one bit each."""
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


@compiled
def gyros(
    fusion: Fusion, measured: Floats, dtheta_s: Floats, usable: int, monitor: DiagnosticState
) -> int:
    """Return the stuck gyros among the usable ones, one bit each."""
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


@compiled
def accelerometers(
    fusion: Fusion, measured: Floats, dv_s: Floats, usable: int, monitor: DiagnosticState
) -> int:
    """Return the stuck accelerometers among the usable ones, one bit each."""
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
