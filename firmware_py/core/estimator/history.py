"""The filter's state, second by second, for bus, diagnostics and results."""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.estimator import constants
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.records.estimator_records import (
    AIDS,
    ATTITUDE,
    BIASES,
    ESTIMATOR_HISTORY_S,
    HEIGHT,
    LATITUDE,
    LONGITUDE,
    NEVER,
    ODOMETER_STATES,
    SENSOR_CONSTANTS,
    VELOCITY,
)
from rrins.firmware_py.core.records.memory import Ram


@compiled
def count_alignment(state: Ram) -> None:
    """Count the epochs of the fine alignment; a filter that does not run yet begins at zero."""
    estimator = state.estimator
    if not estimator.running:
        estimator.aligned_epochs = 0
        estimator.aligned_epoch = NEVER
    if state.modes.mode == Mode.FINE_ALIGNMENT:
        estimator.aligned_epochs += 1
        estimator.aligned_epoch = state.epoch


@compiled
def note(state: Ram) -> None:
    """Note the second at whose end the filter stands, with what was measured before that.

    So does the navigation at that epoch: what was found has been fed back.
    """
    estimator, sigma = state.estimator, state.estimator.sigma
    second = estimator.history[estimator.history_count % ESTIMATOR_HISTORY_S]
    second.epoch = estimator.epoch
    for i in range(3):
        second.attitude_sigma[i] = sigma[ATTITUDE + i]
        second.velocity_sigma[i] = sigma[VELOCITY + i]
    second.position_sigma[0] = sigma[LONGITUDE] * estimator.east_radius
    second.position_sigma[1] = sigma[LATITUDE] * estimator.north_radius
    second.position_sigma[2] = sigma[HEIGHT]
    gyros = int(state.gyros.count)
    for k in range(gyros):
        second.bias[0, k] = estimator.gyro_bias[k]
        second.bias_sigma[0, k] = sigma[BIASES + k]
    first = BIASES + gyros
    for k in range(state.accelerometers.count):
        second.bias[1, k] = estimator.accelerometer_bias[k]
        second.bias_sigma[1, k] = sigma[first + k]
    if state.odometer.interval_epochs > 0:
        first += int(state.accelerometers.count)
        for i in range(ODOMETER_STATES):
            second.odometer[i] = estimator.odometer[i]
            second.odometer_sigma[i] = sigma[first + i]
    if estimator.altimeter:
        at = estimator.altimeter_state
        second.altimeter_bias = estimator.altimeter_bias
        second.altimeter_bias_sigma = sigma[at]
    if estimator.constants:
        _note_constants(state)
    _note_sources(state)
    estimator.history_count += 1


@compiled
def _note_constants(state: Ram) -> None:
    estimator = state.estimator
    second = estimator.history[estimator.history_count % ESTIMATOR_HISTORY_S]
    count = int(state.gyros.count)
    for kind in range(2):
        if kind == 1:
            count = int(state.accelerometers.count)
        for error in range(SENSOR_CONSTANTS):
            row = SENSOR_CONSTANTS * kind + error
            for k in range(count):
                at = constants.state_of(state, error, kind, k)
                second.constant[row, k] = estimator.constant[row, k]
                second.constant_sigma[row, k] = estimator.sigma[at]


@compiled
def _note_sources(state: Ram) -> None:
    estimator = state.estimator
    second = estimator.history[estimator.history_count % ESTIMATOR_HISTORY_S]
    before = estimator.history[(estimator.history_count - 1) % ESTIMATOR_HISTORY_S]
    second.aided_by = 0
    second.rejecting = 0
    for aid in range(AIDS):
        source = estimator.sources[aid]
        # Unlike the second before, the filter may have begun anew.
        if source.used > 0 and source.used != before.used[aid]:
            second.aided_by |= 1 << aid
        if source.rejected_in_a_row > 0:
            second.rejecting |= 1 << aid
        second.used[aid] = source.used
        second.rejected[aid] = source.rejected
        second.squares[aid] = source.squares
