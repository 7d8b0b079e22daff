"""References of velocity: the navigation's difference from them, kept in the block of their time.

A GNSS fix arrives after the fact; the velocity that was navigated is looked up by its epoch. So is
the way of the odometer's wheel between two counts.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.aiding import antenna, wheel
from rrins.firmware_py.core.maths.vectors import copy
from rrins.firmware_py.core.records.memory import WHEEL_EPOCHS, Ram
from rrins.firmware_py.core.records.redundancy_records import VELOCITY_EPOCHS, Repair
from rrins.firmware_py.core.redundancy import blocks

_LEAST_SIGMA = 0.01
"""m/s, of a component: a receiver that promises more is not believed."""

_BACK = 3
"""Blocks before the present one in which a measurement may have been valid."""


@compiled
def begin(state: Ram) -> None:
    """Begin anew with the navigation."""
    bank = state.redundancy.bank
    bank.velocity_first = state.epoch - 1
    bank.velocity_last = state.epoch - 2
    bank.fix_waits = False
    bank.count_waits = False
    bank.stretch_epoch = -1
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
    copy(bank.velocity_n[last % VELOCITY_EPOCHS], ins.velocity_n)
    if gnss.fresh:
        bank.fix_waits = True
        bank.fix_epoch = gnss.epoch
        bank.fix_variance = max(gnss.velocity_sigma, _LEAST_SIGMA) ** 2
        copy(bank.fix_velocity_n, gnss.velocity_n)
    if bank.fix_waits and bank.fix_epoch <= last:
        bank.fix_waits = False
        is_known = bank.fix_epoch >= max(bank.velocity_first, last - VELOCITY_EPOCHS + 1)
        if is_known and _refer(state):
            _keep(state)
    if state.odometer.interval_epochs > 0:
        _follow_odometer(state, last)


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
    bank.fix_velocity_n -= place.velocity_n
    return True


@compiled
def _keep(state: Ram) -> None:
    """Keep the difference in its block, unless that has one already."""
    bank, repair = state.redundancy.bank, state.redundancy.repair
    block = _block_of(repair, bank.fix_epoch)
    others = repair.stride - blocks.OTHERS
    if block.shape[0] == 0 or block[others + blocks.VARIANCE] != 0.0:
        return
    after = bank.fix_epoch - block[others + blocks.BEGUN]
    block[others + blocks.VARIANCE] = bank.fix_variance
    block[others + blocks.MEASURED_AFTER] = after * state.parameters.period_ns * 1e-9
    navigated = bank.velocity_n[bank.fix_epoch % VELOCITY_EPOCHS]
    for i in range(3):
        block[others + blocks.MEASURED + i] = bank.fix_velocity_n[i] - navigated[i]


@compiled
def _block_of(repair: Repair, epoch: int) -> Floats:
    """Return the block that an epoch ends in; an empty one if it is not kept any more."""
    others = repair.stride - blocks.OTHERS
    for back in range(_BACK + 1):
        index = repair.count - back
        if index < max(0, repair.count - repair.capacity + 1):
            break
        block = repair.block[: repair.stride]
        if back > 0:
            at = blocks.place(repair, index)
            block = repair.blocks[at : at + repair.stride]
        if epoch > block[others + blocks.BEGUN]:
            return block
    return repair.block[:0]


@compiled
def _follow_odometer(state: Ram, last: int) -> None:
    """Keep the stretch that ends with a count, once the navigation has reached that."""
    bank, odometer = state.redundancy.bank, state.odometer
    if odometer.fresh and not bank.count_waits:
        bank.count_waits = True
        bank.count_epoch = odometer.epoch
        bank.count_travelled = odometer.travelled
        bank.count_gaps = odometer.gaps
    if not bank.count_waits or bank.count_epoch > last:
        return
    bank.count_waits = False
    before, now = bank.stretch_epoch, bank.count_epoch
    is_whole = before >= 0 and bank.stretch_gaps == bank.count_gaps
    is_whole = is_whole and wheel.is_known(state.wheel, before) and wheel.is_known(state.wheel, now)
    if is_whole and now - before < state.redundancy.second_epochs:
        return
    if is_whole:
        _keep_stretch(state)
    bank.stretch_epoch = now
    bank.stretch_travelled = bank.count_travelled
    bank.stretch_gaps = bank.count_gaps


@compiled
def _keep_stretch(state: Ram) -> None:
    """Keep a stretch in the block of its middle."""
    bank, repair = state.redundancy.bank, state.redundancy.repair
    dt = state.parameters.period_ns * 1e-9
    before, now = bank.stretch_epoch, bank.count_epoch
    seconds = (now - before) * dt
    block = _block_of(repair, (before + now) // 2)
    if block.shape[0] == 0 or seconds > wheel.LONGEST_S:
        return
    stretch = block[repair.stride - blocks.OTHERS :]
    track = state.wheel.track
    end, start = track[now % WHEEL_EPOCHS], track[before % WHEEL_EPOCHS]
    for k in range(3):
        stretch[blocks.STRETCH_WAY + k] = end[wheel.WAY + k] - start[wheel.WAY + k]
        stretch[blocks.STRETCH_LEVER_WAY + k] = (
            end[wheel.LEVER_WAY + k] - start[wheel.LEVER_WAY + k]
        )
    for k in range(9):
        at = wheel.ATTITUDE_B + k
        stretch[blocks.STRETCH_ATTITUDE + k] = end[at] - start[at]
    travelled = bank.count_travelled - bank.stretch_travelled
    way_b = stretch[blocks.STRETCH_WAY : blocks.STRETCH_WAY + 3]
    turned = end[wheel.TURNED_B] - start[wheel.TURNED_B]
    slip = wheel.slip_sigma(travelled, way_b, turned, seconds)
    stretch[blocks.STRETCH_AFTER] = (0.5 * (before + now) - stretch[blocks.BEGUN]) * dt
    stretch[blocks.STRETCH_S] = seconds
    stretch[blocks.TRAVELLED] = travelled
    stretch[blocks.DISTANCE_VARIANCE] = wheel.distance_sigma(state.odometer, dt, seconds) ** 2
    stretch[blocks.SLIP_VARIANCE] = slip**2
