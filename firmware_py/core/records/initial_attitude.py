"""Where the initial attitude comes from."""

from __future__ import annotations

import math
from enum import IntEnum


class InitialAttitude(IntEnum):
    """Source of the initial attitude."""

    GIVEN = 0
    SELF_ALIGNED = 1  # at standstill
    SELF_ALIGNED_SWAYING = 2  # about a known position
    SELF_ALIGNED_MOVING = 3  # with GNSS
    TRANSFERRED = 4  # with velocity and position, over the bus, by the master of a moving vehicle


LEAST_LEVEL = math.radians(1) / 3600
LEAST_HEADING = 10.0 * LEAST_LEVEL
"""rad, sigma of a given or transferred attitude: less is not to be had from outside."""
