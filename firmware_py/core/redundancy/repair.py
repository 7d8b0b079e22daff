"""Undoes what a faulty sensor did to the navigation before it was found.

Leaving sensor i out changes the fused vector by a constant times its residual: by how much that
turns the attitude and changes the velocity is summed over each second for every sensor, and kept
for some minutes. When a sensor is left out, the difference is carried through these seconds by the
error equations of the navigation, some seconds per epoch, and then added. Second-order terms are
the square of a turn of less than a thousandth.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled, compiled_with
from rrins.compiled.record import Floats
from rrins.firmware_py.core.aiding import wheel
from rrins.firmware_py.core.estimator import transition
from rrins.firmware_py.core.estimator.transition import CHANGE, LATITUDE, LONGITUDE, TURN, VELOCITY
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.redundancy_records import NAVIGATION_STATES, Repair
from rrins.firmware_py.core.redundancy import blocks

_BLOCKS_PER_EPOCH = 32
_SHARE_MORE, _SECONDS_MORE = 0.5, 4
"""By how much longer than the fault seems to last the history is repaired."""


@compiled
def order(repair: Repair, kind: int, sensor: int, seconds: float, share: float) -> None:
    """Order the repair of a fault that has lasted for `seconds`; it waits for one under way.

    `share` of what leaving out the sensor alone would have changed.
    """
    if repair.active:
        repair.waiting_s[kind, sensor] = seconds
        repair.waiting_share[kind, sensor] = share
    else:
        _begin(repair, kind, sensor, seconds, share)


@compiled
def longer(repair: Repair, seconds: float) -> int:
    """Return how many blocks back a fault may have begun that seems to last for `seconds`."""
    most = min(int(repair.count), int(repair.capacity) - 2)
    return min(int(seconds * (1.0 + _SHARE_MORE)) + _SECONDS_MORE, most)


@compiled
def _begin(repair: Repair, kind: int, sensor: int, seconds: float, share: float) -> None:
    repair.active = True
    repair.kind = kind
    repair.sensor = sensor
    repair.share = share
    repair.at = repair.count - longer(repair, seconds)
    for i in range(NAVIGATION_STATES):
        repair.x[i] = 0.0


@compiled
def carry(
    state: Ram, x: Floats, block: Floats, change: Floats, share: float, of_gyro: bool
) -> None:
    """Carry a difference x, shape (14,), through a block; `share` of the sensor's `change`."""
    repair, ins = state.redundancy.repair, state.ins
    others = repair.stride - blocks.OTHERS
    dt = block[others + blocks.TIME]
    if dt <= 0.0:
        return
    force = block[others + blocks.FORCE : others + blocks.FORCE + 3]
    way = block[others + blocks.WAY : others + blocks.WAY + 3]
    vertical = state.parameters.height_channel != strapdown.HEIGHT_HELD
    transition.fill(repair.response, force, way, dt, ins.latitude, ins.height, vertical)
    into = TURN if of_gyro else CHANGE
    for i in range(3):
        x[TURN + i] = 0.0
        x[CHANGE + i] = 0.0
    for i in range(3):
        x[into + i] = share * change[i]
    for i in range(NAVIGATION_STATES):
        total = 0.0
        for k in range(NAVIGATION_STATES):
            total += repair.response[i, k] * x[k]
        repair.work[i] = total
    for i in range(NAVIGATION_STATES):
        x[i] = repair.work[i]


@compiled
def _apply(state: Ram) -> None:
    """Add the difference to the navigation; where heights aid, the estimator does so upwards."""
    x, ins = state.redundancy.repair.x, state.ins
    if state.estimator.running and state.estimator.altimeter:
        x[VELOCITY + 2] = 0.0
    ins.latitude += x[LATITUDE]
    ins.longitude = earth.wrapped(ins.longitude + x[LONGITUDE])
    for i in range(3):
        ins.velocity_n[i] += x[VELOCITY + i]
    strapdown.turn(ins, x[:3])
    if state.odometer.interval_epochs > 0:
        wheel.turn_lever(state)


@compiled_with(is_unit=True)
def advance(state: Ram) -> None:
    """Carry the ordered repair on by some blocks; apply it once it is up to date."""
    repair = state.redundancy.repair
    of_gyro = repair.kind == 0
    place = 3 * (repair.sensor if of_gyro else state.gyros.count + repair.sensor)
    for _ in range(_BLOCKS_PER_EPOCH):
        if repair.at >= repair.count:
            break
        at = blocks.place(repair, repair.at)
        block = repair.blocks[at : at + repair.stride]
        carry(state, repair.x, block, block[place : place + 3], repair.share, of_gyro)
        repair.at += 1
    if repair.at < repair.count:
        return
    block = repair.block[: repair.stride]
    carry(state, repair.x, block, block[place : place + 3], repair.share, of_gyro)
    _apply(state)
    repair.active = False
    _begin_next(repair)


@compiled
def _begin_next(repair: Repair) -> None:
    """Begin a repair that waits, if one does."""
    for kind in range(repair.waiting_s.shape[0]):
        for sensor in range(repair.waiting_s.shape[1]):
            seconds = repair.waiting_s[kind, sensor]
            if seconds > 0.0:
                repair.waiting_s[kind, sensor] = 0.0
                _begin(repair, kind, sensor, seconds, repair.waiting_share[kind, sensor])
                return
