"""One epoch of the firmware: frames in, navigation and axis commands out.

``intake -> fusion -> mode (alignment or strapdown) -> rotation scheme -> output -> frames``.
No clock, socket, thread, file or allocation; all state is the RAM image.
"""

from __future__ import annotations

import numpy as np

from rrins.compiled.compilation import compiled, compiled_with
from rrins.compiled.compiled_beside import Beside, array_of
from rrins.compiled.record import Records
from rrins.dbc.contract import Contract
from rrins.dbc.frame import Frame, FrameArray
from rrins.firmware_py.core.aiding import antenna, wheel
from rrins.firmware_py.core.estimator import feedback
from rrins.firmware_py.core.estimator import follow as estimator
from rrins.firmware_py.core.frames_in import (
    clock,
    gnss,
    intake,
    master,
    odometer,
    stimulation,
    zero_velocity,
)
from rrins.firmware_py.core.frames_out.transmit import transmit
from rrins.firmware_py.core.integrity import protection
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.maths.attitude import (
    euler_of_matrix,
    multiply_transposed,
    turn_gimbals,
)
from rrins.firmware_py.core.modes import modes, routine_requests
from rrins.firmware_py.core.modes.modes import FirmwareFault, Mode
from rrins.firmware_py.core.monitoring import monitor, stuck
from rrins.firmware_py.core.navigation import (
    alignment,
    bridging,
    inertial_alignment,
    strapdown,
    transfer,
)
from rrins.firmware_py.core.records.estimator_records import ATTITUDE
from rrins.firmware_py.core.records.initial_attitude import InitialAttitude
from rrins.firmware_py.core.records.memory import INNER, OUTER, Fusion, Ram
from rrins.firmware_py.core.records.redundancy_records import Parity
from rrins.firmware_py.core.redundancy import bank, biases, repair
from rrins.firmware_py.core.redundancy import watch as redundancy
from rrins.firmware_py.core.sensors import size_effect
from rrins.firmware_py.core.sensors.fusion import compensate, fuse
from rrins.firmware_py.core.turntable import encoders, isolation, sequencer

_DOUBT_NS = 15_000_000_000
"""Longest time that an alignment waits for a suspicion to be settled."""


@compiled
def _fuse(state: Ram) -> None:
    """Fuse gyros and accelerometers, or bridge with the increments of the previous epoch."""
    assembly, faults, work = state.assembly, state.faults, state.ins.work
    if state.gyros.calibrated:
        compensate(state.gyros, assembly.received, assembly.gyro_dtheta)
    if state.accelerometers.calibrated:
        compensate(state.accelerometers, assembly.received, assembly.accelerometer_dv)
    redundancy.correct(
        state.redundancy.gyros,
        state.gyros,
        assembly.received,
        assembly.gyro_valid,
        assembly.gyro_dtheta,
    )
    gyros = fuse(state.gyros, assembly.gyro_valid, assembly.gyro_dtheta, state.dtheta_s, work)
    if state.size_effect.present:
        dt = state.parameters.period_ns * 1e-9
        size_effect.follow(state.size_effect, state.dtheta_s, dt)
        size_effect.remove(
            state.size_effect,
            state.accelerometers,
            assembly.received,
            assembly.accelerometer_dv,
            dt,
        )
    redundancy.correct(
        state.redundancy.accelerometers,
        state.accelerometers,
        assembly.received,
        assembly.accelerometer_valid,
        assembly.accelerometer_dv,
    )
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


@compiled
def _follow_repetitions(state: Ram) -> None:
    monitor, assembly = state.diagnostics, state.assembly
    stuck.follow(
        monitor.gyro_repetition,
        state.gyros.count,
        assembly.gyro_dtheta,
        assembly.gyro_usable,
    )
    stuck.follow(
        monitor.accelerometer_repetition,
        state.accelerometers.count,
        assembly.accelerometer_dv,
        assembly.accelerometer_usable,
    )


@compiled
def _judge_repetitions(state: Ram) -> None:
    monitor = state.diagnostics
    epochs = monitor.stuck_epochs
    stuck.judge(monitor.gyro_repetition, state.gyros, state.dtheta_s, epochs)
    stuck.judge(monitor.accelerometer_repetition, state.accelerometers, state.dv_s, epochs)


@compiled
def _doubts(state: Ram) -> bool:
    """Return whether an alignment that is due waits, for one of its sensors seems to fail.

    Until the sensor is left out, which begins the alignment anew, or it seems to remain unknown.
    """
    redundancy, parameters = state.redundancy, state.parameters
    waited = state.alignment.epochs - parameters.alignment_epochs
    if waited * parameters.period_ns > _DOUBT_NS:
        return False
    alarm = redundancy.gyros.alarm or redundancy.accelerometers.alarm
    return bool(alarm)


@compiled
def _note_doubts(state: Ram) -> None:
    """Note what the vectors of the alignment may be off by, as the parities show."""
    redundancy, coarse = state.redundancy, state.alignment
    coarse.rate_sigma = biases.doubtful_sigma(redundancy.gyros, state.gyros)
    coarse.force_sigma = biases.doubtful_sigma(redundancy.accelerometers, state.accelerometers)


@compiled
def _align_in_motion(state: Ram) -> None:
    """Align a vehicle that moves, until the attitude is known; go on while nobody wants it."""
    may_ask = inertial_alignment.follow(state)
    is_due = state.alignment.epochs >= state.parameters.alignment_epochs and not _doubts(state)
    if not may_ask or not is_due:
        return
    _note_doubts(state)
    inertial_alignment.find(state)
    if state.alignment.failed:
        modes.fail(state, FirmwareFault.ALIGNMENT_FAILED)
    elif state.alignment.done and state.modes.pending != Mode.ALIGNMENT:
        inertial_alignment.write_attitude(state)
        fine = state.estimator.fine_epochs > 0
        modes.enter(state, Mode.FINE_ALIGNMENT if fine else state.modes.pending)
        inertial_alignment.set_in_motion(state)


@compiled
def _align_by_transfer(state: Ram) -> None:
    """Wait for a transfer; begin with it after the alignment's time."""
    state.alignment.epochs += 1
    has_come = transfer.carry(state)
    if state.alignment.epochs < state.parameters.alignment_epochs or _doubts(state):
        return
    state.alignment.done = has_come
    if has_come and state.modes.pending != Mode.ALIGNMENT:
        transfer.write_attitude(state)
        fine = state.estimator.fine_epochs > 0
        modes.enter(state, Mode.FINE_ALIGNMENT if fine else state.modes.pending)
        transfer.set_in_motion(state)


@compiled
def _align(state: Ram, contract: Contract) -> None:
    parameters, work = state.parameters, state.ins.work
    if transfer.is_wanted(state):
        _align_by_transfer(state)
        return
    if inertial_alignment.is_wanted(state):
        _align_in_motion(state)
        return
    finished = state.alignment.done or state.alignment.failed
    if not finished:
        alignment.accumulate(state.alignment, state.dtheta_s, state.dv_s)
        if state.alignment.epochs < parameters.alignment_epochs:
            return
        if _doubts(state) and not alignment.sets_off(state.alignment, state.dv_s):
            return
        if parameters.initial_attitude == InitialAttitude.SELF_ALIGNED:
            gravity = earth.gravity(parameters.latitude, parameters.height)
            _note_doubts(state)
            alignment.find(state.alignment, parameters.period_ns * 1e-9, gravity, work)
        else:
            alignment.set_given(state.alignment, parameters.C_b_n, state.C_s_b)
        if state.alignment.done:
            resolution = contract.sensor[0].gyro_dtheta.scale
            alignment.apply_held_back(state.alignment, resolution, work)
    if state.alignment.failed:
        modes.fail(state, FirmwareFault.ALIGNMENT_FAILED)
    elif state.modes.pending != Mode.ALIGNMENT:
        fine = state.estimator.fine_epochs > 0
        modes.enter(state, Mode.FINE_ALIGNMENT if fine else state.modes.pending)


@compiled
def _refer_height(state: Ram) -> None:
    """Set the vertical channel's reference for this epoch."""
    parameters, ins, assembly = state.parameters, state.ins, state.assembly
    state.altimeter_epochs += 1
    ins.reference_interval = 0.0
    if not parameters.altimeter:
        ins.reference_interval = parameters.period_ns * 1e-9
    elif assembly.altimeter_received:
        ins.reference_interval = state.altimeter_epochs * parameters.period_ns * 1e-9
        ins.reference_height = assembly.altimeter_height
        state.altimeter_epochs = 0


@compiled
def _navigate(state: Ram) -> None:
    parameters = state.parameters
    _refer_height(state)
    bridging.follow(state)
    strapdown.update(
        state.ins,
        state.dtheta_s,
        state.dv_s,
        parameters.period_ns * 1e-9,
        parameters.height_channel,
    )
    if state.faults.consecutive_bridged > parameters.bridge_epochs:
        modes.fail(state, FirmwareFault.SENSORS_LOST)
    elif not modes.plausible(state.ins):
        modes.fail(state, FirmwareFault.NAVIGATION_DIVERGED)


@compiled
def _finish_alignment(state: Ram) -> None:
    """End the fine alignment after its time, or once the heading is known well enough."""
    filter_state = state.estimator
    enough = filter_state.heading_sigma_enough
    heading_sigma = filter_state.sigma[ATTITUDE + 2]
    is_known = enough > 0.0 and 0.0 < heading_sigma <= enough
    is_over = state.modes.epochs >= filter_state.fine_epochs or is_known
    if is_over and state.modes.pending != Mode.ALIGNMENT:
        modes.enter(state, state.modes.pending)


@compiled
def _rotate(state: Ram) -> None:
    """Advance the scheme; fall back to strapdown when an axis does not follow."""
    if sequencer.watch(state.sequencer, state.parameters, state.assembly):
        modes.interrupt_rotation(state)
    else:
        sequencer.advance(state.sequencer, state.parameters)


@compiled_with(is_unit=True)
def _run_mode(state: Ram, contract: Contract) -> None:
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
    elif mode in (Mode.NAVIGATION_STRAPDOWN, Mode.NAVIGATION_ROTATING, Mode.FINE_ALIGNMENT):
        _navigate(state)
    turns = mode == Mode.NAVIGATION_ROTATING
    if mode == Mode.FINE_ALIGNMENT:
        turns = state.sequencer.running and not state.sequencer.interrupted
    if state.modes.mode == mode and turns:
        _rotate(state)
    elif state.sequencer.interrupted:
        modes.resume_rotation(state)
    if state.parameters.isolate_heading and modes.is_inertial(state):
        isolation.follow(state)
    if state.modes.mode == Mode.FINE_ALIGNMENT and mode == Mode.FINE_ALIGNMENT:
        _finish_alignment(state)


@compiled
def output(state: Ram) -> None:
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


@compiled_with(is_unit=True)
def compute(state: Ram, contract: Contract, compares: bool | None, estimates: bool | None) -> None:
    """Run an epoch without its frames: from the received values to the values to send.

    Everything except the navigation output, which `output` writes. `compares` and `estimates` are
    as `firmware_step` takes them.
    """
    intake.close(state)
    gnss.close(state, contract)
    master.close(state, contract)
    odometer.close(state, contract.odometer)
    zero_velocity.close(state)
    clock.advance(state.clock)
    _follow_repetitions(state)
    _fuse(state)
    _judge_repetitions(state)
    encoders.follow(state, modes.is_inertial(state))
    turn_gimbals(
        state.C_s_b,
        state.axis,
        np.radians(state.assembly.encoder_angle_deg[INNER]),
        np.radians(state.assembly.encoder_angle_deg[OUTER]),
    )
    modes.follow_request(state)
    if state.diagnostics.routine_request != 0:
        routine_requests.follow(state)
    if compares is not None and state.clock.synchronised:  # with None not even compiled
        navigates = modes.is_inertial(state) and not state.ins.first
        mode = state.modes.mode
        aligns = mode == Mode.ALIGNMENT or mode == Mode.FINE_ALIGNMENT
        aligns = aligns and not modes.begins_in_motion(state)
        redundancy.watch(state, navigates, aligns)
    if estimates is not None and state.faults.consecutive_bridged == 0:
        feedback.compensate(state)
    if transfer.is_wanted(state):
        transfer.note(state)
    _run_mode(state, contract)
    antenna.follow(state)
    wheel.follow(state)
    if estimates is not None:
        estimator.follow(state)
        if state.integrity.enabled:
            protection.follow(state)


@compiled
def firmware_step(
    ram: Records[Ram],
    contract: Records[Contract],
    inbox: FrameArray,
    start: int,
    count: int,
    outbox: FrameArray,
    compares: bool | None,
    estimates: bool | None,
) -> int:
    """Run the firmware over one epoch.

    Parameters
    ----------
    ram : Records[Ram]
        One record, changed in place. Set ``ram[0].clock.sync_arrival_ns`` before, in nanoseconds
        of the firmware's own clock.
    contract : Records[Contract]
        From `rrins.dbc.contract.load_contract`.
    inbox : FrameArray
        Frames received; ``inbox[start:count]`` are read.
    outbox : FrameArray
        At least `transmit.OUTBOX_CAPACITY` long.
    compares : bool, optional
        True if redundant sensors are compared, as `redundancy.enabled` of the RAM image says, else
        None: a step that does not compare them compiles in two thirds of the time.
    estimates : bool, optional
        True if the estimator runs, as `estimator.enabled` of the RAM image says, else None.

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
    state.consumed = intake.receive(state, record, inbox, start, count)
    if state.stimulation.gyros | state.stimulation.accelerometers:
        stimulation.apply(state)
    compute(state, record, compares, estimates)
    if modes.navigating(state):
        output(state)
    sent = transmit(state, record, outbox)
    monitor.watch(state, state.consumed - start + sent)
    return sent


def parts_beside(contract: Records[Contract], compares: bool | None) -> tuple[Beside, ...]:
    """Return what a second process compiles meanwhile: half of a step, from its end."""
    comparing = (
        Beside(bank.follow, (Ram,)),
        Beside(repair.advance, (Ram,)),
        Beside(redundancy.close_second, (Ram, Parity, Fusion)),
    )
    return (
        Beside(monitor.watch, (Ram, int)),
        Beside(transmit, (Ram, contract.dtype, array_of(Frame))),
        Beside(_run_mode, (Ram, contract.dtype)),
        *(comparing if compares else ()),
    )
