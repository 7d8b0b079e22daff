"""The modes of the navigation computer and the transitions between them.

=====================  ==========================================================================
mode                   transitions to
=====================  ==========================================================================
POWER_ON               SELF_TEST, in the first epoch
SELF_TEST              STANDBY, when SYNC, all sensors but those that redundancy left out, and both
                       axes were sound for half a second; FAULT (SELF_TEST_FAILED) after ten seconds
STANDBY                ALIGNMENT, on the request to align or to navigate, once the axes stand
ALIGNMENT              when done and navigation is requested: FINE_ALIGNMENT if the estimator has
                       one, else NAVIGATION_*; FAULT (ALIGNMENT_FAILED)
FINE_ALIGNMENT         NAVIGATION_*, after its time, or once the heading is known well enough;
                       STANDBY, on the request to align, which begins anew; FAULT, as from
                       NAVIGATION_*
NAVIGATION_STRAPDOWN   NAVIGATION_ROTATING, on request, or to try an axis again
NAVIGATION_ROTATING    NAVIGATION_STRAPDOWN, on request or when an axis does not follow
any NAVIGATION_*       FAULT (SENSORS_LOST) when too few sensors were usable for longer than the
                       bridging limit; FAULT (NAVIGATION_DIVERGED) when the solution is implausible
FAULT                  SELF_TEST, on the request for STANDBY
any but the first two  STANDBY, on request
any                    SHUTDOWN, on request
=====================  ==========================================================================

A request is handled once, when it changes; a target that STANDBY cannot reach yet is remembered.
"""

from __future__ import annotations

import math
from enum import IntEnum

from rrins.compiled.compilation import compiled
from rrins.dbc.values import AxisState
from rrins.firmware_py.core.navigation import alignment, inertial_alignment, strapdown, transfer
from rrins.firmware_py.core.records.estimator_records import Aid
from rrins.firmware_py.core.records.initial_attitude import InitialAttitude
from rrins.firmware_py.core.records.memory import INNER, OUTER, Ins, Modes, Ram
from rrins.firmware_py.core.turntable import sequencer


class Mode(IntEnum):
    """Modes; the DBC's value table of `mode`."""

    POWER_ON = 0
    SELF_TEST = 1
    STANDBY = 2
    ALIGNMENT = 3
    NAVIGATION_STRAPDOWN = 4
    NAVIGATION_ROTATING = 5
    FAULT = 6
    SHUTDOWN = 7
    FINE_ALIGNMENT = 8


class ModeRequest(IntEnum):
    """Requests of the operator; the DBC's value table of `mode_request`."""

    NONE = 0
    STANDBY = 1
    ALIGN = 2
    NAVIGATE_STRAPDOWN = 3
    NAVIGATE_ROTATING = 4
    SHUTDOWN = 5


class FirmwareFault(IntEnum):
    """Reason for the mode FAULT; the DBC's value table of `fault`."""

    NONE = 0
    SELF_TEST_FAILED = 1
    SENSORS_LOST = 2
    ALIGNMENT_FAILED = 3
    NAVIGATION_DIVERGED = 4


SELF_TEST_GOOD_S = 0.5
SELF_TEST_LIMIT_S = 10.0

_UNSOUND = 10
"""Sound epochs that one without a frame takes back: a bus may lose one of a hundred frames."""

_STANDS_DPS = 0.05
"""°/s, of an axis that stands."""

_PATIENCE_S = 10.0
"""An axis that does not stand by then never will."""

_AFTER_STANDBY = (Mode.ALIGNMENT, Mode.NAVIGATION_STRAPDOWN, Mode.NAVIGATION_ROTATING)
_NAVIGATION = (Mode.NAVIGATION_STRAPDOWN, Mode.NAVIGATION_ROTATING)
_INERTIAL = (Mode.NAVIGATION_STRAPDOWN, Mode.NAVIGATION_ROTATING, Mode.FINE_ALIGNMENT)

_BROUGHT = (int(InitialAttitude.TRANSFERRED), int(InitialAttitude.SELF_ALIGNED_MOVING))
_FIXES = int(Aid.GNSS_POSITION)

_LARGEST_SPEED = 3000.0  # m/s; no vehicle with this system is faster
_LARGEST_LATITUDE = math.radians(89.99)  # east and north end at the poles


@compiled
def enter(state: Ram, mode: int) -> None:
    """Enter a mode and initialise it."""
    modes = state.modes
    before = modes.mode
    modes.mode = mode
    modes.epochs = 0
    modes.good_epochs = 0
    if mode not in (Mode.FAULT, Mode.SHUTDOWN):  # keeps the reason readable
        modes.fault = FirmwareFault.NONE
    if mode == Mode.ALIGNMENT:
        alignment.begin(state.alignment)
        inertial_alignment.begin(state.inertial_alignment)
        transfer.begin(state.transfer)
    if mode == Mode.NAVIGATION_ROTATING and before == Mode.FINE_ALIGNMENT:
        pass  # it turns already
    elif mode == Mode.NAVIGATION_ROTATING or (mode == Mode.FINE_ALIGNMENT and _will_rotate(modes)):
        sequencer.start(state.sequencer, state.parameters, state.assembly)
    elif mode in (Mode.SHUTDOWN, Mode.POWER_ON):
        sequencer.switch_off(state.sequencer)
    else:
        sequencer.stop(state.sequencer)
    if mode in _INERTIAL and before == Mode.ALIGNMENT:
        parameters = state.parameters
        strapdown.initialise(
            state.ins,
            state.alignment.C_s_n,
            parameters.latitude,
            parameters.longitude,
            parameters.height,
        )


@compiled
def begins_in_motion(state: Ram) -> bool:
    """Return whether the vehicle may move before navigation begins."""
    return bool(transfer.is_wanted(state) or inertial_alignment.is_wanted(state))


@compiled
def is_lost(state: Ram) -> bool:
    """Return whether the vehicle may not be where navigation begins, and nothing has said where."""
    is_brought = state.parameters.initial_attitude in _BROUGHT
    fixes = state.estimator.sources[_FIXES].used
    return bool(state.clock.began_late and not is_brought and fixes == 0)


@compiled
def _will_rotate(modes: Modes) -> bool:
    """Return whether the navigation asked for is with rotation."""
    return modes.pending == Mode.NAVIGATION_ROTATING


@compiled
def interrupt_rotation(state: Ram) -> None:
    """Go on without rotation, until an axis that does not follow is tried again."""
    if state.modes.mode != Mode.FINE_ALIGNMENT:
        enter(state, Mode.NAVIGATION_STRAPDOWN)
    sequencer.interrupt(state.sequencer, state.parameters)


@compiled
def resume_rotation(state: Ram) -> None:
    """Rotate again after an interruption, if that is still asked for."""
    modes = state.modes
    is_aligning = modes.mode == Mode.FINE_ALIGNMENT
    if (not is_aligning and modes.mode != Mode.NAVIGATION_STRAPDOWN) or not _will_rotate(modes):
        return
    if sequencer.wait(state.sequencer, state.parameters, state.assembly):
        if not is_aligning:
            modes.mode = Mode.NAVIGATION_ROTATING
            modes.epochs = 0
        sequencer.resume(state.sequencer, state.parameters, state.assembly)


@compiled
def fail(state: Ram, fault: int) -> None:
    """Enter FAULT with a reason; drop any pending request."""
    state.modes.pending = 0
    enter(state, Mode.FAULT)
    state.modes.fault = fault


@compiled
def navigating(state: Ram) -> bool:
    """Return whether the mode is one of the two navigation modes."""
    mode = state.modes.mode
    return mode in _NAVIGATION


@compiled
def is_inertial(state: Ram) -> bool:
    """Return whether the strapdown runs: in navigation, and in the fine alignment before it."""
    mode = state.modes.mode
    return mode in _INERTIAL


@compiled
def follow_request(state: Ram) -> None:
    """Handle a new request of the operator, as far as the current mode allows."""
    modes = state.modes
    request = modes.requested
    if request == modes.request:
        return
    modes.request = request
    if modes.mode == Mode.SHUTDOWN:
        return
    if request == ModeRequest.SHUTDOWN:
        enter(state, Mode.SHUTDOWN)
    elif request == ModeRequest.STANDBY:
        modes.pending = Mode.STANDBY
        if modes.mode == Mode.FAULT:
            enter(state, Mode.SELF_TEST)
        elif modes.mode not in (Mode.POWER_ON, Mode.SELF_TEST):
            enter(state, Mode.STANDBY)
    elif modes.mode == Mode.FAULT:
        return
    elif request == ModeRequest.ALIGN:
        modes.pending = Mode.ALIGNMENT
        if modes.mode == Mode.FINE_ALIGNMENT:
            enter(state, Mode.STANDBY)
    elif request in (ModeRequest.NAVIGATE_STRAPDOWN, ModeRequest.NAVIGATE_ROTATING):
        rotating = request == ModeRequest.NAVIGATE_ROTATING
        modes.pending = Mode.NAVIGATION_ROTATING if rotating else Mode.NAVIGATION_STRAPDOWN
        if navigating(state) and modes.mode != modes.pending:
            enter(state, modes.pending)


@compiled
def standby(state: Ram) -> None:
    """Start the alignment when alignment or navigation is requested, and the axes stand."""
    rates, seconds = state.assembly.encoder_rate_dps, state.parameters.period_ns * 1e-9
    turns = abs(rates[INNER]) > _STANDS_DPS or abs(rates[OUTER]) > _STANDS_DPS
    if turns and state.modes.epochs * seconds < _PATIENCE_S:
        return
    if state.modes.pending in _AFTER_STANDBY:
        enter(state, Mode.ALIGNMENT)


@compiled
def self_test(state: Ram) -> None:
    """Pass once everything has been sound for a while; fail on timeout."""
    assembly = state.assembly
    seconds = state.parameters.period_ns * 1e-9
    redundancy = state.redundancy
    every_gyro = (1 << state.gyros.count) - 1 & ~redundancy.gyros.excluded
    every_accelerometer = (
        1 << state.accelerometers.count
    ) - 1 & ~redundancy.accelerometers.excluded
    axes = (
        assembly.axis_received[INNER]
        and assembly.axis_received[OUTER]
        and assembly.axis_state[INNER] != AxisState.FAULT
        and assembly.axis_state[OUTER] != AxisState.FAULT
    )
    sound = (
        axes
        and state.clock.sync_seen
        and assembly.gyro_valid & every_gyro == every_gyro
        and assembly.accelerometer_valid & every_accelerometer == every_accelerometer
    )
    modes = state.modes
    modes.good_epochs = modes.good_epochs + 1 if sound else max(0, modes.good_epochs - _UNSOUND)
    if modes.good_epochs * seconds >= SELF_TEST_GOOD_S:
        enter(state, Mode.STANDBY)
    elif modes.epochs * seconds >= SELF_TEST_LIMIT_S:
        fail(state, FirmwareFault.SELF_TEST_FAILED)


@compiled
def plausible(ins: Ins) -> bool:
    """Return whether the navigation solution is plausible for a vehicle."""
    east, north, up = ins.velocity_n[0], ins.velocity_n[1], ins.velocity_n[2]
    speed = math.sqrt(east * east + north * north + up * up)
    return speed < _LARGEST_SPEED and abs(ins.latitude) < _LARGEST_LATITUDE
