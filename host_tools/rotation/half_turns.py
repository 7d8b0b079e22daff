"""Fast evaluation of thousands of half-turn schemes.

The effect of a half turn on each error depends only on the axis, its sense, and whether each axis
is at an even or odd number of half turns: 16 cases. These and the four stationary attitudes are
integrated once; a scheme is then a sum over its positions.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats
from rrins.firmware_py.core.settings import Scheme, Turn
from rrins.host_tools.rotation.analysis import VANISHES, grid_of, running_integral
from rrins.host_tools.rotation.enumeration import SENSE, Moves, angles
from rrins.host_tools.rotation.kinematics import INNER, OUTER, Leg
from rrins.host_tools.rotation.merit import Moments, SensorSet, leg_moments, sum_of_squares

_Cases = NDArray[np.int_]

_ATTITUDES = 4
_MOVES = 4
_MOMENTS = ("step", "slope", "sum_s", "sum_ts", "sum_ss")


class HalfTurns:
    """The errors of a RIMU in half turns at a given rate, each followed by a stationary period.

    Parameters
    ----------
    rimu : SensorSet
    turn_rate_dps, stand_s : float
    """

    def __init__(self, rimu: SensorSet, turn_rate_dps: float, stand_s: float) -> None:
        self._turn_rate_dps, self._stand_s = turn_rate_dps, stand_s
        self._gyros = len(rimu.gyros)
        turns = [
            _half_turn(attitude, move, 180.0 / turn_rate_dps)
            for attitude in range(_ATTITUDES)
            for move in range(_MOVES)
        ]
        stands = [Leg(1, None, _angles_deg(k), 0.0, stand_s) for k in range(_ATTITUDES) if stand_s]
        self._turns = _stacked([leg_moments(leg, rimu) for leg in turns])
        self._stands = _stacked([leg_moments(leg, rimu) for leg in stands]) if stands else None
        self._integrals = np.stack([_integrals(leg, rimu) for leg in [*turns, *stands]])
        # Largest integral of an error in one leg, on any axis: the scale for "vanishes".
        self._scale = np.abs(self._integrals).max(axis=(0, 3), keepdims=True)

    def scheme(self, moves: Moves) -> Scheme:
        """Return one sequence of half turns, shape (positions,), as a scheme."""
        return Scheme(
            turns=tuple(
                Turn(
                    axis="inner" if move // 2 == INNER else "outer",
                    angle_deg=180 * int(SENSE[move]),
                )
                for move in moves
            ),
            turn_rate_dps=self._turn_rate_dps,
            stand_s=self._stand_s,
        )

    def judge(self, moves: Moves) -> tuple[NDArray[np.int_], Floats]:
        """Return the number of remaining residuals and the velocity error of each scheme.

        Returns
        -------
        remaining : array, shape (n,)
            How many of the 24 residuals (4 gyro and 4 accelerometer errors, 3 axes) do not vanish
            for every sensor.
        rms_mps : array, shape (n,)
            See `rrins.host_tools.rotation.merit.VelocityError`.
        """
        attitudes = angles(moves, INNER) % 2 + 2 * (angles(moves, OUTER) % 2)
        turns = attitudes[:, :-1] * _MOVES + moves
        return self._remaining(turns, attitudes[:, 1:]), self._rms(turns, attitudes[:, 1:])

    def _remaining(self, turns: _Cases, stands: _Cases) -> NDArray[np.int_]:
        counts = np.zeros((len(turns), len(self._integrals)))
        rows = np.arange(len(turns))
        for k in range(turns.shape[1]):
            counts[rows, turns[:, k]] += 1
            if self._stands is not None:
                counts[rows, _ATTITUDES * _MOVES + stands[:, k]] += 1
        residual = np.tensordot(counts, self._integrals, axes=1)  # scheme, sensor, error, axis
        stays = np.abs(residual) > VANISHES * self._scale
        kinds = (stays[:, : self._gyros], stays[:, self._gyros :])
        return np.sum([kind.any(axis=1).sum(axis=(1, 2)) for kind in kinds], axis=0)

    def _rms(self, turns: _Cases, stands: _Cases) -> Floats:
        count, positions = turns.shape
        velocity = np.zeros((count, self._turns.step.shape[1]))
        slope, squares = np.zeros_like(velocity), np.zeros_like(velocity)
        duration_s = 0.0
        for k in range(positions):
            for table, cases in ((self._turns, turns[:, k]), (self._stands, stands[:, k])):
                if table is None:
                    continue
                leg = _chosen(table, cases)
                squares += sum_of_squares(velocity, slope, leg)
                velocity += slope * leg.duration_s + leg.step
                slope += leg.slope
                duration_s += leg.duration_s
        rms: Floats = np.sqrt(squares.sum(axis=1) / duration_s)
        return rms


def _angles_deg(attitude: int) -> tuple[float, float]:
    return 180.0 * (attitude % 2), 180.0 * (attitude // 2)


def _half_turn(attitude: int, move: int, duration_s: float) -> Leg:
    axis: Literal[0, 1] = INNER if move // 2 == INNER else OUTER
    return Leg(1, axis, _angles_deg(attitude), 180.0 * float(SENSE[move]), duration_s)


def _integrals(leg: Leg, rimu: SensorSet) -> Floats:
    """Return the error integrals of all gyros, then all accelerometers, (sensors, 4, 3)."""
    grid = grid_of(leg, rimu.felt_by)
    return np.concatenate(
        [running_integral(leg, sensors, field, grid)[-1] for sensors, field in rimu.felt_by]
    )


def _stacked(legs: list[Moments]) -> Moments:
    """Return legs of one duration as one table, arrays of shape (legs, channels)."""
    arrays = {name: np.stack([getattr(leg, name) for leg in legs]) for name in _MOMENTS}
    return Moments(legs[0].duration_s, **arrays)


def _chosen(table: Moments, cases: _Cases) -> Moments:
    return Moments(table.duration_s, **{name: getattr(table, name)[cases] for name in _MOMENTS})
