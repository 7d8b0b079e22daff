"""Records of the redundancy in the RAM image.

All sums are in the unit of the increments: rad for gyros, m/s for accelerometers.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated

from rrins.compiled.record import F8, I8, Bool, Floats, Integers, Record, Records
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.maths.angles import Angle

GYROS, ACCELEROMETERS = 0, 1
"""Kinds of sensors."""


class SensorKind(IntEnum):
    """Kind of one sensor; the DBC's value table of `kind`."""

    GYRO = GYROS
    ACCELEROMETER = ACCELEROMETERS


WINDOWS_S = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024)
"""Windows of whole seconds: a step shows best in the one that began when it came."""

SECOND_LEVELS = len(WINDOWS_S)

EPOCH_LEVELS = 10
"""Windows of 1, 2, 4, … epochs that are shorter than a second, at most."""

FINE_LEVELS, FINE_CAPACITY = WINDOWS_S.index(128) + 1, 129
"""Windows of up to 128 s begin at any second."""

COARSE_S, COARSE_CAPACITY = 16, 65
"""Longer windows begin at multiples of this time."""

LONGEST_S = WINDOWS_S[-1]
"""Longest window, s."""

OUTER_TURN = 7
"""Regressor of the outer axis' turn, rad: what is learned of it is by how much the table is not
square."""

ABSOLUTE = 8
"""First regressor that is an absolute value; before: time, own and other vector increment, turn."""

REGRESSORS = ABSOLUTE + SENSOR_GROUPS
"""Number of regressors of the parity of sound sensors."""

SETTLED_S = 10
"""Seconds after a stop in which nothing is learned or concluded, and before a start in which
nothing is learned: a vehicle pitches by less than counts as motion and more than a sensor errs."""

LATE_S = 32
"""Seconds after which something is learned: so long, a fault is not learned before it shows."""

NOISE_S = 32
"""Window of the test of the variance, s."""

BLOCK_FLOATS = 98304
"""Memory for the blocks of one second from which the history is repaired, numbers."""

HISTORY_S = 32
"""Seconds of which parity and residuals are kept; more than a reader lets pass."""

TEST_LEAST_S, TEST_LONGEST_S = 10, 3600
"""Limits of the length of the test before a sensor is readmitted."""

BEFORE_S = 5
"""Seconds before an alarm that its freeze frames have."""

BLOCK_OTHERS = 62
"""Numbers of a block that are not by sensor, see `redundancy.blocks`."""

BANK_SENSORS = 4
"""Sensors of a kind among which the bank tells: as many as have one parity."""

BANK_CAPACITY = BANK_SENSORS * BANK_SENSORS + 3
"""Filters of the bank: each pair of sensors of both kinds left out, none, and all alike by kind."""

FILTER_STATES, NAVIGATION_STATES = 12, 14
"""States of a filter, and of the navigation's error, see `estimator.transition`."""

BANK_STATES = FILTER_STATES + 2
"""States of the bank's filters: those, then the odometer's scale (1), and by how much the vehicle's
forward axis points to the right of y of the body (rad)."""

VELOCITY_EPOCHS = 2048
"""Epochs of which the velocity is kept: two seconds, the oldest that a fix may be."""


class Found(IntEnum):
    """How a faulty sensor was found; the DBC's value table of `how`."""

    NOT = 0
    PARITY = 1
    STANDING = 2
    STUCK = 3
    ABSENT = 4
    REFERENCE = 5
    OPERATOR = 6
    FULL_SCALE = 7


class ReadmissionOrder(IntEnum):
    """Orders of the operator about a sensor that is left out; the DBC's value table of `order`."""

    NONE = 0
    TEST = 1
    STOP = 2


class ReadmissionState(IntEnum):
    """Where a sensor is on its way back; the DBC's value table of `state`."""

    NONE = 0
    TESTING = 1
    READMITTED = 2
    REFUSED = 3
    STOPPED = 4


class Refusal(IntEnum):
    """Why a sensor is not readmitted; the DBC's value table of `refusal`.

    NOT_LEFT_OUT: it is in use, or there is none of that number. NOT_COMPARABLE: nothing depends on
    it. PARITY: it differs from the others. LIMITS: its bias is far beyond the data sheet.
    MISSING: it is absent too often. STUCK: it repeats itself. SET_CHANGED: another sensor was
    excluded or came back meanwhile.
    """

    NONE = 0
    NOT_LEFT_OUT = 1
    NOT_COMPARABLE = 2
    PARITY = 3
    LIMITS = 4
    MISSING = 5
    STUCK = 6
    SET_CHANGED = 7


class Learner(Record):
    """Parity of sound sensors as it was learned: linear in the regressors.

    `covariance` times `unit` is the covariance of a row of `coefficients`.
    """

    coefficients: Annotated[Floats, (SENSOR_GROUPS, REGRESSORS)]
    covariance: Annotated[Floats, (REGRESSORS, REGRESSORS)]
    prior: Annotated[Floats, REGRESSORS]  #: variances while nothing is known
    usual: Annotated[Floats, REGRESSORS]  #: variances among sound sensors, no larger than `prior`
    walk: Annotated[Floats, REGRESSORS]  #: growth of the variances in a second
    unit: F8  #: variance of a second's sum, as `learning.noise` takes it
    gain: Annotated[Floats, REGRESSORS]  #: scratch
    seconds: I8  #: learned


class Sums(Record):
    """Sums since the beginning: the difference of two is that of a window."""

    residual: Annotated[Floats, SENSOR_GROUPS]  #: along each sensor's axis
    regressors: Annotated[Floats, REGRESSORS]
    parity: Annotated[Floats, SENSOR_GROUPS]  #: of what had not been learned before
    leverage: F8  #: of what was learned, in its learner's unit, until learning last stopped
    stretch: F8  #: the same since then, the deviation: as if it erred by the same
    vector: Annotated[Floats, 3]  #: fused less expected at standstill
    vector_leverage: F8
    turned: F8  #: by the outer axis, to and fro, rad
    square_variance: F8  #: of the angle by which the table is not square, as learned, rad²
    standing: I8  #: seconds at standstill


class ParitySecond(Record):
    """Results of a second; means over it, in rad/s or m/s²."""

    epoch: I8  #: its last
    sensors: I8  #: compared, one bit each
    ratio: F8  #: the largest parity over its threshold, of all windows that end in it
    residual: Annotated[Floats, SENSOR_GROUPS]  #: of what is not learned
    threshold: Annotated[Floats, SENSOR_GROUPS]  #: of the residual


class ParityBefore(Record):
    """The last seconds before an alarm, oldest first; zero where there was none."""

    epoch: I8  #: the first of the alarm
    ratio: Annotated[Floats, BEFORE_S]
    residual: Annotated[Floats, BEFORE_S * SENSOR_GROUPS]  #: rad/s or m/s², second by second


class Parity(Record):
    """The sensors of one kind, compared with each other and, at standstill, with the truth."""

    kind: I8  #: `GYROS` or `ACCELEROMETERS`
    # From the data sheet.
    bias_variance: F8  #: of what a fused component is off by, (rad/s)² or (m/s²)²
    slope_variance: F8  #: of a fused component's scale and installation
    turn_variance: F8  #: by which gravity along a sensor changes its bias in a turn by a radian
    white_variance: Annotated[Floats, SENSOR_GROUPS]  #: of a sum over 1 s
    quantisation_variance: F8  #: of any sum
    drift_variance: Annotated[Floats, (SENSOR_GROUPS, SECOND_LEVELS)]  #: of a window's sum
    instability_variance: Annotated[Floats, SENSOR_GROUPS]  #: of the bias instability
    expected_variance: Annotated[Floats, SECOND_LEVELS]  #: of the expectation at standstill
    tilt_error: F8  #: of a second's expectation, as the velocity's error implies
    encoder_variance: F8  #: of an angle of the table, rad²
    wobble: F8  #: of the inner axis, rad
    standing_limit: Annotated[Floats, SENSOR_GROUPS]  #: of a second's sum: beyond, it is motion
    second_factor: F8  #: standard deviations that raise an alarm, windows of whole seconds
    epoch_factor: F8  #: the same, shorter windows
    noise_limit: F8  #: of the mean of normalised squares over `NOISE_S`
    # Of the present set of sensors.
    sensors: I8  #: compared, one bit each
    is_single: Bool  #: whether all compared sensors have the same parity, but for its unit
    redundant: Bool  #: whether they are more than span space
    projector: Annotated[Floats, (SENSOR_GROUPS, SENSOR_GROUPS)]  #: I - H G
    leave_out: Annotated[Floats, (SENSOR_GROUPS, 3)]  #: by its residual, the vector without it
    second_variance: Annotated[Floats, SENSOR_GROUPS]  #: of a parity's sum over 1 s
    learning_variance: Annotated[Floats, SENSOR_GROUPS]  #: the same, as its learner takes it
    vector_variance: F8  #: of the fused vector's sum over 1 s, the largest
    vector_learning_variance: F8  #: the same, as its learner takes it
    variance: Annotated[Floats, (SENSOR_GROUPS, SECOND_LEVELS)]  #: of a parity over a window
    drift_second: Annotated[Floats, SENSOR_GROUPS]  #: of a parity's drift over 1 s
    epoch_variance: Annotated[Floats, (SENSOR_GROUPS, EPOCH_LEVELS)]
    redundancy_left: Bool  #: `redundant`, and frames come so that they are compared
    # Of the present second: as many seconds as it takes where frames are lost.
    used_epochs: I8  #: in its sums
    known_epochs: I8  #: of these, with an expectation at standstill
    open_s: I8  #: seconds since it began
    closed_s: I8  #: what that was when the last one was closed
    gaps: I8  #: between its epochs
    gaps_allowed: I8  #: gaps in a second for whose counts the variances allow
    lost_epochs: I8  #: in a row that lack a compared sensor
    useless_epochs: I8  #: since a compared sensor is absent or at full scale
    residual: Annotated[Floats, SENSOR_GROUPS]  #: sums of the parity along each sensor's axis
    vector: Annotated[Floats, 3]
    turned: F8  #: by the outer axis, rad
    regressors: Annotated[Floats, REGRESSORS]
    epoch_regressors: Annotated[Floats, REGRESSORS]
    unlearned: Annotated[
        Floats, SENSOR_GROUPS
    ]  #: residual less learned, for epochs before that lacked one, too
    # Shorter windows: unfinished sums of each level.
    levels: I8
    level_epochs: I8
    level_sum: Annotated[Floats, (EPOCH_LEVELS, SENSOR_GROUPS)]
    summed_regressors: Annotated[Floats, REGRESSORS]  #: since the longest of these windows began
    level_begun: Annotated[Floats, (EPOCH_LEVELS, REGRESSORS)]  #: the same where a window began
    # Of whole seconds.
    seconds: I8  #: in the sums
    uncertain: F8  #: variance of what was expected of the last second, in its learner's unit
    window_sum: Annotated[Floats, (SECOND_LEVELS, SENSOR_GROUPS)]  #: of what is not learned
    window_spread: Annotated[Floats, SECOND_LEVELS]  #: variance of what was expected of them
    window_uncertain: Annotated[Floats, SECOND_LEVELS]  #: of the sums, beyond their noise
    settled: I8  #: seconds that have been learned, or not
    learned: I8  #: the last of them that was learned
    learned_regressors: Annotated[Floats, REGRESSORS]  #: their sum until then
    now: Sums
    fine: Annotated[Records[Sums], FINE_CAPACITY]
    coarse: Annotated[Records[Sums], COARSE_CAPACITY]
    squares: Annotated[Floats, (NOISE_S, SENSOR_GROUPS)]  #: normalised squares, a ring
    parity: Learner  #: late, and not while a test is pending
    ahead: Learner  #: at once and always: what the tests of whole seconds fit besides a step
    expected: Learner
    late_vector: Annotated[Floats, (SETTLED_S, 3)]  #: of the last seconds at standstill, a ring
    late_regressors: Annotated[Floats, (SETTLED_S, REGRESSORS)]
    kept: Learner  #: what was known when a sensor was last left out, less what was taken off
    peak: F8  #: the largest parity over its threshold of shorter windows in the present second
    history: Annotated[Records[ParitySecond], HISTORY_S]  #: a ring, by `history_count`
    history_count: I8  #: seconds noted
    before: ParityBefore  #: of the last alarm
    # Results.
    ratio: F8  #: the largest parity over its threshold
    window_s: F8  #: of that
    suspect: I8  #: sensor whose axis it points along, -1: none
    learning: Bool  #: enough has been learned to replace a missing sensor
    alarm: Bool
    alarm_epoch: I8  #: the first epoch of the alarm
    alarm_shown: Bool  #: whether the parity was beyond its threshold in it
    persistent: I8  #: seconds for which the same sensors have seemed to fail at standstill
    persistent_sensors: I8  #: which, one bit each
    unexplained: Annotated[Floats, SENSOR_GROUPS]  #: by one alone, of the seconds in an alarm
    unexplained_free: I8  #: their degrees of freedom
    apart: I8  #: seconds for which all sensors at standstill have been far from the expectation
    frozen: I8  #: seconds since learning stopped, for a test is pending
    fits_from: I8  #: second from which on windows are fitted: `ahead` knows of no fault before it
    clear_seconds: I8  #: since the parity was last beyond its threshold
    excluded: I8  #: one bit each
    isolated: I8  #: the sensor that was excluded last, -1: none
    isolated_epoch: I8
    found_epoch: I8  #: in which the alarm began that led to this
    how: I8  #: a `Found`
    repaired_epoch: I8  #: first epoch from which the history has been navigated anew; -1: none
    # Taken off the sensors since the first exclusion.
    corrected: Bool
    readmitted: I8  #: the sensor that came back last, -1: none
    readmitted_epoch: I8
    correction: Annotated[Floats, (SENSOR_GROUPS, REGRESSORS)]
    # Scratch.
    matrix: Annotated[Floats, (SENSOR_GROUPS, SENSOR_GROUPS + 1)]
    score: Annotated[Floats, SENSOR_GROUPS]
    axes: Annotated[Floats, 3]
    late_residual: Annotated[Floats, SENSOR_GROUPS]
    late_second: Annotated[Floats, REGRESSORS]


class Repair(Record):
    """The last minutes in blocks of a second, and what a repair has reached.

    A block has, for each sensor, by how much leaving it out turns the attitude or changes the
    velocity, in the navigation frame; then what `redundancy.blocks` lists.
    """

    stride: I8  #: numbers of a block
    capacity: I8  #: blocks
    count: I8  #: blocks written since navigation began
    block: Annotated[Floats, 6 * SENSOR_GROUPS + BLOCK_OTHERS]  #: the present one
    blocks: Annotated[Floats, BLOCK_FLOATS]
    active: Bool
    kind: I8  #: of the sensor, 0: gyros, 1: accelerometers
    sensor: I8
    at: I8  #: next block
    share: F8  #: of what is kept of it
    waiting_s: Annotated[Floats, (2, SENSOR_GROUPS)]  #: by kind and sensor: how long its fault was
    waiting_share: Annotated[Floats, (2, SENSOR_GROUPS)]
    x: Annotated[Floats, NAVIGATION_STATES]  #: what the repair adds to the navigation
    response: Annotated[Floats, (NAVIGATION_STATES, NAVIGATION_STATES)]  #: scratch
    work: Annotated[Floats, NAVIGATION_STATES]  #: scratch


class Suspicion(Record):
    """Effect of each sensor of a kind on the navigation, if it is the one that fails."""

    active: Bool
    kind: I8
    anew: Bool  #: a new fault, and not one that has grown
    at: I8  #: next block
    last: I8  #: block that is waited for, -1: none
    begun_epoch: I8  #: since which the fault may have lasted
    x: Annotated[Floats, (SENSOR_GROUPS, NAVIGATION_STATES)]  #: to add without the sensor
    height: Annotated[Floats, SENSOR_GROUPS]  #: m, the same
    until: Annotated[Integers, 2]  #: epoch up to which an alarm is of the same fault, by kind
    told: Annotated[Floats, (2, SENSOR_GROUPS)]  #: rad/s, m/s², the largest size of this fault
    value: Annotated[Floats, (2, SENSOR_GROUPS)]  #: rad/s, m/s², of the fault, by kind
    sigma: Annotated[Floats, (2, SENSOR_GROUPS)]  #: of the value
    shown: Annotated[Floats, (2, SENSOR_GROUPS)]  #: value as it was when it last changed
    shown_epoch: Annotated[Integers, 2]
    fault_size: Annotated[Floats, (2, SENSOR_GROUPS)]  #: it may have, with the value's sign


class Hypothesis(Record):
    """A filter without a sensor, or one of each kind, and how well it explains the reference."""

    sensor: Annotated[Integers, 2]  #: by kind, -1: leaves none out; `ALIKE`: all are off alike
    second: Annotated[Integers, 2]  #: another that fails, its effect is a state; -1: none
    noisy: I8  #: an accelerometer that stays in use, and is only noisy; -1: none
    into: I8  #: the first state of that effect
    direction: Annotated[Floats, 3]  #: of that effect in s, for a fault of 1
    prior: F8  #: variance of that fault before it was estimated; 0: not yet, or none
    x: Annotated[Floats, BANK_STATES]
    P: Annotated[Floats, (BANK_STATES, BANK_STATES)]
    reached: F8  #: share of the present block
    squares: F8  #: sum of the squares of normalised innovations
    score: F8  #: the same plus the logarithms of their variances: minus twice the likelihood's


class Bank(Record):
    """Filters of the navigation's error, without each sensor that may fail, and a reference."""

    active: Bool
    doubts: I8  #: kinds of which one fails, one bit each
    sensors: Annotated[Integers, 2]  #: compared since `first`, by kind, one bit each
    doubt_since: Annotated[Integers, 2]  #: epoch of the first alarm, by kind
    doubt_until: Annotated[Integers, 2]  #: epoch
    first: I8  #: block: the navigation has not been changed since
    fault_at: I8  #: block in which the fault may have begun
    fault_variance: Annotated[Floats, 2]  #: of what a second sensor may be off by, by kind
    at: I8  #: next block
    turn: I8  #: filter that takes it next
    found: I8  #: filter whose sensor fails, in this epoch; 0: none
    found_kind: I8  #: of that sensor
    count: I8  #: filters
    measurements: I8  #: taken by each filter
    measuring: Bool  #: whether all filters have reached the odometer's stretch of the block
    fits: Bool  #: whether that agrees with any of them
    slips_until: I8  #: block: before it, the odometer is not used
    filters: Annotated[Records[Hypothesis], BANK_CAPACITY]
    # The reference.
    velocity_n: Annotated[Floats, (VELOCITY_EPOCHS, 3)]  #: of the navigation, by epoch, a ring
    velocity_first: I8  #: epoch from which on it is filled
    velocity_last: I8  #: epoch
    fix_waits: Bool
    fix_epoch: I8  #: at whose end it was valid
    fix_velocity_n: Annotated[Floats, 3]
    fix_variance: F8
    count_waits: Bool  #: of the odometer
    count_epoch: I8  #: at whose end it was valid
    count_travelled: F8  #: m, then
    count_gaps: I8  #: of the odometer, then
    stretch_epoch: I8  #: at whose end the stretch up to the next count begins; -1: nowhere
    stretch_travelled: F8  #: m, then
    stretch_gaps: I8  #: then
    # Scratch.
    response: Annotated[Floats, (NAVIGATION_STATES, NAVIGATION_STATES)]
    transition: Annotated[Floats, (FILTER_STATES, BANK_STATES)]  #: the last columns are zero
    work: Annotated[Floats, (BANK_STATES, BANK_STATES)]
    row: Annotated[Floats, BANK_STATES]
    gain: Annotated[Floats, BANK_STATES]
    attitude_s: Annotated[Floats, (3, 3)]
    inputs: Annotated[Floats, (5, 3)]
    error_q: Annotated[Floats, (3, 4)]  #: of a filter's error of the attitude
    error_C: Annotated[Floats, (3, 3)]
    attitude_b: Annotated[Floats, (3, 3)]
    way_b: Annotated[Floats, 3]
    velocity_way_b: Annotated[Floats, 3]
    alike: Annotated[Floats, (2, SENSOR_GROUPS)]  #: weights of the sensors, see `alike.weigh`
    direction_s: Annotated[Floats, 3]


class Readmission(Record):
    """A sensor that is left out is compared with the others again, by order of the operator."""

    order: I8  #: a `ReadmissionOrder` for the next epoch
    order_kind: I8  #: `GYROS` or `ACCELEROMETERS`
    order_sensor: I8  #: from 1
    order_anew: Bool  #: whether its constants are learned anew
    order_s: I8  #: length of the test
    state: I8  #: a `ReadmissionState`
    refusal: I8  #: a `Refusal`
    kind: I8  #: of the sensor
    sensor: I8  #: from 1; 0: nothing was ordered yet
    anew: Bool
    wanted_s: I8
    passed_s: I8  #: compared so far
    waited_s: I8  #: since the order
    ratio: F8  #: the largest parity over its threshold so far
    vector: Annotated[Floats, 3]  #: scratch: fused with the sensor
    gyros: Parity  #: as if the sensor were in use
    accelerometers: Parity


class Redundancy(Record):
    """Redundancy of both kinds of sensors."""

    enabled: Bool
    second_epochs: I8
    epochs: I8  #: of the present second
    navigated: Bool  #: in the previous epoch
    aligning: Bool  #: at standstill, to an attitude that is not known yet
    moved: Bool  #: since navigation began
    was_fast: Bool  #: the navigated velocity, since then
    aligned_epochs: I8  #: since this, or since a sensor was left out
    transmissions: I8  #: of its messages, for their counters
    navigation_epoch: I8  #: in which navigation began
    gyros: Parity
    accelerometers: Parity
    repair: Repair
    suspicion: Suspicion
    readmission: Readmission
    bank: Bank
    expected_dtheta_s: Annotated[Floats, 3]  #: rad, of the present epoch, at standstill
    expected_dv_s: Annotated[Floats, 3]  #: m/s
    expected_known: Bool
    outer_turn: F8  #: rad, of the outer axis in the present epoch, by its encoder
    unknown_epochs: I8  #: in a row
    angle_before_rad: Annotated[Floats, 2]  #: of the encoders
    middle: Angle  #: of the inner axis, in the middle of the epoch
    angle_known: Bool
    rate_before_dps: Annotated[Floats, 2]  #: of the axes, at the end of the last second
    turns_evenly: Bool  #: whether the axes have kept their rates for a second
    work: Annotated[Floats, (3, 3)]  #: scratch
