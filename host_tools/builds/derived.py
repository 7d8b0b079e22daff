"""Functions of the firmware that the diagnostics in C call beside its step."""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats, Records
from rrins.firmware_py.core.frames_in import clock
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.maths.attitude import matrix_of_euler
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.turntable import sequencer, table_sums
from rrins.firmware_py.core.turntable.table_sums import TableSums

DERIVED = ("gravity", "error_ppm")
"""The values of `derive`, in order."""


@compiled
def derive(ram: Records[Ram], found: Floats) -> int:
    """Write gravity where navigation starts, m/s², and the own clock's rate error, ppm."""
    parameters = ram[0].parameters
    found[0] = earth.gravity(parameters.latitude, parameters.height)
    found[1] = clock.error_ppm(ram[0].clock, parameters.period_ns)
    return 0


@compiled
def set_attitude(ram: Records[Ram], angles: Floats) -> int:
    """Set the initial attitude by roll, pitch and heading, rad."""
    matrix_of_euler(ram[0].parameters.C_b_n, angles[0], angles[1], angles[2])
    return 0


@compiled
def watch(ram: Records[Ram]) -> int:
    """Return 1 if an axis does not follow its command, else 0."""
    state = ram[0]
    return int(sequencer.watch(state.sequencer, state.parameters, state.assembly))


@compiled
def add_sums(ram: Records[Ram], sums: Records[TableSums]) -> int:
    """Add the epoch of the last step to the sums of a calibration on the table."""
    table_sums.add(ram, sums)
    return 0


@compiled
def begin_sums(sums: Records[TableSums]) -> int:
    """Begin the next second of these sums."""
    table_sums.begin(sums[0])
    return 0
