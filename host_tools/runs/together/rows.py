"""Where the memory of eight runs side by side has what: a row of `LANES` floats for each number."""

from __future__ import annotations

from rrins.firmware_py.core.records.redundancy_records import EPOCH_LEVELS

# The navigation.
ATTITUDE = 0  #: of the sensors, `Ins.q_s_n`
DLATITUDE, DLONGITUDE = 4, 5  #: rad, since the lanes began
LATITUDE = 6  #: rad, where they began
HEIGHT = 7  #: m, held
VELOCITY, CHANGE = 8, 10  #: m/s, east and north; in the last epoch
BEFORE = 12  #: m/s, the velocity of the epoch before
DTHETA, DV = 14, 17  #: rad and m/s, in the sensor frame, of the last epoch
NAVIGATION = 20  #: number of rows

# Of a kind of sensors.
SENSORS = 8  #: most of a kind
VECTOR = 0  #: sum of the fused vector over the second
UNEXPECTED = 3  #: sum of what a vehicle that stands does not explain of it
PARITY = 6  #: the parity of the first sensor, by sensor
LEARNED = PARITY + SENSORS  #: what was learned of it, by regressor
LEVEL = LEARNED + 8 + SENSORS  #: sums of windows shorter than a second, by level
ALLOWED = LEVEL + EPOCH_LEVELS  #: the inverse of each level's largest square
RATIO = ALLOWED + EPOCH_LEVELS  #: the largest square over what is allowed
UNLEARNED = RATIO + 1  #: what was not learned of the present epoch's parity
SENSOR = UNLEARNED + 1  #: of the first sensor

# Of a sensor.
AXIS = 0  #: true input axis
SCALE, ASYMMETRIC = 3, 4  #: 1 + λ; μ
BIAS, NOISE = 5, 6  #: increments of an epoch
G_SENSITIVITY = 7
REMAINDER = 8  #: counts
OFFSET, CORRECTION, CORRECTION_BY_SIGN = 9, 10, 11  #: by which the firmware corrects
GAIN, INPUT = 12, 15  #: share in the fused vector; input axis, as calibrated
SUM, ABSOLUTE_SUM = 18, 19  #: over the second: its increment, and the amount along the input axis
LAST, REPEATED, LONGEST = 20, 21, 22  #: last count; how often in a row; most often
HIGHEST = 23  #: largest count
MEASURED = 24  #: increment of the present epoch
SENSOR_ROWS = 25

KIND_ROWS = SENSOR + SENSORS * SENSOR_ROWS
KIND = (NAVIGATION, NAVIGATION + KIND_ROWS)  #: of gyros, of accelerometers
ROWS = NAVIGATION + 2 * KIND_ROWS

# Of an epoch, alike for all: columns.
TRUE_DTHETA, TRUE_DV = 0, 3  #: rad and m/s, behind bandwidth and latency
FORCE = 6  #: m/s, for the sensitivity of gyros to it
TABLE_TURN = 9  #: rad, of the table by its encoders, in the sensor frame
OUTER_TURN = 12  #: rad, of the outer axis
SINE, COSINE, REFERENCE = 13, 14, 15  #: of a latitude near all, rad
C_S_B = 16  #: the table by its encoders
RATES = 25  #: of its axes, °/s
ENDS_SECOND, IS_KEPT = 27, 28  #: 1 if a second ends, or a sample is kept
COLUMNS = 29
