"""Redundant sensors to one vector: calibration, then weighted least squares. Paper, (16), (54).

``gain = (Hᵀ W H)⁻¹ Hᵀ W`` is computed as the gain of equal weights and the change that the weights
make. Hᵀ W H itself is not inverted: that loses all digits when the weights are far apart. Instead,
the weighted solution is the mean of the solutions of all triples of sensors, each weighted by
``w_a w_b w_c det(h_a, h_b, h_c)²``: sums of positive terms, which lose none. With equal weights
the change is exactly zero. What rounding leaves of ``gain H - I``, which axes close to one line or
plane amplify, is corrected by Newton's iteration for an inverse.

References
----------
Ben-Tal and Teboulle, "A geometric property of the least squares solution of linear equations",
*Linear Algebra and its Applications* 139 (1990), theorem 2.1, for the mean over triples.
Hotelling, "Some new methods in matrix calculation", *Annals of Mathematical Statistics* 14 (1943),
section 7, for the iteration.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.records.memory import Fusion

CONDITION_LIMIT = 300.0
"""Largest condition number of the input axes with which a vector is fused."""

WEIGHT_RATIO_LIMIT = 1e18
"""Largest ratio of two weights. Products of three of them stay far from the end of the numbers."""

GAIN_LIMIT = 1000.0
"""Largest share of a sensor's error in the fused vector with which settings are accepted."""

_CORRECTIONS = 3
_ROUNDING = 1e-13  # of an element of gain H - I: not worth a correction
_LARGEST_DEVIATION = 1e-12


@compiled
def _normal_matrix(fusion: Fusion, used: int, N: Floats) -> None:
    """Write ``Hᵀ H`` of the used sensors to `N`, shape (3, 3)."""
    for i in range(3):
        for j in range(3):
            N[i, j] = 0.0
    for k in range(fusion.count):
        if used >> k & 1:
            for i in range(3):
                for j in range(3):
                    N[i, j] += fusion.H[k, i] * fusion.H[k, j]


@compiled
def _fill_equal(fusion: Fusion, used: int, N: Floats) -> bool:
    """Fill in the gain of equal weights by cofactors of `N` = HᵀH; return whether the axes span.

    Up to a condition number in the Frobenius norm, ``sqrt(tr(Hᵀ H) tr((Hᵀ H)⁻¹))``: 3 at best,
    infinite in one plane. Beyond it, the gain is left as it is.
    """
    c00 = N[1, 1] * N[2, 2] - N[1, 2] * N[2, 1]
    c01 = N[1, 2] * N[2, 0] - N[1, 0] * N[2, 2]
    c02 = N[1, 0] * N[2, 1] - N[1, 1] * N[2, 0]
    c11 = N[0, 0] * N[2, 2] - N[0, 2] * N[2, 0]
    c12 = N[0, 1] * N[2, 0] - N[0, 0] * N[2, 1]
    c22 = N[0, 0] * N[1, 1] - N[0, 1] * N[1, 0]
    determinant = N[0, 0] * c00 + N[0, 1] * c01 + N[0, 2] * c02
    trace = N[0, 0] + N[1, 1] + N[2, 2]
    is_solid = 3.0 * CONDITION_LIMIT**4 * determinant > trace**3  # else rounding, of one line
    if not is_solid or trace * (c00 + c11 + c22) > CONDITION_LIMIT**2 * determinant:
        return False
    for k in range(fusion.count):
        scale = 1.0 / determinant if used >> k & 1 else 0.0
        x, y, z = fusion.H[k, 0], fusion.H[k, 1], fusion.H[k, 2]
        fusion.gain[0, k] = scale * (c00 * x + c01 * y + c02 * z)
        fusion.gain[1, k] = scale * (c01 * x + c11 * y + c12 * z)
        fusion.gain[2, k] = scale * (c02 * x + c12 * y + c22 * z)
    return True


@compiled
def _volume(H: Floats, a: int, b: int, c: int) -> float:
    """Return det(h_a, h_b, h_c)."""
    return (
        H[a, 0] * (H[b, 1] * H[c, 2] - H[b, 2] * H[c, 1])
        + H[a, 1] * (H[b, 2] * H[c, 0] - H[b, 0] * H[c, 2])
        + H[a, 2] * (H[b, 0] * H[c, 1] - H[b, 1] * H[c, 0])
    )


@compiled
def _add_cross(fusion: Fusion, k: int, share: float, b: int, c: int) -> None:
    """Add ``share h_b × h_c`` to the column of sensor k."""
    H, gain = fusion.H, fusion.gain
    gain[0, k] += share * (H[b, 1] * H[c, 2] - H[b, 2] * H[c, 1])
    gain[1, k] += share * (H[b, 2] * H[c, 0] - H[b, 0] * H[c, 2])
    gain[2, k] += share * (H[b, 0] * H[c, 1] - H[b, 1] * H[c, 0])


@compiled
def _weigh(fusion: Fusion, used: int) -> bool:
    """Change the gain of equal weights to that of the weights; return whether they have one."""
    count, H, weight = fusion.count, fusion.H, fusion.weight
    largest = 0.0
    for k in range(count):
        if used >> k & 1 and weight[k] > largest:
            largest = weight[k]
    equal, weighted = 0.0, 0.0
    for a in range(count):
        for b in range(a + 1, count):
            for c in range(b + 1, count):
                if (used >> a) & (used >> b) & (used >> c) & 1:
                    w = (weight[a] / largest) * (weight[b] / largest) * (weight[c] / largest)
                    volume = _volume(H, a, b, c)
                    equal += volume * volume
                    weighted += w * (volume * volume)
    if not weighted > 0.0:
        return False
    for a in range(count):
        for b in range(a + 1, count):
            for c in range(b + 1, count):
                if (used >> a) & (used >> b) & (used >> c) & 1:
                    w = (weight[a] / largest) * (weight[b] / largest) * (weight[c] / largest)
                    share = (w / weighted - 1.0 / equal) * _volume(H, a, b, c)
                    _add_cross(fusion, a, share, b, c)
                    _add_cross(fusion, b, share, c, a)
                    _add_cross(fusion, c, share, a, b)
    return True


@compiled
def _deviation(fusion: Fusion, used: int, D: Floats) -> float:
    """Write ``gain H - I`` to `D`, shape (3, 3); return its largest element."""
    largest = 0.0
    for i in range(3):
        for j in range(3):
            D[i, j] = -1.0 if i == j else 0.0
            for k in range(fusion.count):
                if used >> k & 1:
                    D[i, j] += fusion.gain[i, k] * fusion.H[k, j]
            largest = max(largest, abs(D[i, j]))
    return largest


@compiled
def _correct(fusion: Fusion, used: int, work: Floats) -> bool:
    """Correct the gain to a left inverse of H; return whether it is one."""
    for _ in range(_CORRECTIONS):
        if _deviation(fusion, used, work) <= _ROUNDING:
            return True
        for k in range(fusion.count):
            x, y, z = fusion.gain[0, k], fusion.gain[1, k], fusion.gain[2, k]
            for i in range(3):
                fusion.gain[i, k] -= work[i, 0] * x + work[i, 1] * y + work[i, 2] * z
    return _deviation(fusion, used, work) <= _LARGEST_DEVIATION


@compiled
def prepare(fusion: Fusion, used: int, work: Floats) -> None:
    """Compute ``gain = (Hᵀ W H)⁻¹ Hᵀ W`` for the sensors in `used`, one bit each.

    `work` is scratch of shape (at least 3, 3). `fusion.solvable` becomes true if the sensors' axes
    span space and no element of ``gain H - I`` is above 1e-12; `gain` of an unused sensor is zero.
    Where the axes do not span space, `gain` is that of the sensors before.
    """
    fusion.used = used
    _normal_matrix(fusion, used, work)
    spans = _fill_equal(fusion, used, work)
    fusion.solvable = spans and _weigh(fusion, used) and _correct(fusion, used, work)


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
