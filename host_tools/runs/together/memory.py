"""Moves a run between its own records and its lane."""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.lanes import fetch
from rrins.compiled.record import Floats
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.maths.attitude import matrix_of_quaternion
from rrins.firmware_py.core.records.diagnostic_records import Repetition
from rrins.firmware_py.core.records.memory import Fusion, Ins, Ram
from rrins.firmware_py.core.records.redundancy_records import (
    ABSOLUTE,
    ACCELEROMETERS,
    EPOCH_LEVELS,
    FINE_CAPACITY,
    FINE_LEVELS,
    REGRESSORS,
    WINDOWS_S,
    Parity,
)
from rrins.host_tools.hardware.memory import Plant, Sensors
from rrins.host_tools.runs.together import rows
from rrins.host_tools.runs.together.rows import KIND, SENSOR, SENSOR_ROWS

_LINE = 8
"""Floats that a processor fetches at once."""


@compiled
def _take_sensors(memory: Floats, kind: int, lane: int, sensors: Sensors, fusion: Fusion) -> None:
    for k in range(sensors.count):
        at = KIND[kind] + SENSOR + k * SENSOR_ROWS
        for i in range(3):
            memory[at + rows.AXIS + i, lane] = sensors.axis[k, i]
            memory[at + rows.GAIN + i, lane] = fusion.gain[i, k]
            memory[at + rows.INPUT + i, lane] = fusion.H[k, i]
        memory[at + rows.ASYMMETRIC, lane] = sensors.asymmetric_scale_error[k]
        memory[at + rows.NOISE, lane] = sensors.noise_increment[k]
        memory[at + rows.G_SENSITIVITY, lane] = sensors.g_sensitivity[k]
        memory[at + rows.REMAINDER, lane] = sensors.remainder[k]
        memory[at + rows.LAST, lane] = float(sensors.counts[k])
        memory[at + rows.HIGHEST, lane] = 0.0
        positive = negative = 1.0
        memory[at + rows.OFFSET, lane] = 0.0
        if fusion.calibrated:
            memory[at + rows.OFFSET, lane] = fusion.bias_increment[k]
            scale, by_sign = 1.0 + fusion.scale_error[k], fusion.asymmetric_scale_error[k]
            positive, negative = 1.0 / (scale + by_sign), 1.0 / (scale - by_sign)
        memory[at + rows.CORRECTION, lane] = 0.5 * (positive + negative)
        memory[at + rows.CORRECTION_BY_SIGN, lane] = 0.5 * (positive - negative)


@compiled
def _take_repetition(memory: Floats, kind: int, lane: int, repetition: Repetition) -> None:
    for k in range(rows.SENSORS):
        at = KIND[kind] + SENSOR + k * SENSOR_ROWS
        memory[at + rows.REPEATED, lane] = float(repetition.unchanged[k])
        memory[at + rows.LONGEST, lane] = 0.0


@compiled
def take_drift(memory: Floats, lane: int, plant: Plant) -> None:
    """Take over the errors that drift."""
    for kind in range(2):
        sensors = plant.gyros
        if kind == ACCELEROMETERS:
            sensors = plant.accelerometers
        for k in range(sensors.count):
            at = KIND[kind] + SENSOR + k * SENSOR_ROWS
            memory[at + rows.SCALE, lane] = 1.0 + sensors.scale_error[k]
            memory[at + rows.BIAS, lane] = sensors.bias_increment[k]


@compiled
def take_learned(memory: Floats, kind: int, lane: int, parity: Parity) -> None:
    """Take over what was learned of a parity, and begin a second."""
    at = KIND[kind]
    for k in range(rows.SENSORS):
        memory[at + rows.PARITY + k, lane] = parity.projector[0, k]
        memory[at + SENSOR + k * SENSOR_ROWS + rows.SUM, lane] = 0.0
        memory[at + SENSOR + k * SENSOR_ROWS + rows.ABSOLUTE_SUM, lane] = 0.0
    for j in range(REGRESSORS):
        memory[at + rows.LEARNED + j, lane] = parity.parity.coefficients[0, j]
    factor = parity.epoch_factor * parity.epoch_factor
    for level in range(EPOCH_LEVELS):
        variance = factor * parity.epoch_variance[0, level]
        memory[at + rows.ALLOWED + level, lane] = 1.0 / variance if variance > 0.0 else 0.0
        memory[at + rows.LEVEL + level, lane] = parity.level_sum[level, 0]
    for i in range(3):
        memory[at + rows.VECTOR + i, lane] = 0.0
        memory[at + rows.UNEXPECTED + i, lane] = 0.0
    memory[at + rows.RATIO, lane] = 0.0


@compiled
def take(memory: Floats, lane: int, plant: Plant, state: Ram) -> None:
    """Take over a run where it is, at the end of a second."""
    ins, redundancy, diagnostics = state.ins, state.redundancy, state.diagnostics
    for i in range(4):
        memory[rows.ATTITUDE + i, lane] = ins.q_s_n[i]
    memory[rows.DLATITUDE, lane], memory[rows.DLONGITUDE, lane] = 0.0, 0.0
    memory[rows.LATITUDE, lane], memory[rows.HEIGHT, lane] = ins.latitude, ins.height
    for i in range(2):
        memory[rows.VELOCITY + i, lane] = ins.velocity_n[i]
        memory[rows.CHANGE + i, lane] = ins.velocity_change_n[i]
    for i in range(3):
        memory[rows.DTHETA + i, lane] = ins.dtheta_s_previous[i]
        memory[rows.DV + i, lane] = ins.dv_s_previous[i]
    _take_sensors(memory, 0, lane, plant.gyros, state.gyros)
    _take_sensors(memory, 1, lane, plant.accelerometers, state.accelerometers)
    _take_repetition(memory, 0, lane, diagnostics.gyro_repetition)
    _take_repetition(memory, 1, lane, diagnostics.accelerometer_repetition)
    take_drift(memory, lane, plant)
    take_learned(memory, 0, lane, redundancy.gyros)
    take_learned(memory, 1, lane, redundancy.accelerometers)


@compiled
def give_sample(memory: Floats, lane: int, longitude: float, sample: Floats) -> None:
    """Write position and velocity of a run; `longitude` is where its lane began."""
    sample[0] = memory[rows.LATITUDE, lane] + memory[rows.DLATITUDE, lane]
    sample[1] = earth.wrapped(longitude + memory[rows.DLONGITUDE, lane])
    sample[2] = memory[rows.VELOCITY, lane]
    sample[3] = memory[rows.VELOCITY + 1, lane]


@compiled
def give_navigation(memory: Floats, lane: int, ins: Ins, longitude: float) -> None:
    """Write where a run has come to; `longitude` is where its lane began."""
    for i in range(4):
        ins.q_s_n[i] = memory[rows.ATTITUDE + i, lane]
    matrix_of_quaternion(ins.C_s_n, ins.q_s_n)
    ins.latitude = memory[rows.LATITUDE, lane] + memory[rows.DLATITUDE, lane]
    ins.longitude = earth.wrapped(longitude + memory[rows.DLONGITUDE, lane])
    for i in range(2):
        ins.velocity_n[i] = memory[rows.VELOCITY + i, lane]


@compiled
def fetch_second(parity: Parity) -> None:
    """Fetch where the windows begin that end with the next second: all at once, not one by one."""
    for level in range(FINE_LEVELS):
        begin = parity.fine[(parity.seconds + 1 - WINDOWS_S[level]) % FINE_CAPACITY]
        fetch(begin.residual, 0)
        for k in range(0, REGRESSORS, _LINE):
            fetch(begin.regressors, k)
        for k in range(0, len(begin.parity), _LINE):
            fetch(begin.parity, k)
        fetch(begin.vector, 0)


@compiled
def give_second(
    memory: Floats, lane: int, kind: int, parity: Parity, fusion: Fusion, epochs: int, phase: int
) -> None:
    """Write the sums of a second that ends, of `epochs` epochs."""
    at, count = KIND[kind], fusion.count
    parity.used_epochs += epochs
    parity.known_epochs += epochs
    parity.level_epochs = phase
    for level in range(EPOCH_LEVELS):
        for k in range(count):
            parity.level_sum[level, k] = memory[at + rows.LEVEL + level, lane]
    for k in range(count):
        sensor = at + SENSOR + k * SENSOR_ROWS
        residual = memory[sensor + rows.SUM, lane]
        for i in range(3):
            residual -= fusion.H[k, i] * memory[at + rows.VECTOR + i, lane]
        parity.residual[k] += residual
        parity.regressors[ABSOLUTE + k] += memory[sensor + rows.ABSOLUTE_SUM, lane]
    for i in range(3):
        parity.regressors[1 + i] += memory[at + rows.VECTOR + i, lane]
        parity.regressors[4 + i] += memory[KIND[1 - kind] + rows.VECTOR + i, lane]
        parity.vector[i] += memory[at + rows.UNEXPECTED + i, lane]


@compiled
def is_clear(
    memory: Floats,
    lane: int,
    kind: int,
    sensors: Sensors,
    repetition: Repetition,
    unit: float,
    largest: int,
) -> bool:
    """Return whether no sensor was near a limit, and no parity of a short window beyond its own."""
    at = KIND[kind]
    if not memory[at + rows.RATIO, lane] < 1.0:
        return False
    for k in range(sensors.count):
        sensor = at + SENSOR + k * SENSOR_ROWS
        limit = 0.99 * min(sensors.range_increment, largest * unit)
        if not memory[sensor + rows.HIGHEST, lane] * unit < limit:
            return False
        enough = float(repetition.enough[k])
        if enough > 0.0 and not memory[sensor + rows.LONGEST, lane] < enough:
            return False
    return True
