"""The fast path: the same compiled steps of both sides in one compiled loop, without frames.

What a frame would carry passes rounded as the frame rounds it, so the navigation is bit for bit
that of a run over a bus. There is no CRC, no counter and no wire: a fault on the wire needs frames
(`rrins.host_tools.runs.direct`); faults of the hardware do not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

from rrins.compiled.compilation import compiled, compiled_with
from rrins.compiled.compiled_beside import Beside, array_of, compiled_beside
from rrins.compiled.record import Floats, Records
from rrins.dbc.codec import quantised, quantised_wrapped
from rrins.dbc.contract import Contract, load_contract
from rrins.firmware_py.core import settings as firmware
from rrins.firmware_py.core.frames_in import (
    clock,
    frame_groups,
    gnss,
    intake,
    odometer,
    zero_velocity,
)
from rrins.firmware_py.core.frames_out.transmit import axis_command
from rrins.firmware_py.core.modes.modes import navigating
from rrins.firmware_py.core.records.memory import (
    INNER,
    OUTER,
    Assembly,
    NavigationOutput,
    Ram,
)
from rrins.firmware_py.core.records.transfer_records import MASTER_FRAMES
from rrins.firmware_py.core.step import compute, output
from rrins.firmware_py.core.step import parts_beside as step_parts_beside
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.hardware import gnss as receiver
from rrins.host_tools.hardware import master as other_unit
from rrins.host_tools.hardware import odometer as wheel
from rrins.host_tools.hardware import settings as hardware
from rrins.host_tools.hardware import standing, turntable
from rrins.host_tools.hardware.memory import Plant, Truth
from rrins.host_tools.hardware.step import (
    advance,
    altitude_word,
    group_counts,
    is_altitude_due,
    keep_command,
    note_truth,
    readmission_word,
    update_operator,
)


@compiled
def pass_measured(plant: Plant, assembly: Assembly, contract: Contract) -> None:
    """Hand what sensors and encoders measured to the firmware."""
    for group in range(max(plant.gyros.count, plant.accelerometers.count)):
        dtheta, dv, status = group_counts(plant, group)
        intake.keep_group(assembly, contract.sensor[group], group, dtheta, dv, status)
    for index in (INNER, OUTER):
        axis = plant.axis[index]
        message = contract.axis_inner_status if index == INNER else contract.axis_outer_status
        angle_deg = turntable.encoder_angle_deg(axis)
        intake.keep_axis(
            assembly,
            index,
            axis.state,
            quantised_wrapped(angle_deg, message.encoder_angle_deg),
            quantised(math.degrees(axis.rate), message.encoder_rate_dps),
        )


@compiled
def _pass_up(plant: Plant, pieces: Floats, state: Ram, contract: Contract) -> None:
    """Hand what the hardware measured to the firmware."""
    assembly = state.assembly
    pass_measured(plant, assembly, contract)
    readmission = contract.readmission_command
    word = readmission_word(plant, readmission)
    if word != 0:
        intake.keep_readmission(state, readmission, word)
    zero = contract.zero_velocity
    if standing.is_due(plant, zero):
        zero_velocity.keep(state, zero, standing.word(plant, zero))
    altimeter = contract.altimeter
    if is_altitude_due(plant, altimeter.message):
        note_truth(plant, pieces)
        intake.keep_altitude(assembly, altimeter, altitude_word(plant, altimeter))
    if receiver.measures(plant):
        note_truth(plant, pieces)
        receiver.measure(plant, pieces, contract)
    if receiver.is_due(plant):
        for part in range(gnss.FRAMES):
            frame_groups.keep(state.gnss, part, plant.gnss.word[part])
    if other_unit.measures(plant):
        note_truth(plant, pieces)
        other_unit.measure(plant, contract)
    if other_unit.is_due(plant):
        for part in range(MASTER_FRAMES):
            frame_groups.keep(state.master, part, plant.master.word[part])
    if wheel.measures(plant):
        wheel.measure(plant, contract.odometer)
    if wheel.is_due(plant):
        odometer.keep(state.odometer, plant.odometer.word[0])


@compiled
def _pass_down(plant: Plant, state: Ram, contract: Contract) -> None:
    """Hand what the firmware commands to the hardware, for the epoch that it takes effect in."""
    slot = state.epoch % 2
    for index in (INNER, OUTER):
        axis = plant.axis[index]
        message = contract.axis_inner_command if index == INNER else contract.axis_outer_command
        command, target_deg, rate_dps = axis_command(state, index)
        target_deg = quantised_wrapped(target_deg, message.target_angle_deg)
        rate_dps = quantised(rate_dps, message.rate_limit_dps)
        keep_command(axis.waiting[slot], axis, message, command, target_deg, rate_dps)


@compiled
def step_both(
    plant: Plant,
    pieces: Floats,
    state: Ram,
    contract: Contract,
    compares: bool | None,
    estimates: bool | None,
) -> None:
    """Run one epoch of both sides."""
    advance(plant, pieces, contract)
    update_operator(plant)
    state.steps += 1
    intake.begin(state)
    state.epoch = plant.epoch
    state.clock.sync_seen = True
    state.clock.sync_arrival_ns = plant.epoch * plant.period_ns
    clock.synchronise(state.clock, 0)
    state.modes.requested = plant.operator.present
    _pass_up(plant, pieces, state, contract)
    compute(state, contract, compares, estimates)
    plant.epoch += 1
    _pass_down(plant, state, contract)


@compiled_with(nogil=True)
def run_epochs(
    plants: Records[Plant],
    pieces: Floats,
    ram: Records[Ram],
    contract: Records[Contract],
    compares: bool | None,
    estimates: bool | None,
    epochs: int,
    every: int,
    navigation: Records[NavigationOutput],
    truth: Records[Truth],
) -> int:
    """Run both sides over some epochs.

    Parameters
    ----------
    plants, pieces, ram, contract, compares, estimates
        As `hardware_step` and `firmware_step` take them.
    every : int
        Epochs that are a multiple of this and navigated are written down.
    truth : Records[Truth]
        Room for a row for each epoch that can be written down.

    Returns
    -------
    int
        Rows written.
    """
    plant, state, record = plants[0], ram[0], contract[0]
    rows = 0
    for _ in range(epochs):
        step_both(plant, pieces, state, record, compares, estimates)
        epoch = state.epoch
        if epoch % every == 0 and navigating(state):
            output(state)
            plant.epoch = epoch
            note_truth(plant, pieces)
            plant.epoch = epoch + 1
            navigation[rows] = state.navigation
            truth[rows] = plant.truth
            rows += 1
    return rows


def parts_beside(contract: Records[Contract], compares: bool | None) -> tuple[Beside, ...]:
    """Return what of `step_both` is to be compiled beside the rest."""
    hardware_part = Beside(advance, (Plant, array_of(float, 3), contract.dtype))
    return hardware_part, *step_parts_beside(contract, compares)


@dataclass(frozen=True)
class Track:
    """Results of a run: the same epochs of navigation and truth, oldest first."""

    navigation: Records[NavigationOutput]
    truth: Records[Truth]


class FastRun:
    """Both sides in memory, to be run over as many epochs as wanted.

    Parameters
    ----------
    pieces : array, shape (n, 15, 8)
        The vehicle's motion.
    every : int
        Epochs that are a multiple of this and navigated are kept.
    """

    def __init__(
        self, ram: Records[Ram], plant: Records[Plant], pieces: Floats, every: int = 1
    ) -> None:
        self.contract = load_contract()
        self.ram, self.plant, self.pieces = ram, plant, pieces
        self.every = every
        self.compares: bool | None = True if ram[0].redundancy.enabled else None
        self.estimates: bool | None = True if ram[0].estimator.enabled else None

    @classmethod
    def of(
        cls,
        firmware_settings: firmware.Settings,
        hardware_settings: hardware.Settings,
        every: int = 1,
    ) -> Self:
        """Return both sides just switched on, with settings as `runs.settings` makes them.

        The firmware's diagnostics are set up, for what they know of a sensor counts for redundancy.
        """
        return cls(
            Firmware(firmware_settings).ram,
            hardware.power_on(hardware_settings),
            hardware.pieces_of(hardware_settings),
            every,
        )

    def run(self, epochs: int) -> Track:
        """Go on by some epochs; other threads run meanwhile."""
        room = epochs // self.every + 1
        navigation = NavigationOutput.zeros(room)
        truth = Truth.zeros(room)
        with compiled_beside(*parts_beside(self.contract, self.compares)):
            rows = run_epochs(
                self.plant,
                self.pieces,
                self.ram,
                self.contract,
                self.compares,
                self.estimates,
                epochs,
                self.every,
                navigation,
                truth,
            )
        return Track(navigation[:rows], truth[:rows])
