"""The RAM image: all state of the firmware, as one record of fixed size.

A step takes an array of one `Ram` record and changes it in place. Copy the array to take a
snapshot; compare two copies byte for byte to see whether two runs were identical.
"""

from __future__ import annotations

from typing import Annotated

from rrins.compiled.record import (
    F8,
    I8,
    Bool,
    Bytes,
    Floats,
    Integers,
    Record,
    Records,
    Shorts,
    Words,
)
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.dbc.e2e import COUNTER_MODULUS
from rrins.firmware_py.core.maths.angles import Angle
from rrins.firmware_py.core.records.calibration_records import CalibrationInUse
from rrins.firmware_py.core.records.diagnostic_records import DiagnosticState
from rrins.firmware_py.core.records.encoder_records import Encoders
from rrins.firmware_py.core.records.estimator_records import TRACK_EPOCHS, Estimator
from rrins.firmware_py.core.records.integrity_records import Integrity
from rrins.firmware_py.core.records.redundancy_records import Redundancy
from rrins.firmware_py.core.records.stimulation_records import Stimulation
from rrins.firmware_py.core.records.transfer_records import Master, Transfer
from rrins.firmware_py.core.records.troubles import Source

SCHEME_CAPACITY = 64
"""The most positions that a rotation scheme can have."""

HEARD_SOURCES = int(Source.SYNC) + 1
"""Sources whose frames belong to an epoch."""

ANTENNA_EPOCHS = 2048
"""Epochs of the antenna's place that are kept, for fixes of the past; 2 s at 1 kHz."""

WHEEL_EPOCHS = 4096
"""Epochs of the wheel's way that are kept, for counts of the past; 2 s at 2 kHz."""

INNER, OUTER = 0, 1
"""Index of an axis in arrays over the two axes."""


class Parameters(Record):
    """The firmware's set-up; a step only reads it."""

    period_ns: I8  #: length of an epoch
    latitude: F8  #: rad, where navigation starts
    longitude: F8  #: rad, where navigation starts
    height: F8  #: m, where navigation starts
    C_b_n: Annotated[Floats, (3, 3)]  #: initial attitude, if given
    initial_attitude: I8  #: an `InitialAttitude`
    alignment_epochs: I8  #: length of the alignment, at least
    height_channel: I8  #: `HEIGHT_HELD`, `HEIGHT_DAMPED` or `HEIGHT_FREE` of `strapdown`
    altimeter: Bool  #: whether one is fitted
    bridge_epochs: I8  #: longest gap in the sensor frames that is bridged
    turn_rate_dps: F8  #: at which the scheme turns the axes
    axis_acceleration_dps2: F8  #: of the axes' drives
    axis_rise_s: F8  #: time in which an axis reaches that acceleration
    isolate_heading: Bool  #: whether the inner axis takes the vehicle's turn out
    isolation_rate_dps: F8  #: at which the inner axis turns at most when it does
    position_count: I8  #: positions of the rotation scheme
    position_axis: Annotated[Integers, SCHEME_CAPACITY]  #: axis that turns: `INNER` or `OUTER`
    position_turn_deg: Annotated[Floats, SCHEME_CAPACITY]  #: signed
    position_epochs: Annotated[Integers, SCHEME_CAPACITY]  #: turning and standing
    angle_span_deg: F8  #: after which the angle in an encoder's frame wraps
    follow_tolerance_deg: F8  #: largest deviation of an axis from its expected angle
    axis_silence_epochs: I8  #: longest silence of a following axis
    gyro_consistency: F8  #: rad per epoch, largest disagreement of redundant gyros
    accelerometer_consistency: F8  #: m/s per epoch, the same for the accelerometers


class Clock(Record):
    """The loop's own clock, disciplined by SYNC."""

    synchronised: Bool  #: whether SYNC has given the epoch
    sync_seen: Bool  #: in this epoch
    sync_refused: Bool  #: whether a SYNC of this epoch's frames was not used
    began_late: Bool  #: whether the first SYNC was of an epoch after the hardware's first second
    is_whole: Bool  #: whether the frames of a step are one epoch's, filled in by the shell
    far_epoch: I8  #: that SYNC has named far from the count, plus 1, counted on since; 0: none
    sync_lost: Bool  #: whether SYNC has been missing for too long
    sync_missed: I8  #: epochs since the last SYNC
    sync_arrival_ns: I8  #: by the own clock, filled in by the shell before a step
    next_sync_ns: I8  #: by the own clock, when the SYNC after this step is expected
    period_q16: I8  #: length of an epoch by the own clock, ns * 2**16
    fraction_q16: I8  #: ns * 2**16, fraction of `next_sync_ns`
    outliers: I8  #: consecutive SYNCs at unexpected times
    jumps: I8  #: sudden changes of SYNC's phase or epoch


class Assembly(Record):
    """Values from the frames of one epoch."""

    gyro_dtheta: Annotated[Floats, SENSOR_GROUPS]  #: rad, along the input axes
    accelerometer_dv: Annotated[Floats, SENSOR_GROUPS]  #: m/s, along the input axes
    received: I8  #: sensor groups whose frame arrived, one bit each
    gyro_valid: I8  #: usable gyros, one bit each
    accelerometer_valid: I8  #: usable accelerometers, one bit each
    gyro_usable: I8  #: the same before sensors are excluded
    accelerometer_usable: I8  #: the same before sensors are excluded
    gyro_absent: I8  #: flagged as absent, one bit each
    accelerometer_absent: I8  #: flagged as absent, one bit each
    axis_received: Annotated[Bytes, 2]  #: whether an axis' frame arrived, 0 or 1
    encoder_angle_deg: Annotated[Floats, 2]  #: as used: see `encoders`; else extrapolated
    encoder_rate_dps: Annotated[Floats, 2]  #: as last received
    axis_state: Annotated[Integers, 2]  #: an `AxisState`, as last received
    angle_before_deg: Annotated[Floats, 2]  #: before this epoch's frame, should it be withdrawn
    rate_before_dps: Annotated[Floats, 2]  #: the same
    state_before: Annotated[Integers, 2]  #: the same
    axis_silent_epochs: Annotated[Integers, 2]  #: since an axis' last frame
    altimeter_received: Bool  #: whether the altimeter's frame arrived
    altimeter_height: F8  #: m, as last received


class Gnss(Record):
    """The GNSS receiver: the group of frames of this epoch, and the latest fix."""

    interval_epochs: I8  #: between fixes; 0: no receiver is fitted
    arrived: I8  #: frames of this epoch's group, one bit each
    refused: Bool  #: whether two frames disagree about this epoch
    word: Annotated[Words, 5]  #: payloads of the group
    silent_epochs: I8  #: since the last whole group
    fresh: Bool  #: whether a fix came in this epoch
    available: Bool  #: whether fixes come
    lost: Bool  #: whether none has come for too long
    fixes: I8  #: since power-on
    losses: I8  #: how often fixes stopped coming
    too_old: I8  #: fixes that were not used for their age
    quality: I8  #: as last received; 0: no fix
    age_epochs: I8  #: since the latest fix was valid
    epoch: I8  #: at whose end the latest fix was valid
    position_sigma: F8  #: m, of each component
    velocity_sigma: F8  #: m/s, of each component
    latitude: F8  #: rad
    longitude: F8  #: rad
    height: F8  #: m
    velocity_n: Annotated[Floats, 3]  #: m/s


class Antenna(Record):
    """The GNSS antenna: where it is against the reference point."""

    present: Bool  #: whether it is away from that
    lever_arm_b: Annotated[Floats, 3]  #: m
    lever_n: Annotated[Floats, (ANTENNA_EPOCHS, 3)]  #: m, at the end of each epoch, a ring
    first: I8  #: epoch from which on the ring is whole
    last: I8  #: epoch, of the ring
    velocity_n: Annotated[Floats, 3]  #: m/s, against the reference point, scratch
    C_b_n: Annotated[Floats, (3, 3)]  #: scratch


class Odometer(Record):
    """The odometer: the frame of this epoch, and how far the vehicle has moved.

    Distances are along the vehicle's forward axis, backwards negative, by the nominal scale.
    """

    interval_epochs: I8  #: between frames; 0: no odometer is fitted
    metres_per_pulse: F8  #: by its data sheet
    noise: F8  #: m/s, of the mean speed over an interval, by its data sheet
    lever_arm_b: Annotated[Floats, 3]  #: m, from the reference point to the wheel
    arrived: Bool  #: whether this epoch's frame arrived
    refused: Bool  #: whether two frames disagree about this epoch
    word: Annotated[Words, 1]  #: payload of the frame
    silent_epochs: I8  #: since the last frame
    fresh: Bool  #: whether a distance came in this epoch
    available: Bool  #: whether distances come
    lost: Bool  #: whether none has come for too long
    begun: Bool  #: whether `pulses` is a count from which the next distance begins
    pulses: I8  #: as last received
    valid: Bool  #: whether the odometer counts, as last received
    measurements: I8  #: distances since power-on
    losses: I8  #: how often they stopped coming
    gaps: I8  #: times that `travelled` left something out: it is whole between two changes
    implausible: I8  #: distances that were not used, faster than any vehicle
    age_epochs: I8  #: since the latest count
    epoch: I8  #: of the latest count, at its end
    epoch_before: I8  #: of the count before it, where the latest distance begins
    distance: F8  #: m, the latest
    travelled: F8  #: m, sum of all distances since power-on


class Wheel(Record):
    """The odometer's wheel: its way by the navigation, since the strapdown began."""

    way_b: Annotated[Floats, 3]  #: m, along the axes of the body
    lever_way_b: Annotated[Floats, 3]  #: m, of that by the lever arm, which turns
    attitude_b: Annotated[Floats, (3, 3)]  #: s, integral of C_b_n
    lever_n: Annotated[Floats, 3]  #: m, from the reference point to the wheel
    turned_b: F8  #: rad, to the right
    track: Annotated[Floats, (WHEEL_EPOCHS, 16)]  #: these, `turned_b` before `lever_way_b`, a ring
    first: I8  #: epoch from which on the ring is whole
    last: I8  #: epoch, of the ring
    moved_n: Annotated[Floats, 3]  #: m, in this epoch, scratch
    right_n: Annotated[Floats, 3]  #: before this epoch, scratch
    C_b_n: Annotated[Floats, (3, 3)]  #: at the end of the last epoch


class ZeroVelocity(Record):
    """The operator's message that the vehicle stands."""

    counter: I8  #: of the last frame, plus 1; 0: none received yet
    heard: Bool  #: whether a frame came in this epoch
    standing: Bool  #: whether the vehicle stands, so says the operator
    velocity_sigma: F8  #: m/s, of each component, how still it stands
    silent_epochs: I8  #: since the last frame
    epochs: I8  #: for which it has stood without interruption


class Heard(Record):
    """The last frame of each source with each counter, and what disagrees with them."""

    epoch_after: Annotated[Integers, (HEARD_SOURCES, COUNTER_MODULUS)]  #: its epoch plus 1; 0: none
    word: Annotated[Words, (HEARD_SOURCES, COUNTER_MODULUS)]  #: its payload
    foreign_word: Annotated[Words, HEARD_SOURCES]  #: payload of the last frame of another epoch
    foreign_after: Annotated[Integers, HEARD_SOURCES]  #: epoch in which that came plus 1; 0: none
    repeated_after: Annotated[Integers, HEARD_SOURCES]  #: epoch in which it came again plus 1
    repetitions: Annotated[Integers, HEARD_SOURCES]  #: of that frame, since data last counted
    right_run: Annotated[Integers, HEARD_SOURCES]  #: right counters since the last repetition
    disputed: I8  #: sources of which two frames disagree about this epoch, one bit each
    doubted: I8  #: sources of which a frame disagrees with that of an earlier epoch, one bit each


class Fusion(Record):
    """Calibration of the sensors of one kind, and weighted least squares over them.

    Increments are in rad for gyros, in m/s for accelerometers.
    """

    count: I8  #: sensors of the kind
    calibrated: Bool  #: whether there is any error to remove
    bias_increment: Annotated[Floats, SENSOR_GROUPS]  #: b dt
    scale_error: Annotated[Floats, SENSOR_GROUPS]  #: λ, dimensionless
    asymmetric_scale_error: Annotated[Floats, SENSOR_GROUPS]  #: μ, dimensionless
    H: Annotated[Floats, (SENSOR_GROUPS, 3)]  #: rows h', the input axes as calibrated
    weight: Annotated[Floats, SENSOR_GROUPS]  #: in the least squares, relative
    used: I8  #: sensors that `gain` is for, one bit each
    solvable: Bool  #: whether their axes span space
    gain: Annotated[Floats, (3, SENSOR_GROUPS)]  #: from increments to the fused vector


class SizeEffect(Record):
    """Accelerometers away from the reference point, and the rates that they feel there."""

    present: Bool  #: whether any is
    begun: Bool  #: whether there is an epoch before
    position_s: Annotated[Floats, (SENSOR_GROUPS, 3)]  #: m, from the reference point
    rate_s: Annotated[Floats, 3]  #: rad/s, mean of the last epoch
    end_rate_s: Annotated[Floats, 3]  #: rad/s, at the end of the last epoch
    change_s: Annotated[Floats, 3]  #: rad/s, of the end rate in the last epoch


class Alignment(Record):
    """Initial attitude; increments and angles summed since the alignment began."""

    epochs: I8  #: summed so far
    done: Bool  #: with the attitude in `C_s_n`
    failed: Bool  #: without an attitude
    dtheta_s: Annotated[Floats, 3]  #: rad
    dv_s: Annotated[Floats, 3]  #: m/s
    angle_sum: Annotated[Floats, 3]  #: rad, Σ over epochs of the angle so far
    angle_moment: Annotated[Floats, 3]  #: rad, Σ of epoch number times the angle so far
    angle_square: F8  #: rad², Σ over epochs of the square of the angle so far
    increment_square: F8  #: rad², Σ over epochs of the square of the increment
    gained_s: Annotated[Floats, 3]  #: m/s, velocity gained while it waits
    rate_sigma: F8  #: rad/s, of a component of the mean rate, beyond the data sheet
    force_sigma: F8  #: m/s², of the mean specific force, likewise
    C_s_n: Annotated[Floats, (3, 3)]  #: attitude of the sensors, once found
    noise_sigma: Annotated[Floats, 3]  #: rad, about east, north, up: what motion and noise left
    velocity_sigma: F8  #: m/s, of each component at its end; 0: the vehicle stands
    position_sigma: F8  #: m, likewise


class InertialAlignment(Record):
    """Coarse alignment of a vehicle that moves: what the sensors felt beside what they should have.

    Frame s0 is that of the sensors when it began, i the Earth's axes then; neither turns. Sums are
    over samples, weighted with the time since then, and with its square.
    """

    first_epoch: I8  #: that was felt; -1: none yet
    left_out: I8  #: sensors left out then, one bit each, accelerometers above gyros
    q_s_s0: Annotated[Floats, 4]  #: attitude of the sensors, scalar first
    C_s_s0: Annotated[Floats, (3, 3)]  #: the same as a matrix
    felt_s0: Annotated[Floats, 3]  #: m/s, integral of the specific force
    moment_s0: Annotated[Floats, 3]  #: m, integral of time times specific force
    track: Annotated[Floats, (TRACK_EPOCHS, 6)]  #: both after each epoch, a ring
    expected_i: Annotated[Floats, 3]  #: m/s, integral of the specific force, by what is known
    fixes: I8  #: used so far
    fix_epoch: I8  #: at whose end the last one was valid
    fix_place: Annotated[Floats, 3]  #: its latitude, longitude (rad), height (m)
    fix_velocity_i: Annotated[Floats, 3]  #: m/s, its velocity over ground
    fix_rate_i: Annotated[Floats, 3]  #: m/s², specific force at constant velocity over ground
    samples: I8
    weight: Annotated[Floats, 2]
    felt_sum: Annotated[Floats, (2, 3)]
    expected_sum: Annotated[Floats, (2, 3)]
    moment_sum: Annotated[Floats, (2, 3)]
    product: Annotated[Floats, (2, 3, 3)]  #: expected times felt
    moment_product: Annotated[Floats, (2, 3, 3)]  #: expected times moment
    expected_product: Annotated[Floats, (2, 3, 3)]
    felt_square: Annotated[Floats, 2]
    C_s0_i: Annotated[Floats, (3, 3)]  #: once found
    C_n_i: Annotated[Floats, (3, 3)]  #: scratch
    work: Annotated[Floats, (5, 3, 3)]  #: scratch
    work_q: Annotated[Floats, (3, 4)]  #: scratch
    davenport: Annotated[Floats, (4, 4)]  #: scratch
    eigenvectors: Annotated[Floats, (4, 4)]  #: scratch


class Ins(Record):
    """The strapdown navigation."""

    first: Bool  #: whether no epoch has been navigated yet
    latitude: F8  #: rad
    parallel: Angle  #: the same, as `strapdown.parallel` has found it
    longitude: F8  #: rad, in [-π, π)
    latitude_carry: F8  #: rad, rounding error of adding to the position
    longitude_carry: F8  #: rad, the same of the longitude
    height: F8  #: m above the ellipsoid
    reference_height: F8  #: m, reference of a held or damped height channel
    reference_interval: F8  #: s since the previous reference; 0: none in this epoch
    height_error_integral: F8  #: m s
    velocity_n: Annotated[Floats, 3]  #: m/s
    velocity_change_n: Annotated[Floats, 3]  #: m/s, in the last epoch
    q_s_n: Annotated[Floats, 4]  #: attitude of the sensors, scalar first
    C_s_n: Annotated[Floats, (3, 3)]  #: the same as a matrix
    dtheta_s_previous: Annotated[Floats, 3]  #: rad, in the previous epoch
    dv_s_previous: Annotated[Floats, 3]  #: m/s, in the previous epoch
    work: Annotated[Floats, (9, 3)]  #: scratch
    work_q: Annotated[Floats, (2, 4)]  #: scratch


class Bridging(Record):
    """The gaps in the sensor data, and what they have amounted to."""

    count: I8  #: epochs of the present gap
    recent_s: F8  #: bridged in about the last 100 s
    bridged_epochs: I8  #: since navigation began
    angle_variance: F8  #: rad², of what gaps may have cost since navigation began
    velocity_variance: F8  #: m²/s², of the same
    lag_epochs: I8  #: of the present stretch of time
    lag: Annotated[Floats, (2, 3)]  #: rad, m/s: what its gaps have cost as they add up, in s
    most: Annotated[Floats, 2]  #: the largest square of either in it
    lag_variance: Annotated[Floats, 2]  #: their sum since navigation began
    transmissions: I8  #: of BRIDGING, for its counter


class Isolation(Record):
    """Command of the inner axis while it takes the vehicle's turn out."""

    known: Bool  #: whether `heading` is
    begun: Bool  #: whether `wanted_deg` is
    heading: F8  #: rad, of the body an epoch ago
    turned: F8  #: rad, by which the vehicle has turned about up, without dropped whole turns
    cosine: F8  #: of the outer axis' angle
    wanted_deg: F8  #: angle of the inner axis that would isolate ideally
    angle_deg: F8  #: angle that it is told, within the limits of its drive
    rate_dps: F8  #: of that angle


class Sequencer(Record):
    """The rotation scheme's progress and the commands to the axes."""

    running: Bool  #: whether the scheme runs
    homing: Bool  #: whether both axes still turn to zero, before the first position
    position: I8  #: from 0
    cycle: I8  #: from 0
    epochs: I8  #: in this position
    turn_begun: I8  #: of these, when the turn began; later than 0 after an interruption
    start_angle_deg: Annotated[Floats, 2]  #: at the beginning of the turn
    target_angle_deg: Annotated[Floats, 2]  #: cumulative over full turns
    command: Annotated[Integers, 2]  #: an `AxisCommand`
    not_following: Annotated[Bytes, 2]  #: whether an axis did not follow its commands, 0 or 1
    interrupted: Bool  #: whether the scheme waits for an axis that did not follow
    wait_epochs: I8  #: until it is tried again
    tries: I8  #: since the interruption
    abandoned: Annotated[Bytes, 2]  #: whether an axis did not follow in any try, 0 or 1
    interruptions: Annotated[Integers, 2]  #: by each axis, since power-on
    isolation: Isolation


class Modes(Record):
    """The mode, and the requests."""

    mode: I8  #: a `Mode`
    fault: I8  #: a `FirmwareFault`, the reason for FAULT
    request: I8  #: a `ModeRequest`, the last one handled
    requested: I8  #: a `ModeRequest`, the last one received from any source
    heard: I8  #: a `ModeRequest`, the one that MODE_COMMAND repeats
    pending: I8  #: a `Mode`, requested but not reached yet
    epochs: I8  #: in this mode
    good_epochs: I8  #: of the self-test, in a row


class FaultCounters(Record):
    """Fault counters since power-on."""

    crc_errors: I8  #: frames
    counter_errors: I8  #: frames with a repeated counter or one of another epoch
    disagreeing_frames: I8  #: frames that say something else than another of the same epoch
    missing_frames: I8  #: expected but not received
    bridged_epochs: I8  #: navigated with the increments of the previous epoch
    consecutive_bridged: I8  #: epochs, the gap that is being bridged
    overruns: I8  #: epochs begun too late, counted by the shell


class NavigationOutput(Record):
    """Navigation output of one epoch; the attitude is the body's."""

    epoch: I8  #: number of the epoch
    mode: I8  #: a `Mode`
    latitude: F8  #: rad
    longitude: F8  #: rad
    height: F8  #: m
    velocity_n: Annotated[Floats, 3]  #: m/s
    roll: F8  #: rad
    pitch: F8  #: rad
    heading: F8  #: rad, in [0, 2π)


class Ram(Record):
    """The firmware's whole memory."""

    parameters: Parameters
    dispatch: Annotated[Shorts, 2048]  #: action by identifier; see `intake`
    epoch: I8  #: the current one, by SYNC; -1 before the first
    steps: I8  #: since power-on
    altimeter_epochs: I8  #: since the altimeter was last heard
    consumed: I8  #: index of the first frame of the inbox that the last step left
    load_percent: F8  #: of the period, filled in by the shell
    clock: Clock
    heard: Heard
    assembly: Assembly
    gnss: Gnss
    master: Master
    antenna: Antenna
    odometer: Odometer
    wheel: Wheel
    zero_velocity: ZeroVelocity
    gyros: Fusion
    accelerometers: Fusion
    size_effect: SizeEffect
    dtheta_s: Annotated[Floats, 3]  #: rad, fused
    dv_s: Annotated[Floats, 3]  #: m/s, fused
    alignment: Alignment
    inertial_alignment: InertialAlignment
    ins: Ins
    transfer: Transfer
    carried: Ins  #: from the latest transfer on
    C_s_b: Annotated[Floats, (3, 3)]  #: of the table, from the encoders
    axis: Annotated[Records[Angle], 2]  #: that it is of
    C_b_n: Annotated[Floats, (3, 3)]  #: attitude of the body
    navigation: NavigationOutput
    sequencer: Sequencer
    modes: Modes
    faults: FaultCounters
    mode_command_counter: I8  #: of the last MODE_COMMAND, plus 1; 0: none received yet
    transmissions: I8  #: of the status messages, for their counters
    navigation_transmissions: I8  #: of the navigation messages, for their counters
    aiding_transmissions: I8  #: of AIDING_STATUS, for its counter
    heartbeats: I8  #: sent so far, for their counter
    diagnostics: DiagnosticState
    encoders: Encoders
    bridging: Bridging
    redundancy: Redundancy
    estimator: Estimator
    integrity: Integrity
    calibration: CalibrationInUse
    stimulation: Stimulation


def blank_ram() -> Records[Ram]:
    """Return an array of one zeroed `Ram` record."""
    return Ram.zeros()
