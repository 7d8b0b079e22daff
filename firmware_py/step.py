"""One epoch of the firmware: frames in, navigation and axis commands out.

``intake -> fusion -> mode (alignment or strapdown) -> rotation scheme -> output -> frames``.
No clock, socket, thread, file or allocation; all state is the RAM image.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dbc.frame import FrameArray
from firmware_py import alignment, clock, earth, intake, modes, sequencer, strapdown
from firmware_py.attitude import euler_of_matrix, gimbal_matrix, multiply_transposed
from firmware_py.diagnostics import monitor, orders
from firmware_py.fusion import compensate, fuse
from firmware_py.memory import INNER, OUTER
from firmware_py.modes import Fault, Mode
from firmware_py.transmit import transmit


@njit(cache=True)
def _fuse(state: Any) -> None:
    """Fuse gyros and accelerometers, or bridge by the increments of the epoch before."""
    assembly, faults, work = state.assembly, state.faults, state.ins.work
    if state.gyros.calibrated:
        compensate(state.gyros, assembly.received, assembly.gyro_dtheta)
    if state.accelerometers.calibrated:
        compensate(state.accelerometers, assembly.received, assembly.accelerometer_dv)
    gyros = fuse(state.gyros, assembly.gyro_valid, assembly.gyro_dtheta, state.dtheta_s, work)
    accelerometers = fuse(
        state.accelerometers,
        assembly.accelerometer_valid,
        assembly.accelerometer_dv,
        state.dv_s,
        work,
    )
    if gyros and accelerometers:
        faults.consecutive_bridged = 0
    elif state.clock.synchronised:
        faults.bridged_epochs += 1
        faults.consecutive_bridged += 1


@njit(cache=True)
def _align(state: Any, contract: Any) -> None:
    parameters, work = state.parameters, state.ins.work
    if state.alignment.epochs < parameters.alignment_epochs:
        alignment.accumulate(state.alignment, state.dtheta_s, state.dv_s)
        if state.alignment.epochs < parameters.alignment_epochs:
            return
        if parameters.self_aligned:
            gravity = earth.gravity(parameters.latitude, parameters.height)
            alignment.find(state.alignment, parameters.period_ns * 1e-9, gravity, work)
        else:
            alignment.take_given(state.alignment, parameters.C_b_n, state.C_s_b)
        if state.alignment.done:
            resolution = contract.sensor[0].gyro_dtheta.scale
            alignment.take_held_back(state.alignment, resolution, work)
    if state.alignment.failed:
        modes.fail(state, Fault.ALIGNMENT_FAILED)
    elif state.modes.pending != Mode.ALIGNMENT:
        modes.enter(state, state.modes.pending)


@njit(cache=True)
def _refer_height(state: Any) -> None:
    """Tell the vertical channel what it may hold on to in this epoch."""
    parameters, ins, assembly = state.parameters, state.ins, state.assembly
    state.altimeter_epochs += 1
    ins.reference_interval = 0.0
    if not parameters.altimeter:
        ins.reference_interval = parameters.period_ns * 1e-9
    elif assembly.altimeter_received:
        ins.reference_interval = state.altimeter_epochs * parameters.period_ns * 1e-9
        ins.reference_height = assembly.altimeter_height
        state.altimeter_epochs = 0


@njit(cache=True)
def _navigate(state: Any) -> None:
    parameters = state.parameters
    _refer_height(state)
    strapdown.update(
        state.ins,
        state.dtheta_s,
        state.dv_s,
        parameters.period_ns * 1e-9,
        parameters.height_channel,
    )
    if state.faults.consecutive_bridged > parameters.bridge_epochs:
        modes.fail(state, Fault.SENSORS_LOST)
    elif not modes.plausible(state.ins):
        modes.fail(state, Fault.NAVIGATION_DIVERGED)


@njit(cache=True)
def _rotate(state: Any) -> None:
    """Go on in the scheme; fall back to strapdown when an axis does not follow."""
    if sequencer.watch(state.sequencer, state.parameters, state.assembly):
        modes.enter(state, Mode.NAVIGATION_STRAPDOWN)
    else:
        sequencer.advance(state.sequencer, state.parameters)


@njit(cache=True)
def _run_mode(state: Any, contract: Any) -> None:
    state.modes.epochs += 1
    mode = state.modes.mode
    if mode == Mode.POWER_ON:
        modes.enter(state, Mode.SELF_TEST)
    elif mode == Mode.SELF_TEST:
        modes.self_test(state)
    elif mode == Mode.STANDBY:
        modes.standby(state)
    elif mode == Mode.ALIGNMENT:
        _align(state, contract)
    elif mode in (Mode.NAVIGATION_STRAPDOWN, Mode.NAVIGATION_ROTATING):
        _navigate(state)
    if state.modes.mode == Mode.NAVIGATION_ROTATING and mode == Mode.NAVIGATION_ROTATING:
        _rotate(state)


@njit(cache=True)
def output(state: Any) -> None:
    """Write the navigation output of this epoch, the body's attitude through the table."""
    navigation, ins = state.navigation, state.ins
    navigation.epoch = state.epoch
    navigation.mode = state.modes.mode
    navigation.latitude = ins.latitude
    navigation.longitude = ins.longitude
    navigation.height = ins.height
    for i in range(3):
        navigation.velocity_n[i] = ins.velocity_n[i]
    multiply_transposed(state.C_b_n, ins.C_s_n, state.C_s_b)
    navigation.roll, navigation.pitch, navigation.heading = euler_of_matrix(state.C_b_n)


@njit(cache=True)
def compute(state: Any, contract: Any) -> None:
    """Run all of an epoch that lies between the frames: from what was received to what to send.

    All but the navigation output, which `output` writes.
    """
    intake.close(state)
    clock.advance(state.clock)
    gimbal_matrix(
        state.C_s_b,
        np.radians(state.assembly.encoder_angle_deg[INNER]),
        np.radians(state.assembly.encoder_angle_deg[OUTER]),
    )
    modes.take_request(state)
    if state.diagnostics.order != 0:
        orders.take(state)
    _fuse(state)
    _run_mode(state, contract)


@njit(cache=True)
def firmware_step(
    ram: NDArray[Any],
    contract: NDArray[Any],
    inbox: FrameArray,
    start: int,
    count: int,
    outbox: FrameArray,
) -> int:
    """Run the firmware over one epoch.

    Parameters
    ----------
    ram : array of one record of dtype `firmware_py.memory.RAM`
        Changed in place. ``ram[0].clock.sync_arrival_ns`` is to be set before, in nanoseconds of
        the firmware's own clock.
    contract : array of one record, from `dbc.contract.load_contract`
    inbox : array of dtype `dbc.frame.FRAME`
        Frames received; ``inbox[start:count]`` are read.
    outbox : array of dtype `dbc.frame.FRAME`, at least `transmit.OUTBOX_CAPACITY` long

    Returns
    -------
    int
        Frames written to `outbox`. ``ram[0].consumed`` is the index of the first frame of `inbox`
        that belongs to a later epoch: the caller passes it as `start` of the next step.
    """
    state = ram[0]
    record = contract[0]
    state.steps += 1
    intake.begin(state)
    state.consumed = intake.take(state, record, inbox, start, count)
    compute(state, record)
    if modes.navigating(state):
        output(state)
    sent = transmit(state, record, outbox)
    monitor.watch(state, state.consumed - start + sent)
    return sent
