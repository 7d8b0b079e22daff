"""Start by transfer: what the master sent, carried from its time of validity to the start.

The increments of the last epochs are kept. A strapdown of its own begins with the latest transfer
and runs over them, some epochs in each step, until it has caught up with the present; from then on
it goes on in step. So neither the latency of the bus nor an alignment that ends late costs anything
but what the sensors' errors do meanwhile, and that is in the sigmas.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.maths.attitude import gimbal_matrix, matrix_of_euler
from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.records.initial_attitude import (
    LEAST_HEADING,
    LEAST_LEVEL,
    InitialAttitude,
)
from rrins.firmware_py.core.records.memory import INNER, OUTER, Ram
from rrins.firmware_py.core.records.transfer_records import INCREMENT_EPOCHS, Transfer

_TRANSFERRED = int(InitialAttitude.TRANSFERRED)

OLDEST_NS = 10_000_000_000
"""Age beyond which no navigation begins with a transfer: the sensors have not been aligned yet."""

PIECE_EPOCHS = 32
"""Epochs that are carried over in one step, at most: a step must not take long."""

NEVER = -2
"""Epoch of the rings that none has followed yet."""


@compiled
def is_wanted(state: Ram) -> bool:
    """Return whether the navigation begins with a transfer."""
    method = state.parameters.initial_attitude
    return bool(method == _TRANSFERRED)


@compiled
def begin(transfer: Transfer) -> None:
    """Start a new alignment: none is carried yet."""
    transfer.begun = False
    transfer.taken = 0


@compiled
def note(state: Ram) -> None:
    """Keep the increments of this epoch and the axes' angles at its end.

    What came before a gap in the epochs, or before a sensor was left out, is of no more use.
    """
    transfer, assembly = state.transfer, state.assembly
    left_out = state.redundancy.gyros.excluded | state.redundancy.accelerometers.excluded << 32
    if transfer.last + 1 != state.epoch or transfer.left_out != left_out:
        transfer.first = state.epoch
        transfer.left_out = left_out
        begin(transfer)
    transfer.last = state.epoch
    row = transfer.increments[state.epoch % INCREMENT_EPOCHS]
    for i in range(3):
        row[i] = state.dtheta_s[i]
        row[3 + i] = state.dv_s[i]
    angle = transfer.axis_angle[state.epoch % INCREMENT_EPOCHS]
    angle[INNER] = math.radians(assembly.encoder_angle_deg[INNER])
    angle[OUTER] = math.radians(assembly.encoder_angle_deg[OUTER])


@compiled
def carry(state: Ram) -> bool:
    """Carry the latest transfer on; return whether it has reached the end of this epoch."""
    transfer, master = state.transfer, state.master
    oldest = max(int(transfer.first), int(transfer.last) - INCREMENT_EPOCHS + 1)
    if master.transfers != transfer.taken and oldest <= master.epoch:
        _take(state)
    if master.age_epochs * state.parameters.period_ns > OLDEST_NS:
        transfer.begun = False
    if not transfer.begun:
        return False
    dt = state.parameters.period_ns * 1e-9
    for _ in range(min(PIECE_EPOCHS, int(state.epoch - transfer.epoch))):
        transfer.epoch += 1
        row = transfer.increments[transfer.epoch % INCREMENT_EPOCHS]
        strapdown.update(state.carried, row[:3], row[3:], dt, strapdown.HEIGHT_FREE)
    return bool(transfer.epoch == state.epoch)


@compiled
def _take(state: Ram) -> None:
    """Begin with the latest transfer, at the end of the epoch in which it was valid."""
    transfer, master, ins = state.transfer, state.master, state.carried
    at = master.epoch % INCREMENT_EPOCHS
    angle, row = transfer.axis_angle[at], transfer.increments[at]
    C_b_n, C_s_b = transfer.C_b_n, transfer.C_s_b
    gimbal_matrix(C_s_b, angle[INNER], angle[OUTER])
    matrix_of_euler(C_b_n, master.roll, master.pitch, master.heading)
    for i in range(3):
        for j in range(3):
            transfer.C_s_n[i, j] = (
                C_b_n[i, 0] * C_s_b[0, j] + C_b_n[i, 1] * C_s_b[1, j] + C_b_n[i, 2] * C_s_b[2, j]
            )
    strapdown.initialise(ins, transfer.C_s_n, master.latitude, master.longitude, master.height)
    for i in range(3):
        ins.velocity_n[i] = master.velocity_n[i]
    share = master.before_end_ns / state.parameters.period_ns
    if share > 0.0:
        for i in range(3):
            transfer.partial[0, i] = share * row[i]
            transfer.partial[1, i] = share * row[3 + i]
        seconds = master.before_end_ns * 1e-9
        dtheta_s, dv_s = transfer.partial[0], transfer.partial[1]
        strapdown.update(ins, dtheta_s, dv_s, seconds, strapdown.HEIGHT_FREE)
        ins.first = True  # a partial epoch cannot serve as the previous one
    transfer.begun = True
    transfer.taken = master.transfers
    transfer.epoch = master.epoch


@compiled
def write_attitude(state: Ram) -> None:
    """Write the attitude of the sensors at the end of this epoch to the alignment."""
    for i in range(3):
        for j in range(3):
            state.alignment.C_s_n[i, j] = state.carried.C_s_n[i, j]


@compiled
def set_in_motion(state: Ram) -> None:
    """Let the navigation begin with the carried velocity and position, the filter with its sigmas.

    The sigmas are those that the master told, and what they and the sensors' biases have added
    since.
    """
    ins, carried = state.ins, state.carried
    for i in range(3):
        ins.velocity_n[i] = carried.velocity_n[i]
    ins.latitude = carried.latitude
    ins.longitude = carried.longitude
    ins.height = carried.height
    ins.reference_height = carried.height
    master, estimator = state.master, state.estimator
    age_s = master.age_epochs * state.parameters.period_ns * 1e-9
    turned = estimator.bias_sigma[0] * age_s
    level = math.hypot(master.level_sigma, turned)
    heading = math.hypot(master.heading_sigma, turned)
    pulled = math.hypot(estimator.bias_sigma[1], earth.GRAVITY_EQUATOR * level) * age_s
    velocity = math.hypot(master.velocity_sigma, pulled)
    position = math.hypot(master.position_sigma, velocity * age_s)
    estimator.attitude_sigma[0] = max(level, LEAST_LEVEL)
    estimator.attitude_sigma[1] = max(level, LEAST_LEVEL)
    estimator.attitude_sigma[2] = max(heading, LEAST_HEADING)
    estimator.velocity_sigma = max(velocity, estimator.zero_velocity_sigma)
    estimator.start_sigma = max(position, estimator.position_sigma)
