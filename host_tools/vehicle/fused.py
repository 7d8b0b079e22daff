"""The fused increments of a run, with navigation and truth of the same epochs.

They are what the firmware's strapdown navigation takes: calibrated, fused to three axes of the
sensor frame, an epoch's gaps bridged.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from rrins.compiled.compilation import compiled, compiled_with
from rrins.compiled.compiled_beside import compiled_beside
from rrins.compiled.record import F8, I8, Bool, Floats, Record, Records
from rrins.dbc.contract import Contract
from rrins.firmware_py.core.modes.modes import navigating
from rrins.firmware_py.core.records.memory import INNER, OUTER, NavigationOutput, Ram
from rrins.firmware_py.core.step import output
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.hardware.memory import Plant, Truth
from rrins.host_tools.hardware.step import note_truth
from rrins.host_tools.runs.fast import FastRun, parts_beside, step_both
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    hardware_settings,
    scenario_wire,
)
from rrins.host_tools.scenario.scenario import Scenario

PIECE_S = 20
"""Seconds of a run that are handed over at a time."""


class FusedIncrements(Record):
    """The fused increments of one epoch, and the angles of the table at its end."""

    epoch: I8  #: number of the epoch
    bridged: Bool  #: whether the increments are those of the epoch before
    dtheta_s: Annotated[Floats, 3]  #: rad
    dv_s: Annotated[Floats, 3]  #: m/s
    inner_deg: F8  #: ° by the encoder
    outer_deg: F8  #: ° by the encoder


@dataclass(frozen=True)
class FusedTrack:
    """Increments, navigation and truth of the same epochs, one row each, oldest first."""

    increments: Records[FusedIncrements]
    navigation: Records[NavigationOutput]
    truth: Records[Truth] | None  #: None where nobody knows it

    def first(self, count: int) -> FusedTrack:
        """Return the first rows."""
        truth = None if self.truth is None else self.truth[:count]
        return FusedTrack(self.increments[:count], self.navigation[:count], truth)


@compiled
def note_increments(row: FusedIncrements, state: Ram) -> None:
    """Write the increments of the firmware's last epoch to a row."""
    row.epoch = state.epoch
    row.bridged = state.faults.consecutive_bridged > 0
    for i in range(3):
        row.dtheta_s[i] = state.dtheta_s[i]
        row.dv_s[i] = state.dv_s[i]
    row.inner_deg = state.assembly.encoder_angle_deg[INNER]
    row.outer_deg = state.assembly.encoder_angle_deg[OUTER]


@compiled_with(nogil=True)
def _run_epochs(
    plants: Records[Plant],
    pieces: Floats,
    ram: Records[Ram],
    contract: Records[Contract],
    compares: bool | None,
    estimates: bool | None,
    epochs: int,
    increments: Records[FusedIncrements],
    navigation: Records[NavigationOutput],
    truth: Records[Truth],
) -> int:
    """Run both sides over some epochs; write those navigated; return how many rows."""
    plant, state, record = plants[0], ram[0], contract[0]
    rows = 0
    for _ in range(epochs):
        step_both(plant, pieces, state, record, compares, estimates)
        if not navigating(state):
            continue
        output(state)
        plant.epoch = state.epoch
        note_truth(plant, pieces)
        plant.epoch = state.epoch + 1
        note_increments(increments[rows], state)
        navigation[rows] = state.navigation
        truth[rows] = plant.truth
        rows += 1
    return rows


def switched_on(scenario: Scenario) -> FastRun:
    """Return both sides of a scenario that can be run without frames.

    Raises
    ------
    RehearsalError
        When the scenario has faults or timing of the wire, which need frames.
    ScenarioError, MotionError
        When a file that the scenario names cannot be used.
    """
    if scenario_wire(scenario) is not None:
        raise RehearsalError(
            "increments: faults or timing of the wire need frames; rehearse the scenario with "
            "--record FILE, then give that file"
        )
    return FastRun.of(firmware_settings(scenario), hardware_settings(scenario))


def fused_of_scenario(scenario: Scenario) -> Iterator[FusedTrack]:
    """Run a scenario without frames; yield the epochs navigated, some seconds at a time.

    The first row is the last epoch before navigation: its state is the initial one.

    Raises as `switched_on` does.
    """
    run = switched_on(scenario)
    left = scenario.epochs + 1
    while left:
        epochs = min(left, PIECE_S * scenario.rate_hz)
        left -= epochs
        increments = FusedIncrements.zeros(epochs)
        navigation = NavigationOutput.zeros(epochs)
        truth = Truth.zeros(epochs)
        with compiled_beside(*parts_beside(run.contract, run.compares)):
            rows = _run_epochs(
                run.plant,
                run.pieces,
                run.ram,
                run.contract,
                run.compares,
                run.estimates,
                epochs,
                increments,
                navigation,
                truth,
            )
        if rows:
            yield FusedTrack(increments[:rows], navigation[:rows], truth[:rows])


def without_gaps(tracks: Iterable[FusedTrack]) -> Iterator[FusedTrack]:
    """Pass tracks on up to the first epoch that is missing."""
    last: int | None = None
    for track in tracks:
        epochs = track.increments["epoch"]
        before = int(epochs[0]) - 1 if last is None else last
        jumps = np.flatnonzero(np.diff(epochs, prepend=before) != 1)
        if len(jumps):
            if jumps[0]:
                yield track.first(int(jumps[0]))
            return
        last = int(epochs[-1])
        yield track
