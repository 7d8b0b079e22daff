"""The emulated table without a firmware: thousands of seconds of a calibration in a second.

The hardware's own steps and the firmware's own sums in one compiled loop, for the Monte Carlo.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rrins.compiled.compilation import compiled, compiled_with
from rrins.compiled.record import Floats, Integers, Records
from rrins.dbc.contract import Contract, load_contract
from rrins.dbc.values import AxisCommand
from rrins.firmware_py.core import settings as firmware
from rrins.firmware_py.core.records.memory import INNER, OUTER, Ram
from rrins.firmware_py.core.settings import Scheme
from rrins.firmware_py.core.turntable import table_sums
from rrins.firmware_py.core.turntable.table_sums import TableSums
from rrins.host_tools.calibration.seconds import Seconds, decode, row_size
from rrins.host_tools.hardware import settings as hardware
from rrins.host_tools.hardware import turntable
from rrins.host_tools.hardware.memory import Plant
from rrins.host_tools.hardware.step import advance
from rrins.host_tools.runs.fast import pass_measured
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario

_POSITION = int(AxisCommand.POSITION)
_SETTLE_S = 0.5
_FIRST_S = 2.0


@compiled
def _receive(plant: Plant, state: Ram, contract: Contract) -> None:
    pass_measured(plant, state.assembly, contract)
    state.assembly.gyro_valid = (1 << plant.gyros.count) - 1
    state.assembly.accelerometer_valid = (1 << plant.accelerometers.count) - 1


@compiled
def _keep(row: Floats, plant: Plant, state: Ram, sums: TableSums, position: int) -> None:
    """Write a second as `calibration_record.fields` orders it."""
    row[0] = plant.epoch
    row[1] = sums.epochs
    row[2] = position
    row[6] = state.assembly.encoder_angle_deg[INNER]
    row[7] = state.assembly.encoder_angle_deg[OUTER]
    at = 8
    for k in range(table_sums.ORIENTATIONS):
        row[at + k] = sums.orientation[k]
    at += table_sums.ORIENTATIONS
    for k in range(table_sums.TURNS):
        row[at + k] = sums.turn[k]
    at += table_sums.TURNS
    for k in range(plant.gyros.count):
        row[at + k] = sums.gyro[k]
    at += plant.gyros.count
    for k in range(plant.accelerometers.count):
        row[at + k] = sums.accelerometer[k]


@compiled_with(nogil=True)
def _turn(
    plants: Records[Plant],
    pieces: Floats,
    ram: Records[Ram],
    contract: Records[Contract],
    records: Records[TableSums],
    axes: Integers,
    turns: Floats,
    rate: float,
    epochs: Integers,
    second: int,
    rows: Floats,
) -> int:
    """Turn through positions; return the rows written."""
    plant, state, record = plants[0], ram[0], contract[0]
    count = 0
    for position in range(len(axes)):
        if axes[position] >= 0:
            axis = plant.axis[axes[position]]
            turntable.command(axis, _POSITION, axis.target + turns[position], rate)
        for epoch in range(epochs[position]):
            advance(plant, pieces, record)
            plant.epoch += 1
            _receive(plant, state, record)
            table_sums.add(ram, records)
            last = epoch + 1 == epochs[position]
            if last or records[0].epochs == second:
                if axes[position] >= 0:
                    _keep(rows[count], plant, state, records[0], position - 1)
                    count += 1
                table_sums.begin(records[0])
    return count


def record(scenario: Scenario, scheme: Scheme) -> Seconds:
    """Return the seconds of a scheme on the emulated table of a scenario, standing still.

    What a unit's own routine records, without bus and firmware; every sensor counts in every
    second.
    """
    rate_hz = scenario.rate_hz
    settings = replace(hardware_settings(scenario), requests=())
    plants = hardware.power_on(settings)
    ram = firmware.power_on(firmware_settings(scenario), load_contract())
    ram["gyros"]["calibrated"] = False
    ram["accelerometers"]["calibrated"] = False
    gyros, accelerometers = len(scenario.rimu.gyros), len(scenario.rimu.accelerometers)
    axes = [-1] + [INNER if turn.axis == "inner" else OUTER for turn in scheme.turns]
    turns = [0.0] + [math.radians(turn.angle_deg) for turn in scheme.turns]
    ramp_s = scheme.turn_rate_dps / scenario.axis_acceleration_dps2 + scenario.axis_rise_s
    durations = [_FIRST_S] + [
        scheme.position_s(turn) + (ramp_s + _SETTLE_S if turn.angle_deg else 0.0)
        for turn in scheme.turns
    ]
    epochs = np.array([max(1, round(seconds * rate_hz)) for seconds in durations], dtype=np.int64)
    rows = np.zeros((int(np.ceil(epochs / rate_hz).sum()) + 1, row_size(gyros, accelerometers)))
    count = _turn(
        plants,
        hardware.pieces_of(settings),
        ram,
        load_contract(),
        TableSums.zeros(),
        np.array(axes, dtype=np.int64),
        np.array(turns),
        math.radians(scheme.turn_rate_dps),
        epochs,
        rate_hz,
        rows,
    )
    return decode(rows[:count], gyros, accelerometers, 1 / rate_hz)
