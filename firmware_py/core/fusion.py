"""Redundant sensors to one vector: calibration, then weighted least squares. Paper, (16), (54)."""

from __future__ import annotations

from rrins.dbc.compilation import compiled
from rrins.dbc.record import Floats
from rrins.firmware_py.core.memory import Fusion

_DETERMINANT_FLOOR = 1e-6  # of Hᵀ H over its mean eigenvalue; below, the axes do not span space


@compiled
def _normal_matrix(fusion: Fusion, used: int, weighted: bool, N: Floats) -> None:
    """Write ``Hᵀ W H`` (or ``Hᵀ H``) of the used sensors to `N`, shape (3, 3)."""
    for i in range(3):
        for j in range(3):
            N[i, j] = 0.0
    for k in range(fusion.count):
        if used >> k & 1:
            weight = fusion.weight[k] if weighted else 1.0
            for i in range(3):
                for j in range(3):
                    N[i, j] += weight * fusion.H[k, i] * fusion.H[k, j]


@compiled
def _determinant(N: Floats) -> float:
    return (
        N[0, 0] * (N[1, 1] * N[2, 2] - N[1, 2] * N[2, 1])
        + N[0, 1] * (N[1, 2] * N[2, 0] - N[1, 0] * N[2, 2])
        + N[0, 2] * (N[1, 0] * N[2, 1] - N[1, 1] * N[2, 0])
    )


@compiled
def prepare(fusion: Fusion, used: int, work: Floats) -> None:
    """Compute ``gain = (Hᵀ W H)⁻¹ Hᵀ W`` for the sensors in `used`, one bit each.

    `work` is scratch of shape (at least 3, 3). `fusion.solvable` becomes true if the sensors' axes
    span space; `gain` of an unused sensor is zero.
    """
    fusion.used = used
    fusion.solvable = False
    N = work
    _normal_matrix(fusion, used, False, N)
    mean = (N[0, 0] + N[1, 1] + N[2, 2]) / 3.0
    if not _determinant(N) > _DETERMINANT_FLOOR * mean * mean * mean:
        return
    _normal_matrix(fusion, used, True, N)
    c00 = N[1, 1] * N[2, 2] - N[1, 2] * N[2, 1]
    c01 = N[1, 2] * N[2, 0] - N[1, 0] * N[2, 2]
    c02 = N[1, 0] * N[2, 1] - N[1, 1] * N[2, 0]
    determinant = _determinant(N)
    c11 = N[0, 0] * N[2, 2] - N[0, 2] * N[2, 0]
    c12 = N[0, 1] * N[2, 0] - N[0, 0] * N[2, 1]
    c22 = N[0, 0] * N[1, 1] - N[0, 1] * N[1, 0]
    for k in range(fusion.count):
        scale = fusion.weight[k] / determinant if used >> k & 1 else 0.0
        x, y, z = fusion.H[k, 0], fusion.H[k, 1], fusion.H[k, 2]
        fusion.gain[0, k] = scale * (c00 * x + c01 * y + c02 * z)
        fusion.gain[1, k] = scale * (c01 * x + c11 * y + c12 * z)
        fusion.gain[2, k] = scale * (c02 * x + c12 * y + c22 * z)
    fusion.solvable = True


@compiled
def compensate(fusion: Fusion, received: int, measured: Floats) -> None:
    """Remove the calibrated errors from the increments of `received`, one bit each, in place.

    `measured` has shape (m,); other increments remain unchanged.

    The inverse of (16), (17): ``x = (N - b) / (1 + λ + μ sign(N - b))``, along the true axis h',
    which `fusion.H` has.
    """
    for k in range(fusion.count):
        if received >> k & 1 == 0:
            continue
        x = measured[k] - fusion.bias_increment[k]
        scale = 1.0 + fusion.scale_error[k]
        if x > 0.0:
            scale += fusion.asymmetric_scale_error[k]
        elif x < 0.0:
            scale -= fusion.asymmetric_scale_error[k]
        measured[k] = x / scale


@compiled
def fuse(fusion: Fusion, valid: int, measured: Floats, out: Floats, work: Floats) -> bool:
    """Write the fused vector in the sensor frame to `out`, shape (3,).

    Parameters
    ----------
    fusion : Fusion
        Its gain is recomputed when `valid` differs from the sensors that it is for.
    valid : int
        Usable sensors, one bit each.
    measured : array, shape (m,)
        Along the input axes.
    work : array, shape (at least 3, 3)

    Returns
    -------
    bool
        Whether the valid sensors suffice; otherwise `out` is unchanged.
    """
    if valid != fusion.used:
        prepare(fusion, valid, work)
    if not fusion.solvable:
        return False
    for i in range(3):
        total = 0.0
        for k in range(fusion.count):
            total += fusion.gain[i, k] * measured[k]
        out[i] = total
    return True
