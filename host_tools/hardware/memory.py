"""The hardware's whole state, as one record of fixed size."""

from __future__ import annotations

from typing import Annotated

from rrins.compiled.record import F8, I8, U4, Bool, Bytes, Floats, Integers, Record, Records, Words
from rrins.dbc.contract import SENSOR_GROUPS

INNER, OUTER = 0, 1
"""Index of an axis in arrays over the two axes."""

FLICKER_POLES = 6
"""Gauss-Markov processes that make up a sensor's bias instability."""

LATENCY_CAPACITY = 32
"""Longest latency of a sensor, epochs."""

FAULT_CAPACITY = 32
"""The most faults of the hardware that can be present or planned at a time."""

OUTAGE_CAPACITY = 256
"""The most outages of the GNSS receiver, and of the master unit."""

MOTION_CHANNELS, MOTION_TERMS = 15, 8
"""Channels and polynomial terms of a piece of motion, see `rrins.host_tools.hardware.motion`."""


class Sensors(Record):
    """The sensors of one kind; an increment is in rad for gyros, in m/s for accelerometers."""

    count: I8  #: sensors of the kind
    axis: Annotated[Floats, (SENSOR_GROUPS, 3)]  #: true input axes, installation errors included
    mounted_axis: Annotated[Floats, (SENSOR_GROUPS, 3)]  #: the same before the mount shifted
    axis_by_angle: Annotated[Floats, (SENSOR_GROUPS, 2, 3)]  #: derivative by δu and by δv
    scale_error: Annotated[Floats, SENSOR_GROUPS]  #: λ, a share of 1, temperature included
    asymmetric_scale_error: Annotated[Floats, SENSOR_GROUPS]  #: μ, a share of 1
    bias_increment: Annotated[Floats, SENSOR_GROUPS]  #: b dt, drift included
    noise_increment: Annotated[Floats, SENSOR_GROUPS]  #: standard deviation per epoch
    g_sensitivity: Annotated[Floats, SENSOR_GROUPS]  #: rad/s per m/s² along the input axis
    displaced: Bool  #: whether any accelerometer is away from the reference point
    position_s: Annotated[Floats, (SENSOR_GROUPS, 3)]  #: m, from the reference point
    arm_increment: Annotated[Floats, SENSOR_GROUPS]  #: m/s, size effect of the epoch
    range_increment: F8  #: range × dt
    dead_zone_increment: Annotated[Floats, SENSOR_GROUPS]  #: dead zone × dt
    resolution: F8  #: increment, of the sensor itself; 0: finer than the frame's
    resolution_remainder: Annotated[Floats, SENSOR_GROUPS]  #: increment carried to the next epoch
    # Bandwidth and latency
    lags: Bool  #: whether there is any
    lag_share: F8  #: of its state that the first-order low pass keeps over an epoch
    lag_mean: F8  #: the same on average over the epoch
    lag_state: Annotated[Floats, SENSOR_GROUPS]  #: increment
    latency_epochs: I8  #: whole ones
    latency_fraction: F8  #: of an epoch, on top
    history: Annotated[Floats, (SENSOR_GROUPS, LATENCY_CAPACITY)]  #: increments, a ring
    history_at: I8  #: position of the current epoch in it
    # Drifting errors, updated every `drift_epochs` of the plant
    drifts: Bool  #: whether anything does
    constant_bias_increment: Annotated[Floats, SENSOR_GROUPS]  #: constant part of the bias
    constant_scale_error: Annotated[Floats, SENSOR_GROUPS]  #: constant part of λ
    bias_temperature_increment: Annotated[Floats, SENSOR_GROUPS]  #: increment per K
    scale_temperature: Annotated[Floats, SENSOR_GROUPS]  #: λ per K
    flicker_decay: Annotated[Floats, FLICKER_POLES]  #: share kept from one update to the next
    flicker_drive: Annotated[Floats, (SENSOR_GROUPS, FLICKER_POLES)]  #: increment, deviation
    flicker_state: Annotated[Floats, (SENSOR_GROUPS, FLICKER_POLES)]  #: increment
    walk_drive: Annotated[Floats, SENSOR_GROUPS]  #: increment, standard deviation of an update
    walk_state: Annotated[Floats, SENSOR_GROUPS]  #: increment
    # Faults and their effects
    stuck: U4  #: one bit per sensor
    absent: U4  #: one bit per sensor
    dead: U4  #: one bit per sensor
    full_scale: U4  #: one bit per sensor
    fault_scale_error: Annotated[Floats, SENSOR_GROUPS]  #: a share of 1
    fault_bias_increment: Annotated[Floats, SENSOR_GROUPS]  #: increment
    fault_noise_increment: Annotated[Floats, SENSOR_GROUPS]  #: standard deviation per epoch
    # Output
    remainder: Annotated[Floats, SENSOR_GROUPS]  #: counts carried into the next epoch
    counts: Annotated[Integers, SENSOR_GROUPS]  #: increments in units of the frame
    saturated: U4  #: one bit per sensor, in this epoch
    noise_state: Annotated[Words, SENSOR_GROUPS]  #: of each sensor's random numbers
    noise_spare: Annotated[Floats, SENSOR_GROUPS]  #: second normal number of a pair
    noise_has_spare: Annotated[Bytes, SENSOR_GROUPS]  #: 0 or 1


class WaitingCommand(Record):
    """An axis command that waits for its epoch."""

    valid: Bool  #: whether there is one
    command: I8  #: an `AxisCommand`
    target: F8  #: rad
    rate: F8  #: rad/s


class TurntableAxis(Record):
    """One axis of the turntable."""

    rate_limit: F8  #: rad/s
    acceleration_limit: F8  #: rad/s²
    ramp_smoothing: I8  #: epochs over which the acceleration rises; 0: at once
    encoder_step_deg: F8  #: resolution of the encoder
    encoder_offset_deg: F8  #: encoder reading minus true angle
    ripple: F8  #: rad, amplitude
    ripple_per_turn: F8  #: periods
    stiction: F8  #: rad, wind-up of the drive before the table follows
    run_out: F8  #: m, of the sensors' centre from the axis
    state: I8  #: an `AxisState`
    waiting: Annotated[Records[WaitingCommand], 2]  #: by the epoch they belong to, even and odd
    command: I8  #: an `AxisCommand`, the active one
    target: F8  #: rad, as commanded
    commanded_rate: F8  #: rad/s
    drive_angle: F8  #: rad, of the motor's shaft at the end of the epoch
    drive_rate: F8  #: rad/s
    drive_acceleration: F8  #: rad/s²
    sticks: Bool  #: whether stiction holds the load
    load_angle: F8  #: rad, of the table without the ripple
    angle: F8  #: rad, of the table at the end of the epoch
    rate: F8  #: rad/s, of the table at the end of the epoch
    cosine: F8  #: of `trig_angle`; 0: not known yet
    sine: F8  #: of `trig_angle`
    trig_angle: F8  #: rad
    angle_before: F8  #: rad, at the beginning of the epoch
    rate_before: F8  #: rad/s, at the beginning of the epoch
    # The profile being driven: ramp up, cruise, ramp down, in whole epochs.
    profile_start: F8  #: rad
    profile_end: F8  #: rad
    profile_rate: F8  #: rad/s, signed peak
    profile_ramp: I8  #: epochs of each ramp
    profile_cruise: I8  #: epochs
    profile_epoch: I8  #: epochs driven so far
    # Following a target that moves.
    is_following: Bool  #: whether it did in the epoch before
    followed: F8  #: rad, the target of the epoch before
    # Braking: the remaining acceleration fades, then the rate goes to zero.
    brake_acceleration: F8  #: rad/s², still fading
    brake_rate: F8  #: rad/s, when the rate begins to fall to zero
    brake_epochs: I8  #: duration of the fall
    brake_epoch: I8  #: epochs of the fall so far
    # Faults
    blocked: Bool  #: the table is stuck
    runaway: Bool  #: the drive turns at `runaway_rate`, whatever is commanded
    runaway_rate: F8  #: rad/s
    encoder_stuck: Bool  #: the encoder repeats `encoder_held_deg`
    encoder_held_deg: F8  #: last reading of the encoder
    encoder_error_deg: F8  #: encoder reading minus true angle
    encoder_slip: F8  #: share of the turning that the encoder misses
    encoder_slipped_deg: F8  #: what it has missed so far


class FrameCounters(Record):
    """Errors that the hardware found in received frames."""

    crc_errors: I8  #: frames
    counter_errors: I8  #: frames that are repeated or late
    missing_commands: I8  #: axis commands not received by their epoch
    overruns: I8  #: epochs begun too late, counted by the shell


class Truth(Record):
    """True state of the vehicle and the table at the end of an epoch."""

    epoch: I8  #: number of the epoch
    latitude: F8  #: rad
    longitude: F8  #: rad
    height: F8  #: m
    velocity_n: Annotated[Floats, 3]  #: m/s
    roll: F8  #: rad, of the body
    pitch: F8  #: rad, of the body
    heading: F8  #: rad, of the body
    axis_angle: Annotated[Floats, 2]  #: rad, by `INNER` and `OUTER`


OPERATOR_CAPACITY = 32
"""Most requests of the operator in a run."""


class Operator(Record):
    """The operator's requests to the navigation computer, with their times."""

    count: I8  #: requests in all
    epoch: Annotated[Integers, OPERATOR_CAPACITY]  #: of each request, in order
    request: Annotated[Integers, OPERATOR_CAPACITY]  #: as `mode_request` of MODE_COMMAND
    next: I8  #: index of the next one
    present: I8  #: as `mode_request`, the one being repeated
    transmissions: I8  #: of MODE_COMMAND, for its counter


STANDING_CAPACITY = 32
"""Most times in a run in which the operator says that the vehicle stands."""


class StandingTimes(Record):
    """When the operator says that the vehicle stands."""

    count: I8  #: times in all
    first: Annotated[Integers, STANDING_CAPACITY]  #: epoch
    last: Annotated[Integers, STANDING_CAPACITY]  #: epoch
    sigma: Annotated[Floats, STANDING_CAPACITY]  #: m/s, how still
    present: I8  #: which is present, from 0; negative: none
    transmissions: I8  #: of ZERO_VELOCITY, for its counter


READMISSION_CAPACITY = 16
"""Most orders to readmit a sensor in a run."""


class ReadmissionOrders(Record):
    """READMISSION_COMMAND: its orders for the operator, and when they act."""

    count: I8  #: orders in all
    next: I8  #: index of the next one
    epoch: Annotated[Integers, READMISSION_CAPACITY]  #: of each order, in order
    kind: Annotated[Integers, READMISSION_CAPACITY]
    sensor: Annotated[Integers, READMISSION_CAPACITY]
    anew: Annotated[Integers, READMISSION_CAPACITY]
    test_s: Annotated[Integers, READMISSION_CAPACITY]


class TableErrors(Record):
    """Alignment errors of the axes relative to each other."""

    is_crooked: Bool  #: whether any of the following is not zero
    non_orthogonality: F8  #: rad, of the inner axis from the right angle to the outer, about y
    wobble: F8  #: rad, of the inner axis
    wobble_per_turn: F8  #: periods


class Temperature(Record):
    """The sensors' temperature over time since power-on."""

    ambient_offset: F8  #: K, of the surroundings above the calibration temperature
    warm_up: F8  #: K, final self-heating of the sensors above the surroundings
    time_constant: F8  #: s, of warming up


class AltimeterState(Record):
    """The barometric altimeter."""

    fitted: Bool  #: whether there is one
    bias: F8  #: m
    noise: F8  #: m, standard deviation
    random_walk: F8  #: m/√s, of the bias
    fault_height: F8  #: m, by which a fault makes heights wrong
    noise_state: Annotated[Words, 1]  #: of its random numbers
    noise_spare: Annotated[Floats, 1]  #: second normal number of a pair
    noise_has_spare: Annotated[Bytes, 1]  #: 0 or 1


class GnssState(Record):
    """The GNSS receiver, see `rrins.host_tools.hardware.gnss`."""

    fitted: Bool  #: whether there is one
    interval_epochs: I8  #: between fixes
    latency_epochs: I8  #: from validity to the frames, less than the interval
    position_noise: F8  #: m, standard deviation of each component
    velocity_noise: F8  #: m/s, the same
    position_sigma: F8  #: m, of all errors, as the receiver tells it
    velocity_sigma: F8  #: m/s, of each component, as it tells it
    position_correlated_noise: F8  #: m, standard deviation of the errors that last
    correlated_share: F8  #: of them that is left at the next fix
    correlated: Annotated[Floats, 3]  #: m, east, north, up
    correlated_begun: Bool  #: whether they have been drawn
    has_lever_arm: Bool  #: whether the antenna is away from the reference point
    lever_arm: Annotated[Floats, 3]  #: m, from there to the antenna, in the body frame
    antenna_n: Annotated[Floats, 3]  #: m, the same in n, scratch
    antenna_velocity_n: Annotated[Floats, 3]  #: m/s, of the antenna against there, scratch
    outage_count: I8
    outage_first: Annotated[Integers, OUTAGE_CAPACITY]  #: epoch
    outage_last: Annotated[Integers, OUTAGE_CAPACITY]  #: epoch
    # Faults
    lost: Bool  #: whether it has no fix
    fault_position: Annotated[Floats, 3]  #: m, east, north, up
    fault_velocity: Annotated[Floats, 3]  #: m/s, the same
    waiting: Bool  #: whether anything has been measured
    epoch: I8  #: at whose end it was
    word: Annotated[Words, 5]  #: payloads of the group
    noise_state: Annotated[Words, 1]  #: of its random numbers
    noise_spare: Annotated[Floats, 1]  #: second normal number of a pair
    noise_has_spare: Annotated[Bytes, 1]  #: 0 or 1


class MasterState(Record):
    """The master unit, see `rrins.host_tools.hardware.master`."""

    present: Bool  #: whether there is one
    interval_epochs: I8  #: between transfers
    latency_epochs: I8  #: from validity to the frames, less than the interval
    attitude_error: Annotated[Floats, 3]  #: rad, of roll, pitch, heading
    velocity_error: Annotated[Floats, 3]  #: m/s, east, north, up
    position_error: Annotated[Floats, 3]  #: m, east, north, up
    level_sigma_arcsec: F8  #: as it tells it
    heading_sigma_arcsec: F8  #: as it tells it
    velocity_sigma: F8  #: m/s, as it tells it
    position_sigma: F8  #: m, as it tells it
    outage_count: I8
    outage_first: Annotated[Integers, OUTAGE_CAPACITY]  #: epoch
    outage_last: Annotated[Integers, OUTAGE_CAPACITY]  #: epoch
    waiting: Bool  #: whether there is anything to send
    epoch: I8  #: at whose end it is valid
    word: Annotated[Words, 8]  #: payloads of the group


class OdometerState(Record):
    """The odometer, see `rrins.host_tools.hardware.odometer`."""

    fitted: Bool  #: whether there is one
    interval_epochs: I8  #: between counts
    latency_epochs: I8  #: from a count to its frame, less than the interval
    metres_per_pulse: F8  #: in truth, scale error included
    noise: F8  #: m/s, standard deviation of the mean speed over an interval
    forward_b: Annotated[Floats, 3]  #: the vehicle's forward axis in the body frame, of length 1
    has_lever_arm: Bool  #: whether the wheel is away from the reference point
    lever_arm: Annotated[Floats, 3]  #: m, from there to the wheel's contact, in the body frame
    speed: F8  #: m/s, of the wheel at the end of the epoch
    rolled: F8  #: m, since the last count
    counted: F8  #: pulses since power-on, with their fraction
    missed: Bool  #: whether it did not count at some time since the last count
    # Faults
    slip: F8  #: by which the wheel turns more than the vehicle moves, a share of 1
    locked: Bool  #: whether the wheel stands
    lost: Bool  #: whether it does not count
    waiting: Bool  #: whether anything has been counted
    epoch: I8  #: at whose end it was
    word: Annotated[Words, 1]  #: payload of the last count
    noise_state: Annotated[Words, 1]  #: of its random numbers
    noise_spare: Annotated[Floats, 1]  #: second normal number of a pair
    noise_has_spare: Annotated[Bytes, 1]  #: 0 or 1


class PlannedFaults(Record):
    """Faults of the hardware, see `rrins.host_tools.hardware.faults`."""

    count: I8  #: present and planned
    changes_at: I8  #: next epoch in which the active faults change
    kind: Annotated[Integers, FAULT_CAPACITY]  #: a `HardwareFault`
    target: Annotated[Integers, FAULT_CAPACITY]  #: index of an axis or a sensor, or `EVERY`
    first_epoch: Annotated[Integers, FAULT_CAPACITY]  #: of activity
    last_epoch: Annotated[Integers, FAULT_CAPACITY]  #: of activity
    value: Annotated[Floats, FAULT_CAPACITY]  #: in the unit of its kind, see `HardwareFault`
    period_epochs: Annotated[Integers, FAULT_CAPACITY]  #: of an intermittent fault; 0: always there
    on_epochs: Annotated[Integers, FAULT_CAPACITY]  #: of each period, its first


class Plant(Record):
    """The hardware's whole memory."""

    period_ns: I8  #: length of an epoch
    epoch: I8  #: the next one
    drift_epochs: I8  #: between updates of the drifting errors
    motion_start: I8  #: epoch in which the motion begins
    piece_count: I8  #: pieces of motion; 0: the vehicle rests
    piece_epochs: I8  #: length of a piece of motion
    loop_from: I8  #: piece to continue with after the last; negative: rest
    omega_ib_b: Annotated[Floats, 3]  #: rad/s, angular rate of the body
    specific_force_b: Annotated[Floats, 3]  #: m/s²
    dtheta_s: Annotated[Floats, 3]  #: rad, true increment of the epoch
    dv_s: Annotated[Floats, 3]  #: m/s, true increment of the epoch
    omega_is_s: Annotated[Floats, 3]  #: rad/s, of the sensor frame at the end of the epoch
    omega_square_s: Annotated[Floats, (3, 3)]  #: rad²/s, ∫ ω ωᵀ dt of the epoch
    held: Bool  #: whether the stored increments at rest are still valid
    table: TableErrors
    thermal: Temperature
    altimeter: AltimeterState
    gnss: GnssState
    master: MasterState
    odometer: OdometerState
    faults: PlannedFaults
    axis: Annotated[Records[TurntableAxis], 2]  #: by `INNER` and `OUTER`
    gyros: Sensors
    accelerometers: Sensors
    truth: Truth
    operator: Operator
    readmissions: ReadmissionOrders
    standing: StandingTimes
    counters: FrameCounters
    heartbeats: I8  #: sent so far, for their counter
