"""The routine `calibration`: the bias of every sensor from a record at standstill.

At standstill each gyro senses the Earth's rate along its input axis, each accelerometer the
reaction to gravity. The mean of what remains is the bias, if the attitude is known and other
errors are small. An attitude error of 1″ looks like 5 µg, or 7e-5 °/h, of bias.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.dbc.values import AxisState
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.sensors.calibration import DPH, UG
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.calibration_image import Parameters
from rrins.firmware_py.diagnostics.codecs import Value, ValueRangeError, Values
from rrins.firmware_py.diagnostics.computer import Computer
from rrins.firmware_py.diagnostics.parameters import ACCELEROMETER_CALIBRATIONS, GYRO_CALIBRATIONS
from rrins.firmware_py.diagnostics.routines import RoutineState
from rrins.firmware_py.diagnostics.services.programmes import Programme
from rrins.firmware_py.diagnostics.writer import WriteJob

MISSING_SHARE = 0.1
"""Of the epochs, in which a sensor may be missing."""

_AT_REST = (AxisState.HOLDING, AxisState.OFF)


class _Record:
    """Mean and variance of the increments of one kind of sensor."""

    def __init__(self, increments: Floats, valid: NDArray[np.uint32]) -> None:
        self._increments = increments
        self._valid = valid
        self._bits = 1 << np.arange(SENSOR_GROUPS)
        self._first = np.zeros(SENSOR_GROUPS)
        self._count = np.zeros(SENSOR_GROUPS)
        self._sum = np.zeros(SENSOR_GROUPS)
        self._square = np.zeros(SENSOR_GROUPS)

    def add(self) -> None:
        """Add an epoch's increments of the valid sensors."""
        valid = (int(self._valid[0]) & self._bits) != 0
        now = self._increments[0]
        self._first = np.where((self._count == 0) & valid, now, self._first)
        difference = np.where(valid, now - self._first, 0.0)  # small: nothing is lost in squaring
        self._count += valid
        self._sum += difference
        self._square += difference * difference

    def is_whole(self, sensors: int, epochs: int) -> bool:
        """Return whether every sensor was present often enough."""
        return bool(np.all(self._count[:sensors] >= (1.0 - MISSING_SHARE) * epochs))

    def mean(self) -> Floats:
        """Return the mean increments."""
        return self._first + self._sum / np.maximum(1.0, self._count)

    def sigma(self) -> Floats:
        """Return their standard errors, assuming white noise."""
        count = np.maximum(2.0, self._count)
        variance = (self._square - self._sum**2 / count) / (count - 1.0)
        return np.sqrt(np.maximum(0.0, variance) / count)


class CalibrationProgramme(Programme):
    """A record at standstill, and the biases computed from it."""

    name = "calibration"
    ends_with_session = True

    def __init__(self, computer: Computer) -> None:
        super().__init__(computer)
        self._epochs = self._wanted = 0
        self._store = False
        self._stored = False
        self._job: WriteJob | None = None
        self._records = self._new_records()

    def _new_records(self) -> tuple[_Record, _Record]:
        assembly = self.computer.ram["assembly"]
        return (
            _Record(assembly["gyro_dtheta"], assembly["gyro_valid"]),
            _Record(assembly["accelerometer_dv"], assembly["accelerometer_valid"]),
        )

    def may_start(self) -> bool:
        """Return whether the mode allows it."""
        return self.computer.mode == Mode.STANDBY and self._is_at_rest()

    def _is_at_rest(self) -> bool:
        assembly = self.computer.state.assembly
        return all(
            assembly.axis_state[axis] in _AT_REST and assembly.encoder_rate_dps[axis] == 0.0
            for axis in (0, 1)
        )

    def start(self, arguments: Values) -> None:
        """Begin."""
        duration_s, store = arguments["duration_s"], arguments["store"]
        assert isinstance(duration_s, int)
        super().start(arguments)
        self._store, self._stored, self._job = bool(store), False, None
        self._epochs = 0
        self._wanted = round(duration_s * 1e9 / self.computer.period_ns)
        self._records = self._new_records()

    def forget(self) -> None:
        """Return to the state after power-on."""
        super().forget()
        self._job = None

    def work(self) -> None:
        """Do one epoch's work, while it runs."""
        if self._job is not None:
            self._await(self._job)
            return
        if self.computer.mode != Mode.STANDBY or not self._is_at_rest():
            self.state = RoutineState.FAILED
            return
        for record in self._records:
            record.add()
        self._epochs += 1
        if self._epochs == self._wanted:
            self._finish()

    def _finish(self) -> None:
        counts = self._counts()
        whole = zip(self._records, counts, strict=True)
        if not all(record.is_whole(count, self._epochs) for record, count in whole):
            self.state = RoutineState.FAILED
        elif self._store:
            self._keep(self._parameters())
        else:
            self.state = RoutineState.DONE

    def _keep(self, found: Parameters) -> None:
        """Start storing the biases, unless one is beyond its limits."""
        try:
            for number, values in found.items():
                table.IDENTIFIER_BY_NUMBER[number].layout.check(values)
        except ValueRangeError:
            self.state = RoutineState.FAILED
        else:
            self._job = self.computer.parameters.change(found)

    def _await(self, job: WriteJob) -> None:
        if job.done:
            self._stored = self.computer.parameters.finish(job)
            self.state = RoutineState.DONE if self._stored else RoutineState.FAILED
            self._job = None

    def _counts(self) -> tuple[int, int]:
        state = self.computer.state
        return int(state.gyros.count), int(state.accelerometers.count)

    def _biases(self) -> tuple[Floats, Floats]:
        """Return the gyros' biases, °/h, and the accelerometers', µg."""
        state = self.computer.state
        parameters = state.parameters
        seconds = self.computer.period_ns * 1e-9
        C_n_s = (parameters.C_b_n @ state.C_s_b).T
        latitude = float(parameters.latitude)
        rate_n = earth.RATE * np.array([0.0, math.cos(latitude), math.sin(latitude)])
        force_n = np.array([0.0, 0.0, self.computer.gravity])
        dtheta = state.gyros.H @ (C_n_s @ rate_n) * seconds
        dv = state.accelerometers.H @ (C_n_s @ force_n) * seconds
        gyros, accelerometers = self._records
        # The measurements are already compensated: the rest adds to the bias in effect.
        dtheta_bias = gyros.mean() - dtheta + state.gyros.bias_increment
        dv_bias = accelerometers.mean() - dv + state.accelerometers.bias_increment
        return dtheta_bias / (seconds * DPH), dv_bias / (seconds * UG)

    def _parameters(self) -> Parameters:
        """Return the calibrations with the biases found."""
        memory = self.computer.parameters
        found: Parameters = {}
        tables = (GYRO_CALIBRATIONS, ACCELEROMETER_CALIBRATIONS)
        names = ("bias_dph", "bias_ug")
        for did, name, biases, count in zip(
            tables, names, self._biases(), self._counts(), strict=True
        ):
            for parameter, bias in zip(did[:count], biases[:count].tolist(), strict=True):
                found[parameter.number] = memory.value(parameter.number) | {name: bias}
        return found

    def results(self) -> Values:
        """Return the results so far."""
        gyro_count, accelerometer_count = self._counts()
        seconds = self.computer.period_ns * 1e-9
        gyro_bias, accelerometer_bias = self._biases()
        gyros, accelerometers = self._records
        return {
            "state": int(self.state),
            "epochs": self._epochs,
            "gyro_bias_dph": _padded(gyro_bias, gyro_count),
            "accelerometer_bias_ug": _padded(accelerometer_bias, accelerometer_count),
            "gyro_bias_sigma_dph": _padded(gyros.sigma() / (seconds * DPH), gyro_count),
            "accelerometer_bias_sigma_ug": _padded(
                accelerometers.sigma() / (seconds * UG), accelerometer_count
            ),
            "stored": int(self._stored),
        }


def _padded(values: Floats, count: int) -> Value:
    """Return a tuple of `SENSOR_GROUPS` single-precision values, zero after the first `count`."""
    kept = np.zeros(SENSOR_GROUPS, dtype=np.float32)
    kept[:count] = values[:count]
    return tuple(float(value) for value in kept)
