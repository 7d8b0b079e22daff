"""Which hypotheses the bank weighs: what each of its filters leaves out, or takes for noise."""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.records.redundancy_records import (
    ACCELEROMETERS,
    GYROS,
    Bank,
    Parity,
)
from rrins.firmware_py.core.redundancy import alike
from rrins.firmware_py.core.redundancy.alike import ALIKE


@compiled
def set_up(bank: Bank, gyros: Parity, accelerometers: Parity) -> None:
    """Give the bank a filter for each hypothesis about the kinds in doubt; the first: all sound."""
    bank.count = 0
    _add_filter(bank, -1, -1)
    if bank.doubts >> GYROS & 1 and alike.weigh(gyros, bank.alike[GYROS]):
        _add_filter(bank, ALIKE, -1)
    if bank.doubts >> ACCELEROMETERS & 1 and alike.weigh(
        accelerometers, bank.alike[ACCELEROMETERS]
    ):
        _add_filter(bank, -1, ALIKE)
    for gyro in range(-1, SENSOR_GROUPS):
        if not _is_candidate(bank, GYROS, gyro):
            continue
        for accelerometer in range(-1, SENSOR_GROUPS):
            if _is_candidate(bank, ACCELEROMETERS, accelerometer):
                _add_filter(bank, gyro, accelerometer)
    for kind in range(2):
        if bank.doubts == 1 << kind:
            _add_pairs(bank, kind)
    if bank.doubts == 1 << ACCELEROMETERS:
        _add_noisy(bank)


@compiled
def _is_candidate(bank: Bank, kind: int, sensor: int) -> bool:
    """Return whether a filter may leave out a sensor of a kind; -1 is none."""
    if bank.doubts >> kind & 1 == 0:
        return sensor < 0
    return sensor >= 0 and bank.sensors[kind] >> sensor & 1 != 0


@compiled
def _add_filter(bank: Bank, gyro: int, accelerometer: int) -> None:
    """Add a filter without these sensors; -1: none, `ALIKE`: without what all are off alike."""
    one = bank.filters[bank.count]
    one.sensor[GYROS] = gyro
    one.sensor[ACCELEROMETERS] = accelerometer
    one.second[GYROS] = -1
    one.second[ACCELEROMETERS] = -1
    one.noisy = -1
    one.prior = 0.0
    bank.count += 1


@compiled
def _add_pairs(bank: Bank, kind: int) -> None:
    """Add a filter for each two sensors of a kind."""
    for first in range(SENSOR_GROUPS):
        for second in range(first + 1, SENSOR_GROUPS):
            if _is_candidate(bank, kind, first) and _is_candidate(bank, kind, second):
                _add_filter(bank, first if kind == GYROS else -1, -1 if kind == GYROS else first)
                bank.filters[bank.count - 1].second[kind] = second


@compiled
def _add_noisy(bank: Bank) -> None:
    """Add a filter for each accelerometer that may be noisy, and not off.

    A velocity that walks may look like that of another one that is off. The noise of a gyro goes
    into the attitude, and shows in the velocity much later than a bias.
    """
    for sensor in range(SENSOR_GROUPS):
        if _is_candidate(bank, ACCELEROMETERS, sensor):
            _add_filter(bank, -1, -1)
            bank.filters[bank.count - 1].noisy = sensor
