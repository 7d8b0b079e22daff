"""The functions of a build under their names in C."""

from __future__ import annotations

from types import NoneType

from rrins.compiled.object_code import Argument, Entry
from rrins.dbc.contract import load_contract
from rrins.dbc.frame import Frame
from rrins.firmware_py.core.frames_out.transmit import OUTBOX_CAPACITY
from rrins.firmware_py.core.step import firmware_step
from rrins.firmware_py.core.turntable.table_sums import TableSums
from rrins.host_tools.builds import derived
from rrins.host_tools.builds.rehearsal import TRUTHS, Session, TruthKept, rehearse
from rrins.host_tools.builds.variants import Variant
from rrins.host_tools.hardware import step as hardware
from rrins.host_tools.hardware.memory import MOTION_CHANNELS, MOTION_TERMS, Plant
from rrins.host_tools.monitor.tally import Tally

FIRMWARE_OUTBOX, HARDWARE_OUTBOX = OUTBOX_CAPACITY, hardware.OUTBOX_CAPACITY


def firmware_entry(variant: Variant) -> Entry:
    """Return ``int rrins_firmware_step(ram, contract, inbox, count, outbox)``."""
    return Entry(
        "rrins_firmware_step",
        firmware_step,
        (
            Argument("ram", variant.memory, (1,)),
            Argument("contract", load_contract().dtype, (1,)),
            Argument("inbox", Frame.dtype, ("count",)),
            Argument("", int, value=0),
            Argument("count", int),
            Argument("outbox", Frame.dtype, (FIRMWARE_OUTBOX,)),
            _choice(variant.compares),
            _choice(variant.estimates),
        ),
    )


def diagnostic_entries(variant: Variant) -> tuple[Entry, ...]:
    """Return what diagnostics in C call beside the step."""
    ram, sums = Argument("ram", variant.memory, (1,)), Argument("sums", TableSums.dtype, (1,))
    return (
        Entry(
            "rrins_firmware_derive",
            derived.derive,
            (ram, Argument("found", float, (len(derived.DERIVED),))),
        ),
        Entry(
            "rrins_firmware_set_attitude",
            derived.set_attitude,
            (ram, Argument("angles", float, (3,))),
        ),
        Entry("rrins_firmware_watch", derived.watch, (ram,)),
        Entry("rrins_firmware_add_sums", derived.add_sums, (ram, sums)),
        Entry("rrins_firmware_begin_sums", derived.begin_sums, (sums,)),
    )


def hardware_entry() -> Entry:
    """Return ``int rrins_hardware_step(plant, motion, pieces, contract, inbox, count, outbox)``."""
    return Entry(
        "rrins_hardware_step",
        hardware.hardware_step,
        (
            Argument("plant", Plant.dtype, (1,)),
            Argument("motion", float, ("pieces", MOTION_CHANNELS, MOTION_TERMS)),
            Argument("contract", load_contract().dtype, (1,)),
            Argument("inbox", Frame.dtype, ("count",)),
            Argument("count", int),
            Argument("outbox", Frame.dtype, (HARDWARE_OUTBOX,)),
        ),
    )


def rehearsal_entry(variant: Variant) -> Entry:
    """Return ``int rrins_rehearse(plant, motion, pieces, ram, …, epochs)``: the next epoch."""
    return Entry(
        "rrins_rehearse",
        rehearse,
        (
            Argument("plant", Plant.dtype, (1,)),
            Argument("motion", float, ("pieces", MOTION_CHANNELS, MOTION_TERMS)),
            Argument("ram", variant.memory, (1,)),
            Argument("contract", load_contract().dtype, (1,)),
            Argument("tally", Tally.dtype, (1,)),
            Argument("truths", TruthKept.dtype, (TRUTHS,)),
            Argument("session", Session.dtype, (1,)),
            Argument("up", Frame.dtype, (HARDWARE_OUTBOX,)),
            Argument("down", Frame.dtype, (FIRMWARE_OUTBOX,)),
            Argument("epochs", int),
            _choice(variant.compares),
            _choice(variant.estimates),
        ),
    )


def _choice(is_chosen: bool) -> Argument:
    """Return what a step takes for a part that is compiled in, or left out."""
    return Argument("", bool, value=1) if is_chosen else Argument("", NoneType)


def entries_of(unit: str, variant: Variant) -> tuple[Entry, ...]:
    """Return the entries of a unit: an object of its own."""
    return {
        "firmware": (firmware_entry(variant), *diagnostic_entries(variant)),
        "hardware": (hardware_entry(),),
        "rehearsal": (rehearsal_entry(variant),),
    }[unit]
