"""The increments of the sensors in each epoch, as their frames carry them."""

from __future__ import annotations

from typing import Annotated

from rrins.compiled.compilation import compiled_with
from rrins.compiled.compiled_beside import compiled_beside
from rrins.compiled.record import I8, Floats, Record, Records
from rrins.dbc.contract import SENSOR_GROUPS, Contract
from rrins.firmware_py.core.records.memory import Ram
from rrins.host_tools.hardware.memory import Plant
from rrins.host_tools.runs.fast import parts_beside, step_both
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.vehicle.fused import switched_on


class SensorIncrements(Record):
    """The increments of all sensors in an epoch, along their input axes."""

    epoch: I8  #: number of the epoch
    gyro: Annotated[Floats, SENSOR_GROUPS]  #: rad
    accelerometer: Annotated[Floats, SENSOR_GROUPS]  #: m/s
    gyro_usable: I8  #: one bit each, not flagged as absent or saturated
    accelerometer_usable: I8  #: the same


@compiled_with(nogil=True)
def _run_epochs(
    plants: Records[Plant],
    pieces: Floats,
    ram: Records[Ram],
    contract: Records[Contract],
    compares: bool | None,
    estimates: bool | None,
    rows: Records[SensorIncrements],
) -> None:
    """Run both sides, an epoch for each row; write what the sensors gave."""
    plant, state, record = plants[0], ram[0], contract[0]
    for k in range(len(rows)):
        step_both(plant, pieces, state, record, compares, estimates)
        row, assembly = rows[k], state.assembly
        row.epoch = state.epoch
        row.gyro_usable = assembly.gyro_usable
        row.accelerometer_usable = assembly.accelerometer_usable
        for sensor in range(SENSOR_GROUPS):
            row.gyro[sensor] = assembly.gyro_dtheta[sensor]
            row.accelerometer[sensor] = assembly.accelerometer_dv[sensor]


def sensors_of_scenario(scenario: Scenario) -> Records[SensorIncrements]:
    """Run a scenario without frames; return what the sensors gave in each epoch from power-on.

    Raises as `switched_on` does.
    """
    run = switched_on(scenario)
    rows = SensorIncrements.zeros(scenario.epochs + 1)
    with compiled_beside(*parts_beside(run.contract, run.compares)):
        _run_epochs(run.plant, run.pieces, run.ram, run.contract, run.compares, run.estimates, rows)
    return rows
