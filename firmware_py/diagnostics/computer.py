"""The navigation computer, as the diagnostic services see it."""

from __future__ import annotations

import functools
import math
import zlib
from collections.abc import Callable

import numpy as np

from rrins.compiled.record import Floats, Records
from rrins.dbc.values import AxisCommand
from rrins.firmware_py.core.frames_in import clock
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.records.diagnostic_records import RoutineRequest
from rrins.firmware_py.core.records.integrity_records import HEADING, HORIZONTAL, VERTICAL
from rrins.firmware_py.core.records.memory import Clock, Ram
from rrins.firmware_py.core.sensors.calibration import DPH, UG
from rrins.firmware_py.diagnostics import calibration_image as image
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.codecs import Value, Values
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.fault_memory import FaultMemory
from rrins.firmware_py.diagnostics.last_second import LAST_SECOND
from rrins.firmware_py.diagnostics.parameter_memory import ParameterMemory
from rrins.firmware_py.diagnostics.parameters import PARAMETERS
from rrins.firmware_py.diagnostics.reader import FieldReader
from rrins.firmware_py.version import VERSION

IDENTITY = {
    "supplier": "RRINS project",
    "serial_number": "0000000001",
    "hardware_number": "emulated",
    "software_number": "rrins-firmware",
    "software_version": VERSION,
    "system_name": "RRINS navigation computer",
}
"""The computer's identification data."""

# Not compiled: passing a record across costs more than the computation.
_error_ppm: Callable[[Clock, int], float] = getattr(clock.error_ppm, "py_func", clock.error_ppm)

_DEGREE = math.radians(1.0)
NO_BOUND = 1e9
"""A protection level without a bound."""

_PARAMETER_NUMBERS = frozenset(parameter.number for parameter in PARAMETERS)

AXIS_MODES = (Mode.STANDBY, Mode.FAULT, Mode.NAVIGATION_STRAPDOWN)
"""Modes in which a tool may turn the axes."""

NAVIGATION_MODES = (Mode.FINE_ALIGNMENT, Mode.NAVIGATION_STRAPDOWN, Mode.NAVIGATION_ROTATING)
"""Modes in which a restart loses a position."""


class Computer:
    """The RAM image and the memories, and the operations of the services on them.

    Parameters
    ----------
    session : callable
        Returns the active session.

    Attributes
    ----------
    gravity : float
        At the place where navigation starts, m/s².
    calibration_record : bytearray
        What a calibration on the table has recorded; see `diagnostics.calibration_record`.
    """

    def __init__(
        self,
        ram: Records[Ram],
        parameters: ParameterMemory,
        faults: FaultMemory,
        session: Callable[[], int],
    ) -> None:
        self.ram = ram
        self.parameters = parameters
        self.faults = faults
        self.period_ns = int(ram[0].parameters.period_ns)
        self.gravity = 0.0
        self.calibration_record = bytearray()
        self._file = b""
        self._filed: image.Parameters | None = None  # the stored ones that are in the file
        self._mode = ram["modes"]["mode"]
        self._routine_request = ram["diagnostics"]["routine_request"]
        special = self._special(session)
        self._readers = {
            did.number: FieldReader(ram, did.fields, special)
            for did in table.IDENTIFIERS
            if did.number not in _PARAMETER_NUMBERS
        }
        table.crc32()  # computed here, not at the first request
        self.power_on()

    def _special(self, session: Callable[[], int]) -> dict[str, Callable[[], Value]]:
        """Return the getters of the values that are not in the RAM image."""
        own = self.ram[0].clock
        steps = self.ram["steps"]
        gyro_residual = self.ram[0].diagnostics.gyro_residual
        accelerometer_residual = self.ram[0].diagnostics.accelerometer_residual
        memory, faults = self.parameters, self.faults
        found: dict[str, Callable[[], Value]] = {
            "session": session,
            "table_crc32": table.crc32,
            "error_ppm": lambda: float(_error_ppm(own, self.period_ns)),
            "bus_load_percent": self._bus_load_percent,
            "uptime_s": lambda: int(steps[0]) * self.period_ns * 1e-9,
            "state": lambda: int(memory.state),
            "sequence": lambda: memory.sequence & 0xFFFF_FFFF,
            "parameters": lambda: len(memory.stored),
            "residual_dph": lambda: self._residuals(gyro_residual, DPH),
            "residual_ug": lambda: self._residuals(accelerometer_residual, UG),
            **{name: one.reader(self.ram) for name, one in LAST_SECOND.items()},
            "horizontal_protection_m": self._bound(HORIZONTAL),
            "vertical_protection_m": self._bound(VERTICAL),
            "heading_protection_deg": self._bound(HEADING, _DEGREE),
            "nis": self._nis,
            "operation_cycles": lambda: faults.operation_cycles,
            "length": lambda: len(self.calibration_file()),
            "file_crc32": lambda: zlib.crc32(self.calibration_file()),
        }
        return found | {name: functools.partial(str, text) for name, text in IDENTITY.items()}

    def _bound(self, bound: int, unit: float = 1.0) -> Callable[[], Value]:
        """Return what reads a protection level; no bound is the largest value."""
        protection = self.ram["integrity"]["protection"]
        return lambda: min(float(protection[0, bound]) / unit, NO_BOUND)

    def _bus_load_percent(self) -> float:
        monitor = self.state.diagnostics
        return float(100.0 * monitor.frames_mean / monitor.frames_capacity)

    def _nis(self) -> tuple[float, ...]:
        sources = self.ram["estimator"]["sources"][0]
        return tuple((sources["squares"] / np.maximum(1, sources["used"])).tolist())

    def _residuals(self, increments: Floats, unit: float) -> tuple[float, ...]:
        return tuple((increments / (unit * self.period_ns * 1e-9)).tolist())

    def power_on(self) -> None:
        """Derive what depends on the settings of a new RAM image."""
        parameters = self.ram[0].parameters
        self.gravity = float(earth.gravity(float(parameters.latitude), float(parameters.height)))

    def calibration_file(self) -> bytes:
        """Return the calibration file of the parameters as they are after a reset."""
        stored = self.parameters.stored
        if stored is not self._filed:  # encoding takes longer than all else that a request reads
            self._file, self._filed = image.encode(self.parameters.effective()), stored
        return self._file

    @property
    def mode(self) -> Mode:
        """The mode after the last step."""
        return Mode(int(self._mode[0]))

    @property
    def state(self) -> Ram:
        """The RAM image's record."""
        return self.ram[0]

    def ask(self, request: RoutineRequest) -> None:
        """Request something of the mode logic in the next step."""
        self._routine_request[0] = request

    def read(self, did: DataIdentifier) -> bytes:
        """Return an identifier's data record."""
        return did.encode(self.values(did))

    def values(self, did: DataIdentifier) -> Values:
        """Return an identifier's values."""
        if did.number in _PARAMETER_NUMBERS:
            return self.parameters.value(did.number)
        return self._readers[did.number].read()

    def has(self, did: DataIdentifier) -> bool:
        """Return whether this computer has an identifier."""
        return did.number not in _PARAMETER_NUMBERS or self.parameters.has(did.number)

    def turn_axis(self, axis: int, target_deg: float) -> None:
        """Turn an axis to an angle."""
        self._command(axis, AxisCommand.POSITION, target_deg)

    def hold_axis(self, axis: int) -> None:
        """Make an axis hold its angle."""
        angle_deg = float(self.state.assembly.encoder_angle_deg[axis])
        self._command(axis, AxisCommand.HOLD, angle_deg)

    def _command(self, axis: int, command: AxisCommand, target_deg: float) -> None:
        sequencer = self.state.sequencer
        sequencer.command[axis] = command
        sequencer.target_angle_deg[axis] = target_deg

    def is_told(self, axis: int, target_deg: float) -> bool:
        """Return whether an axis is still commanded to turn to an angle."""
        sequencer = self.state.sequencer
        turns = sequencer.command[axis] == AxisCommand.POSITION
        return bool(turns and math.isclose(sequencer.target_angle_deg[axis], target_deg))
