"""Records of the estimator: an error-state Kalman filter beside the strapdown navigation."""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated

from rrins.compiled.record import F8, I8, Bool, Floats, Integers, Record, Records
from rrins.dbc.contract import SENSOR_GROUPS

ATTITUDE, VELOCITY, LATITUDE, LONGITUDE, HEIGHT, BIASES = 0, 3, 6, 7, 8, 9
"""First state of each group. An error is what has to be added to the navigation: attitude, a turn
of the sensors about the axes of n (rad); velocity_n (m/s); latitude, longitude (rad); height (m);
the biases of gyros (rad/s), then of accelerometers (m/s²), along each input axis; where there is
an odometer, its scale error (1), by how much the vehicle's forward axis points to the right and up
of y of the body (rad), and how far ahead of the wheel the vehicle's pivot is (m); where the
altimeter is a measurement, its bias (m); where the vehicle sways about a known place, of its way
from there to the east, then to the north, the integral (m s) and the way (m); where a receiver's
errors last, its latitude's, longitude's and height's (m); where they are estimated, the sensors'
scale factors, asymmetries and installation errors, each of gyros, then of accelerometers."""

ODOMETER_STATES = 4
SCALE, YAW, PITCH, PIVOT = 0, 1, 2, 3
"""Place of each in the odometer's group."""

SWAY_STATES = 4
SWAY_EAST, SWAY_NORTH = 0, 2
"""Place of each pair in the group of the sway."""

SENSOR_CONSTANTS = 4
SCALE_FACTOR, ASYMMETRY, ACROSS_U, ACROSS_V = 0, 1, 2, 3
"""λ, μ (1), δu, δv (rad) of a sensor besides its bias, in this order. Paper, (13), (16), (17)."""

COMPONENTS = 3
"""Scalars of one measurement, at most."""

STATE_CAPACITY = (
    BIASES
    + 2 * (1 + SENSOR_CONSTANTS) * SENSOR_GROUPS
    + ODOMETER_STATES
    + 1
    + SWAY_STATES
    + COMPONENTS
)
RESPONSE_STATES = 14
"""States and inputs of `transition.fill`."""

PRESENT, DONE = 0, 1
"""Place of the present second's sums, and of those of the second that is worked on."""

TRACK_EPOCHS = 4096
"""Epochs of the navigation that are kept, for measurements of the past; 2 s at 2 kHz."""


ESTIMATOR_HISTORY_S = 32
"""Seconds of what was estimated that are kept."""


PAST, PAST_S = 72, 16
"""Times at which the biases were noted, and s from one to the next: more than the longest window
of the redundancy, and half of it, in which a fault may have begun."""


NEVER = -3
"""No epoch, nor the one before or after any."""


class Aid(IntEnum):
    """Sources that aid the navigation."""

    ZERO_VELOCITY = 0
    KNOWN_POSITION = 1
    GNSS_POSITION = 2
    GNSS_VELOCITY = 3
    ODOMETER = 4
    ALTIMETER = 5


AIDS = len(Aid)
MOST_DISTRUST, NO_TRUST = 30, 10
"""Largest `Source.distrust`, and from where on a source counts as rejected."""


LEVEL = 2
"""The first components of a velocity."""

AGREEMENT_FIXES = 128
"""Fixes whose innovations are summed."""

CORRECTIONS = 4
"""Feedbacks that are kept, one a second: a fix may be 2 s old, and wait for another second."""


class Source(Record):
    """How the measurements of one kind fared since navigation or fine alignment began."""

    used: I8  #: scalars
    rejected: I8  #: scalars that failed the gate
    rejected_in_a_row: I8  #: of these, without one that passed
    distrust: I8  #: rises by 3 with each that is rejected, falls by 1 with each that is used
    squares: F8  #: sum of the innovations' squares over their variance, of those used


class EstimatorSecond(Record):
    """Estimates at the end of a second, and how the measurements fared until then."""

    epoch: I8  #: its last
    attitude_sigma: Annotated[Floats, 3]  #: rad, about east, north, up
    velocity_sigma: Annotated[Floats, 3]  #: m/s, east, north, up
    position_sigma: Annotated[Floats, 3]  #: m, east, north, up
    bias: Annotated[Floats, (2, SENSOR_GROUPS)]  #: rad/s of gyros, m/s² of accelerometers
    bias_sigma: Annotated[Floats, (2, SENSOR_GROUPS)]  #: rad/s, m/s²
    constant: Annotated[Floats, (2 * SENSOR_CONSTANTS, SENSOR_GROUPS)]  #: as in `Estimator`
    constant_sigma: Annotated[Floats, (2 * SENSOR_CONSTANTS, SENSOR_GROUPS)]  #: 1, 1, rad, rad
    odometer: Annotated[Floats, ODOMETER_STATES]  #: as in `Estimator`
    odometer_sigma: Annotated[Floats, ODOMETER_STATES]  #: 1, rad, rad, m
    altimeter_bias: F8  #: m
    altimeter_bias_sigma: F8  #: m
    protection: Annotated[
        Floats, 3
    ]  #: bounds of the error: horizontal, vertical (m), heading (rad)
    limit: Annotated[Integers, 3]  #: number of the fault that sets each of them; -1: none does
    integrity: I8  #: an `IntegrityStatus`
    aided_by: I8  #: in this second, one bit each `Aid`
    rejecting: I8  #: whose last scalar failed the gate, one bit each `Aid`
    used: Annotated[Integers, AIDS]  #: as in `Source`
    rejected: Annotated[Integers, AIDS]  #: as in `Source`
    squares: Annotated[Floats, AIDS]  #: as in `Source`


class Estimator(Record):
    """An error-state Kalman filter, updated once a second, one piece of work in an epoch."""

    enabled: Bool
    running: Bool  #: since the strapdown runs
    begins_anew: Bool  #: a sensor was left out: what was found with it counts no more
    fine_epochs: I8  #: length of the fine alignment; 0: none
    heading_sigma_enough: F8  #: rad, ends the fine alignment before; 0: never
    second_epochs: I8
    states: I8  #: used of the capacity
    vertical: Bool  #: whether the vertical channel is free
    zero_velocity_sigma: F8  #: m/s, of each component at standstill
    position_sigma: F8  #: m, of each component of a known position
    fed_back: Annotated[Floats, 12]  #: to attitude, velocity, rates, force since the last block
    aided_epoch: I8  #: of the last measurement that was used
    # What a faulty sensor may have done; see `doubt`.
    doubts: Bool  #: something was told that is not in P yet
    doubt_kind: I8  #: of the suspects, 0: gyros, 1: accelerometers
    doubt_anew: Bool  #: a new fault, and not one that has grown
    doubt_epoch: I8  #: since which it may have lasted
    doubt_effect: Annotated[Floats, (SENSOR_GROUPS, BIASES)]  #: on the navigation until now
    doubt_size: Annotated[Floats, SENSOR_GROUPS]  #: rad/s, m/s², 0: not suspected
    change: Annotated[Floats, (2, SENSOR_GROUPS)]  #: rad/s, m/s², of a fault since it was told
    changed_size: Annotated[Floats, (2, SENSOR_GROUPS)]  #: rad/s, m/s², of one that has changed
    kept_size: Annotated[Floats, (2, SENSOR_GROUPS)]  #: rad/s, m/s², of one that fails and is used
    kept_before: Annotated[Floats, (2, SENSOR_GROUPS)]  #: that of the second before
    kept_bias: Annotated[Floats, (2, SENSOR_GROUPS)]  #: rad/s, m/s², before it failed
    kept_variance: Annotated[Floats, (2, SENSOR_GROUPS)]
    doubt_variance: Annotated[Floats, (2, SENSOR_GROUPS)]  #: added to that of the bias
    doubted_epoch: I8  #: of the last change of these; -1: none
    jolt: F8  #: m/s², change of force by a fault of an accelerometer
    told_epoch: Annotated[Integers, 2]  #: of the first of one fault
    unaided: Annotated[Integers, 2]  #: whether nothing has aided since the fault began
    jump_effect: Annotated[Floats, (2, SENSOR_GROUPS, BIASES)]  #: goes with `jump_size`, unaided
    jump_size: Annotated[Floats, (2, SENSOR_GROUPS)]  #: rad/s, m/s²
    settles: I8  #: kinds of which a sensor was left out, one bit each
    settled_sensor: Annotated[Integers, 2]
    settled_value: Annotated[Floats, 2]  #: rad/s, m/s², of its fault
    settled_sigma: Annotated[Floats, 2]
    bias_before: Annotated[Floats, (2, SENSOR_GROUPS)]  #: rad/s, m/s², before the fault
    variance_before: Annotated[Floats, (2, SENSOR_GROUPS)]
    past_bias: Annotated[Floats, (PAST, 2, SENSOR_GROUPS)]  #: a ring, by `past_count`
    past_variance: Annotated[Floats, (PAST, 2, SENSOR_GROUPS)]
    past_epoch: Annotated[Integers, PAST]
    past_count: I8
    gate: F8  #: standard deviations of an innovation that is used
    # The data sheets.
    attitude_sigma: Annotated[Floats, 3]  #: rad, at the beginning, in n
    velocity_sigma: F8  #: m/s, at the beginning
    start_sigma: F8  #: m, of the position at the beginning
    odometer_sigma: Annotated[Floats, ODOMETER_STATES]  #: 1, rad, rad, m
    slip_sigma: F8  #: m/s, of the velocity across the vehicle's forward axis
    altimeter_sigma: F8  #: m, of a height
    altimeter_bias_sigma: F8  #: m, at the beginning
    altimeter_walk_variance: F8  #: m²/s, of the bias
    bias_sigma: Annotated[Floats, 2]  #: rad/s, m/s², of each gyro and accelerometer
    white_variance: Annotated[Floats, (2, SENSOR_GROUPS)]  #: rad²/s, m²/s³
    walk_variance: Annotated[Floats, (2, SENSOR_GROUPS)]  #: (rad/s)²/s, (m/s²)²/s
    turn_variance: Annotated[Floats, 2]  #: of a bias, by the rad that the sensors turn
    slope_variance: Annotated[Floats, 2]  #: of scale factors and installation, dimensionless
    constant_sigma: Annotated[Floats, 2 * SENSOR_CONSTANTS]  #: 1, 1, rad, rad, at the beginning
    transverse: Annotated[Floats, (2, SENSOR_GROUPS, 2, 3)]  #: u and v of each sensor
    # What the compensation removes.
    gyro_bias: Annotated[Floats, SENSOR_GROUPS]  #: rad/s
    accelerometer_bias: Annotated[Floats, SENSOR_GROUPS]  #: m/s²
    odometer: Annotated[Floats, ODOMETER_STATES]  #: scale, forward axis, pivot
    constants: Bool  #: whether scale factors and installation errors are states
    constants_state: I8  #: the first of them
    constant: Annotated[Floats, (2 * SENSOR_CONSTANTS, SENSOR_GROUPS)]  #: of gyros, accelerometers
    altimeter: Bool  #: whether it is a measurement
    altimeter_state: I8  #: of its bias
    heights_refused: I8  #: of it, in a row, while the receiver's passed
    fix_height_epoch: I8  #: of the receiver's last height that passed; -1: none
    altimeter_bias: F8  #: m
    sway: Bool  #: whether the vehicle sways about a known place
    sway_state: I8  #: of the first of its states
    sway_way: Annotated[Floats, SWAY_STATES]  #: m s, m, east; the same north
    sway_transition: Annotated[Floats, (2, 2)]  #: of a pair of them, over a second
    sway_spread: Annotated[Floats, (2, 2)]  #: that the second adds to a pair's covariance, for 1 m²
    receiver: Bool  #: whether the receiver's position has errors that last
    receiver_state: I8  #: of the first of them
    receiver_error: Annotated[Floats, COMPONENTS]  #: m, of latitude, longitude, height
    receiver_variance: F8  #: m², of each
    receiver_share: F8  #: of an error that is left after a second
    receiver_doubted: Bool  #: an odometer, and not the receiver, agrees with the filter
    agreement_sum: Annotated[
        Floats, (2, AGREEMENT_FIXES, LEVEL)
    ]  #: of normalised innovations, rings
    agreement_count: Annotated[Integers, 2]  #: measurements of receiver and odometer in it
    normalised: F8  #: the last innovation over its sigma
    # Standing, as the sensors feel it.
    detects_standing: Bool
    standing: Bool  #: for `STEADY_S` of `standstill`, up to the end of the last second
    steady_s: I8  #: seconds without a change of force or attitude
    felt_n: Annotated[Floats, 3]  #: m/s, sum of the increments of the second
    felt_square: F8  #: m²/s², sum of their squares
    body_n: Annotated[Floats, (3, 3)]  #: C_b_n at the end of the second before
    # A filter that rejects everything.
    others_used: I8  #: scalars of aids that do not come from the receiver
    locked_s: I8  #: seconds in which the receiver was rejected, and nothing else helped
    excess: F8  #: largest square of a rejected innovation of the second over that of the filter
    reopened: Bool  #: in the last second
    used_epoch: Annotated[Integers, (AIDS, COMPONENTS)]  #: of the last measurement used; -1: none
    reopenings: I8  #: since the filter began
    # The present second, and the one that is worked on.
    epochs: I8  #: of the present second
    epoch: I8  #: at whose end the filter stands
    stage: I8  #: next piece of work
    force_n: Annotated[Floats, (2, 3)]  #: m/s, integral of the specific force
    way_n: Annotated[Floats, (2, 3)]  #: m, integral of the velocity
    turn_n: Annotated[Floats, (2, 3)]  #: rad, integral of what the gyros sense
    attitude_s: Annotated[Floats, (2, 3, 3)]  #: s, integral of C_s_n
    turned: Annotated[Floats, 2]  #: rad, amount of the turn
    bridged: Annotated[Floats, 2]  #: rad², m²/s²: what gaps may have cost, a second ago
    moved_s: Annotated[Floats, (2, 2, 3, 3, 3)]  #: rad, m/s, integral of C_s_n times the increments
    size_s: Annotated[Floats, (2, 2, SENSOR_GROUPS, 3, 3)]  #: the same, amounts along input axes
    seconds: Annotated[Floats, 2]
    # The navigation at the end of the epoch at which the filter stands, as corrected since.
    velocity_n: Annotated[Floats, 3]  #: m/s
    latitude: F8  #: rad
    longitude: F8  #: rad
    height: F8  #: m
    north_radius: F8  #: m, of the meridian and the height
    east_radius: F8  #: m, times the cosine of the latitude
    # The navigation of each epoch, a ring, and what has been added to it since.
    track: Annotated[Floats, (TRACK_EPOCHS, 6)]  #: latitude, longitude, height, velocity_n
    track_first: I8  #: epoch
    correction: Annotated[Floats, (CORRECTIONS, 6)]  #: the last ones, in the order of the track
    correction_epoch: Annotated[Integers, CORRECTIONS]  #: at whose end each was made; -1: none
    corrections: I8  #: made so far
    # The filter.
    x: Annotated[Floats, STATE_CAPACITY]
    applied: Annotated[Floats, BIASES]  #: of x, what was fed back last
    P: Annotated[Floats, (STATE_CAPACITY, STATE_CAPACITY)]
    sigma: Annotated[Floats, STATE_CAPACITY]  #: of what has been fed back, for the next second
    # Measurements that wait, one bit each scalar.
    waiting: I8
    fix_epoch: I8  #: at whose end the fix was valid
    fix_position: Annotated[Floats, 3]  #: latitude, longitude (rad), height (m)
    fix_velocity_n: Annotated[Floats, 3]  #: m/s
    fix_sigma: Annotated[Floats, 2]  #: m, m/s
    fix_lever_n: Annotated[Floats, 3]  #: m, from the reference point to the antenna
    fix_lever_velocity_n: Annotated[Floats, 3]  #: m/s, of the antenna against that
    heights: I8  #: of the altimeter in the present second
    height_sum: F8  #: m, of these, less the navigation's
    height_epochs: I8  #: sum of their epochs since the filter's
    height_difference: F8  #: m, mean of the second before, that waits
    height_count: I8  #: of its heights
    height_after_s: F8  #: from where the filter stands to its mean time; negative
    odometer_epoch: I8  #: at whose end the stretch that waits, or the next one, begins; -1: nowhere
    odometer_gaps: I8  #: of the odometer, then
    odometer_travelled: F8  #: m, then
    ways_refused: I8  #: of these, forward, in a row
    wheel_locked: Bool  #: whether it stood while the vehicle moved, and has not turned since
    stretch_m: F8  #: that waits
    stretch_s: F8
    stretch_lag_s: F8  #: from its middle to where the filter stands
    stretch_turned: F8  #: rad, about up
    stretch_b: Annotated[Floats, 3]  #: m, the same by the navigation
    lever_way_b: Annotated[Floats, 3]  #: m, of that by the lever arm, which turns
    stretch_attitude: Annotated[Floats, (3, 3)]  #: C_b_n, its mean over the stretch
    C_b_v: Annotated[Floats, (3, 3)]  #: axes of the vehicle: right, forward, up
    vehicle_way: Annotated[Floats, 3]  #: `stretch_b` along these
    velocity_way: Annotated[Floats, 3]  #: along these or the body's, without `lever_way_b`
    vehicle_attitude: Annotated[Floats, (3, 3)]  #: C_v_n of the stretch
    sources: Annotated[Records[Source], AIDS]  #: by `Aid`
    # What is told.
    aligned_epochs: I8  #: length of the last fine alignment, so far
    aligned_epoch: I8  #: of it, the last one; `NEVER`: none
    history: Annotated[Records[EstimatorSecond], ESTIMATOR_HISTORY_S]  #: by `history_count`
    history_count: I8  #: seconds noted
    transmissions: I8
    # Scratch.
    transition: Annotated[Floats, (BIASES, STATE_CAPACITY)]  #: the others last
    work: Annotated[Floats, (BIASES, STATE_CAPACITY)]
    row: Annotated[Floats, STATE_CAPACITY]
    gain: Annotated[Floats, STATE_CAPACITY]
    response: Annotated[Floats, (RESPONSE_STATES, RESPONSE_STATES)]
    direction: Annotated[Floats, 3]
    C_b_n: Annotated[Floats, (3, 3)]
