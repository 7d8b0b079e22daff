"""The vehicle's motion as mutually consistent polynomials of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.motion.spline import horner

POWERS = 8
"""Coefficients of a channel's polynomial on a piece."""

OMEGA_IB_B = slice(0, 3)  # rad/s
SPECIFIC_FORCE_B = slice(3, 6)  # m/s²
PLACE = slice(6, 9)  # latitude, longitude (rad), height (m)
VELOCITY_N = slice(9, 12)  # m/s
ATTITUDE = slice(12, 15)  # roll, pitch, heading (rad)
CHANNELS = 15

PIECE_NS = 250_000_000
"""Approximate length of a piece."""


def knot_ns(period_ns: int) -> int:
    """Return the length of a piece: a whole number of periods, about 0.25 s."""
    return period_ns * max(1, round(PIECE_NS / period_ns))


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion that starts from rest, piece by piece."""

    knot_ns: int  #: length of a piece, a whole number of sampling periods
    #: monomial coefficients, lowest first, in u from 0 to 1 across the piece. Channels: ω_ib^b x,
    #: y, z (rad/s); f^b x, y, z (m/s²); latitude, longitude (rad), height (m); velocity over ground
    #: east, north, up (m/s); roll, pitch, heading (rad). Longitude and heading are continuous: they
    #: may leave [-π, π).
    pieces: Floats
    #: the piece that follows the last one; None if the motion ends at rest
    loop_from: int | None = None
    notes: tuple[str, ...] = ()  #: what a user should know about the origin of the motion

    def __post_init__(self) -> None:
        assert self.pieces.shape[1:] == (CHANNELS, POWERS)
        self.pieces.setflags(write=False)

    @property
    def duration_s(self) -> float:
        """Length of all pieces."""
        return len(self.pieces) * self.knot_ns / 1e9

    def sampled(self, channels: slice, per_piece: int) -> Floats:
        """Return channels `per_piece` times on each piece, shape (n `per_piece`, channels).

        For peaks of long motions: takes less memory than `at`.
        """
        u = np.arange(per_piece) / per_piece
        values = horner(self.pieces[:, channels, None, :], u)
        return np.asarray(values.swapaxes(1, 2).reshape(-1, values.shape[1]))

    def at(self, time_s: Floats) -> Floats:
        """Return all channels at times since the beginning, shape (m, 15).

        Before the beginning the initial values apply; after the end the final ones, unless the
        motion loops.
        """
        times = np.maximum(np.asarray(time_s, dtype=np.float64) / (self.knot_ns * 1e-9), 0.0)
        count = len(self.pieces)
        if self.loop_from is None:
            times = np.minimum(times, count)
        else:
            beyond = times >= count
            loop = count - self.loop_from
            times = np.where(beyond, self.loop_from + (times - count) % loop, times)
        index = np.minimum(times.astype(np.int64), count - 1)
        return horner(self.pieces[index], (times - index)[:, None])
