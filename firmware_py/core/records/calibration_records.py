"""Records of the calibration in use in the RAM image: its origin, and whether it still holds."""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated

from rrins.compiled.record import F8, I8, Bool, Floats, Record
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.records.redundancy_records import REGRESSORS


class DriftState(IntEnum):
    """Whether the scale factors and the installation of a kind are still those calibrated.

    NOT_COMPARED: it is not known how well they were calibrated, or there is no redundancy.
    LEARNING: the parity tells nothing yet; the table must turn. KEPT and DRIFTED are of the
    directions that it tells.
    """

    NOT_COMPARED = 0
    LEARNING = 1
    KEPT = 2
    DRIFTED = 3


class DriftSize(IntEnum):
    """How far a kind has drifted, in words of the bus; the DBC's value table of `drift`."""

    NOT = 0
    BELOW_10_PPM = 1
    FROM_10_TO_20_PPM = 2
    FROM_20_TO_40_PPM = 3
    FROM_40_TO_80_PPM = 4
    FROM_80_TO_160_PPM = 5
    FROM_160_TO_320_PPM = 6
    ABOVE_320_PPM = 7


class Drift(Record):
    """Comparison of what the parity has learned of a kind of sensors with their calibration."""

    known: Bool  #: whether it is known how well they were calibrated
    axis_variance: Annotated[Floats, (SENSOR_GROUPS, 3, 3)]  #: of h (1 + λ), that may be
    limit: F8  #: distance from which on they have drifted, standard deviations
    state: I8  #: a `DriftState`
    distance: F8  #: of what was learned from what was calibrated, standard deviations
    told: I8  #: directions of the sensor frame of which the parity tells something, one bit each
    change: F8  #: 1, by how much one sensor's h (1 + λ) would have changed along these
    since_epoch: I8  #: in which they were last found to have drifted; 0: never
    response: Annotated[Floats, (3, REGRESSORS)]  #: scratch
    noise: Annotated[Floats, (3, 3)]  #: scratch
    variance: Annotated[Floats, (3, 3)]  #: scratch
    learned: Annotated[Floats, 3]  #: scratch


class CalibrationInUse(Record):
    """The calibration in use."""

    date_utc_s: I8  #: since 1970-01-01 UTC; 0: not known
    temperature_known: Bool
    temperature_c: F8
    gyros: Drift
    accelerometers: Drift
