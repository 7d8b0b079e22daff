"""The reference of velocity: the navigation's difference from it, kept in the block of its time.

A GNSS fix arrives after the fact; the velocity that was navigated is looked up by its epoch.
"""

from __future__ import annotations

from rrins.dbc.compilation import compiled
from rrins.firmware_py.core import antenna
from rrins.firmware_py.core.memory import Ram
from rrins.firmware_py.core.redundancy import blocks
from rrins.firmware_py.core.redundancy_records import VELOCITY_EPOCHS

_LEAST_SIGMA = 0.01
"""m/s, of a component: a receiver that promises more is not believed."""

_BACK = 3
"""Blocks before the present one in which a fix may have been valid."""


@compiled
def begin(state: Ram) -> None:
    """Begin anew with the navigation."""
    bank = state.redundancy.bank
    bank.velocity_first = state.epoch - 1
    bank.velocity_last = state.epoch - 2
    bank.fix_waits = False
    bank.active = False
    bank.first = 0


@compiled
def follow(state: Ram) -> None:
    """Note the velocity of the epoch before, and where a fix is, its difference from that."""
    bank, gnss, ins = state.redundancy.bank, state.gnss, state.ins
    last = state.epoch - 1
    if bank.velocity_last + 1 != last:  # an epoch was left out
        bank.velocity_first = last
    bank.velocity_last = last
    for i in range(2):
        bank.velocity_n[last % VELOCITY_EPOCHS, i] = ins.velocity_n[i]
    if gnss.fresh:
        bank.fix_waits = True
        bank.fix_epoch = gnss.epoch
        bank.fix_variance = max(gnss.velocity_sigma, _LEAST_SIGMA) ** 2
        for i in range(2):
            bank.fix_velocity_n[i] = gnss.velocity_n[i]
    if bank.fix_waits and bank.fix_epoch <= last:
        bank.fix_waits = False
        is_known = bank.fix_epoch >= max(bank.velocity_first, last - VELOCITY_EPOCHS + 1)
        if is_known and _refer(state):
            _keep(state)


@compiled
def _refer(state: Ram) -> bool:
    """Refer the fix to the reference point; return whether the antenna's place was known."""
    bank, place = state.redundancy.bank, state.antenna
    if not place.present:
        return True
    if not antenna.is_known(place, bank.fix_epoch):
        return False
    dt = state.parameters.period_ns * 1e-9
    antenna.velocity(place, bank.fix_epoch, dt, place.velocity_n)
    for i in range(2):
        bank.fix_velocity_n[i] -= place.velocity_n[i]
    return True


@compiled
def _keep(state: Ram) -> None:
    """Keep the difference in its block, unless that has one already."""
    bank, repair = state.redundancy.bank, state.redundancy.repair
    others = repair.stride - blocks.OTHERS
    for back in range(_BACK + 1):
        index = repair.count - back
        if index < max(0, repair.count - repair.capacity + 1):
            return
        block = repair.block[: repair.stride]
        if back > 0:
            at = blocks.place(repair, index)
            block = repair.blocks[at : at + repair.stride]
        after = bank.fix_epoch - block[others + blocks.BEGUN]
        if after > 0:
            if block[others + blocks.VARIANCE] == 0.0:
                block[others + blocks.VARIANCE] = bank.fix_variance
                block[others + blocks.MEASURED_AFTER] = after * state.parameters.period_ns * 1e-9
                navigated = bank.velocity_n[bank.fix_epoch % VELOCITY_EPOCHS]
                for i in range(2):
                    reference = bank.fix_velocity_n[i]
                    block[others + blocks.MEASURED + i] = reference - navigated[i]
            return
