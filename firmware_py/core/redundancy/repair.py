"""Undoes what a faulty sensor did to the navigation before it was found.

Leaving sensor i out changes the fused vector by a constant times its residual: by how much that
turns the attitude and changes the velocity is summed over each second for every sensor, and kept
for some minutes. When a sensor is left out, the difference is carried through these seconds by the
error equations of the navigation, Groves (2nd ed., 2013), section 14.2.4, some seconds per epoch,
and then added. Second-order terms are the square of a turn of less than a thousandth.
"""

from __future__ import annotations

import math

from rrins.dbc.compilation import compiled
from rrins.dbc.record import Floats
from rrins.firmware_py.core import earth, strapdown
from rrins.firmware_py.core.attitude import (
    cross,
    matrix_of_quaternion,
    multiply,
    normalise,
    quaternion_of_vector,
)
from rrins.firmware_py.core.memory import Fusion, Ins, Ram
from rrins.firmware_py.core.redundancy_records import BLOCK_FLOATS, LONGEST_S, Parity, Repair

_BLOCKS_PER_EPOCH = 64
_SHARE_MORE, _SECONDS_MORE = 0.5, 4
"""By how much longer than the fault seems to last the history is repaired."""

_FORCE, _VELOCITY, _TIME, _OTHER = 0, 3, 6, 7  # behind the sensors in a block


@compiled
def begin(repair: Repair, gyros: int, accelerometers: int) -> None:
    """Begin the history, for these numbers of sensors."""
    repair.stride = 3 * (gyros + accelerometers) + _OTHER
    repair.capacity = min(LONGEST_S + 64, BLOCK_FLOATS // repair.stride)
    repair.count = 0
    repair.active = False
    _clear(repair)


@compiled
def _clear(repair: Repair) -> None:
    for k in range(repair.stride):
        repair.block[k] = 0.0


@compiled
def note(
    repair: Repair, C_s_n: Floats, fusion: Fusion, parity: Parity, first: int, work: Floats
) -> None:
    """Add what leaving out each sensor of a kind would change in this epoch.

    `first` is the place of the kind in a block; `work` is scratch of shape (3,).
    """
    for k in range(fusion.count):
        unlearned = parity.unlearned[k]
        if parity.sensors >> k & 1 == 0:
            continue
        for i in range(3):
            work[i] = parity.leave_out[k, i] * unlearned
        at = first + 3 * k
        for i in range(3):
            repair.block[at + i] += (
                C_s_n[i, 0] * work[0] + C_s_n[i, 1] * work[1] + C_s_n[i, 2] * work[2]
            )


@compiled
def note_motion(repair: Repair, ins: Ins, dv_s: Floats, dt: float) -> None:
    """Add the epoch's specific force, velocity and time, behind the sensors."""
    C_s_n, others = ins.C_s_n, repair.stride - _OTHER
    for i in range(3):
        repair.block[others + _FORCE + i] += (
            C_s_n[i, 0] * dv_s[0] + C_s_n[i, 1] * dv_s[1] + C_s_n[i, 2] * dv_s[2]
        )
        repair.block[others + _VELOCITY + i] += ins.velocity_n[i] * dt
    repair.block[others + _TIME] += dt


@compiled
def close_block(repair: Repair) -> None:
    """Keep the present block, and begin the next."""
    at = repair.count % repair.capacity * repair.stride
    for k in range(repair.stride):
        repair.blocks[at + k] = repair.block[k]
    repair.count += 1
    _clear(repair)


@compiled
def order(repair: Repair, kind: int, sensor: int, seconds: float) -> None:
    """Order the repair of a fault that has lasted for `seconds`."""
    longer = int(seconds * (1.0 + _SHARE_MORE)) + _SECONDS_MORE
    longer = min(longer, repair.count, repair.capacity - 2)
    repair.active = True
    repair.kind = kind
    repair.sensor = sensor
    repair.at = repair.count - longer
    repair.dlatitude = 0.0
    repair.dlongitude = 0.0
    for i in range(3):
        repair.psi_n[i] = 0.0
        repair.dv_n[i] = 0.0


@compiled
def _carry(state: Ram, block: Floats, change: Floats, of_gyro: bool) -> None:
    """Carry the difference through a block; `change` is that of the sensor."""
    repair, ins = state.redundancy.repair, state.ins
    psi, dv = repair.psi_n, repair.dv_n
    others = repair.stride - _OTHER
    dt = block[others + _TIME]
    if dt <= 0.0:
        return
    force, omega, turned = repair.work[0], repair.work[1], repair.work[2]
    meridian, prime_vertical = earth.radii(ins.latitude)
    north_radius, east_radius = meridian + ins.height, prime_vertical + ins.height
    cosine, sine = math.cos(ins.latitude), math.sin(ins.latitude)
    east, north = block[others + _VELOCITY] / dt, block[others + _VELOCITY + 1] / dt
    omega[0] = -north / north_radius
    omega[1] = earth.RATE * cosine + east / east_radius
    omega[2] = earth.RATE * sine + east / east_radius * sine / cosine
    share = 1.0 if of_gyro else 0.0
    for i in range(3):
        force[i] = block[others + _FORCE + i]
        turned[i] = psi[i] + 0.5 * share * change[i]
    cross(repair.work[3], turned, force)
    dv_east, dv_north, dv_up = dv[0], dv[1], dv[2]
    for i in range(3):
        dv[i] += repair.work[3][i] + (1.0 - share) * change[i]
    # Coriolis, with 2 ω_ie + ω_en
    omega_n, omega_u = omega[1] + earth.RATE * cosine, omega[2] + earth.RATE * sine
    dv[0] -= (omega_n * dv_up - omega_u * dv_north) * dt
    dv[1] -= (omega_u * dv_east - omega[0] * dv_up) * dt
    dv[2] -= (omega[0] * dv_north - omega_n * dv_east) * dt
    if state.parameters.height_channel == strapdown.HEIGHT_HELD:
        dv[2] = 0.0
    middle_east, middle_north = 0.5 * (dv_east + dv[0]), 0.5 * (dv_north + dv[1])
    cross(turned, omega, psi)
    dlatitude = repair.dlatitude
    psi[0] += share * change[0] - turned[0] * dt + middle_north / north_radius * dt
    psi[1] += (
        share * change[1]
        - turned[1] * dt
        - (middle_east / east_radius - earth.RATE * sine * dlatitude) * dt
    )
    psi[2] += (
        share * change[2]
        - turned[2] * dt
        - (middle_east / east_radius * sine / cosine + earth.RATE * cosine * dlatitude) * dt
    )
    repair.dlatitude += middle_north / north_radius * dt
    repair.dlongitude += middle_east / (east_radius * cosine) * dt


@compiled
def _apply(state: Ram) -> None:
    """Add the difference to the navigation."""
    repair, ins = state.redundancy.repair, state.ins
    ins.latitude += repair.dlatitude
    ins.longitude = (ins.longitude + repair.dlongitude + math.pi) % (2.0 * math.pi) - math.pi
    for i in range(3):
        ins.velocity_n[i] += repair.dv_n[i]
    turn, product = ins.work_q[0], ins.work_q[1]
    quaternion_of_vector(turn, repair.psi_n)
    multiply(product, turn, ins.q_s_n)
    for i in range(4):
        ins.q_s_n[i] = product[i]
    normalise(ins.q_s_n)
    matrix_of_quaternion(ins.C_s_n, ins.q_s_n)


@compiled
def advance(state: Ram) -> None:
    """Carry the ordered repair on by some blocks; apply it once it is up to date."""
    repair = state.redundancy.repair
    of_gyro = repair.kind == 0
    place = 3 * (repair.sensor if of_gyro else state.gyros.count + repair.sensor)
    for _ in range(_BLOCKS_PER_EPOCH):
        if repair.at >= repair.count:
            break
        at = repair.at % repair.capacity * repair.stride
        block = repair.blocks[at : at + repair.stride]
        _carry(state, block, block[place : place + 3], of_gyro)
        repair.at += 1
    if repair.at < repair.count:
        return
    block = repair.block[: repair.stride]
    _carry(state, block, block[place : place + 3], of_gyro)
    _apply(state)
    repair.active = False
