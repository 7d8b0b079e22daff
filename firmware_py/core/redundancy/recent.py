"""Parity and residuals of the last seconds, for pictures and freeze frames."""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.records.redundancy_records import BEFORE_S, HISTORY_S, Parity
from rrins.firmware_py.core.redundancy.parity import CHECKED_FROM


@compiled
def note(parity: Parity, count: int, epoch: int, dt: float) -> None:
    """Note a second that has been closed: its parity, residuals and their thresholds."""
    second = parity.history[parity.history_count % HISTORY_S]
    second.epoch = epoch
    second.sensors = parity.sensors
    second.ratio = max(parity.ratio, parity.peak)
    seconds = parity.used_epochs * dt
    for i in range(count):
        second.residual[i] = 0.0
        second.threshold[i] = 0.0
        if parity.projector[i, i] > CHECKED_FROM:
            learned = parity.uncertain * parity.learning_variance[i]
            variance = parity.variance[i, 0] + learned  # of this residual, not of a fitted step
            second.residual[i] = parity.residual[i] / seconds
            second.threshold[i] = parity.second_factor * math.sqrt(variance) / seconds
    parity.history_count += 1


@compiled
def remember(parity: Parity, epoch: int) -> None:
    """Keep the last seconds before an alarm that begins now."""
    before = parity.before
    before.epoch = epoch
    for k in range(BEFORE_S):
        at = parity.history_count - BEFORE_S + k
        row = k * SENSOR_GROUPS
        before.ratio[k] = 0.0
        for i in range(SENSOR_GROUPS):
            before.residual[row + i] = 0.0
        if at < 0:
            continue
        second = parity.history[at % HISTORY_S]
        before.ratio[k] = second.ratio
        for i in range(SENSOR_GROUPS):
            before.residual[row + i] = second.residual[i]
