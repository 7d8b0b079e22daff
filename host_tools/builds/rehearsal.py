"""A whole rehearsal as one function: both steps, and an observer's statistics of their frames."""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.record import F8, I8, Floats, Record, Records
from rrins.dbc.contract import Contract
from rrins.dbc.frame import FrameArray
from rrins.firmware_py.core.frames_in.clock import own_clock_ns
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.step import firmware_step
from rrins.host_tools.hardware.earth import metres_per_rad
from rrins.host_tools.hardware.memory import Plant, Truth
from rrins.host_tools.hardware.step import hardware_step
from rrins.host_tools.monitor.tally import Tally, count_frames

TRUTHS = 256
"""Epochs whose truth is kept: output of the firmware is compared with that of its own epoch."""


class TruthKept(Record):
    """The truth of an epoch."""

    truth: Truth
    north_m: F8  #: way of a rad of latitude there
    east_m: F8  #: way of a rad of longitude there


class Session(Record):
    """State between two calls."""

    count: I8  #: frames in the firmware's outbox
    clock_error_ppm: F8  #: of the firmware's clock


@compiled
def rehearse(
    plants: Records[Plant],
    pieces: Floats,
    ram: Records[Ram],
    contract: Records[Contract],
    tallies: Records[Tally],
    truths: Records[TruthKept],
    sessions: Records[Session],
    up: FrameArray,
    down: FrameArray,
    epochs: int,
    compares: bool | None,
    estimates: bool | None,
) -> int:
    """Run epochs of both sides; return the number of the next one.

    Parameters
    ----------
    plants, pieces, ram, contract
        As the steps take them.
    tallies : Records[Tally]
        Counts the frames of both sides.
    truths : Records[TruthKept]
        That of an epoch has the place of its number modulo the length.
    sessions : Records[Session]
    up, down : FrameArray
        Outboxes of the hardware and of the firmware.
    """
    plant, state, session = plants[0], ram[0], sessions[0]
    for _ in range(epochs):
        now_ns = plant.epoch * plant.period_ns
        sent = hardware_step(plants, pieces, contract, down, session["count"], up)
        kept = truths[plant.truth.epoch % len(truths)]
        kept["truth"] = plant.truth
        kept.north_m, kept.east_m = metres_per_rad(plant.truth.latitude, plant.truth.height)
        state.clock.sync_arrival_ns = own_clock_ns(now_ns, session.clock_error_ppm)
        state.clock.is_whole = True
        answered = firmware_step(ram, contract, up, 0, sent, down, compares, estimates)
        session["count"] = answered
        count_frames(tallies, up, sent, now_ns)
        count_frames(tallies, down, answered, now_ns)
    return plant.epoch
