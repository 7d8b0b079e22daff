"""Where the initial attitude comes from."""

from __future__ import annotations

from enum import IntEnum


class InitialAttitude(IntEnum):
    """Source of the initial attitude."""

    GIVEN = 0
    SELF_ALIGNED = 1  # at standstill
    SELF_ALIGNED_SWAYING = 2  # about a known position
    SELF_ALIGNED_MOVING = 3  # with GNSS
    TRANSFERRED = 4  # with velocity and position, by another unit of a vehicle that moves
