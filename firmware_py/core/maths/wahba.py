"""Wahba's problem: the rotation that best turns one set of vectors into another.

Davenport's q-method: the quaternion is the eigenvector to the largest eigenvalue of a symmetric
4 x 4 matrix, which is found by Jacobi's rotations. Davenport, NASA TN D-4696 (1968); Wertz (ed.),
*Spacecraft Attitude Determination and Control* (1978), section 12.2.2; Golub and Van Loan, *Matrix
Computations* (4th ed., 2013), section 8.5.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats

_SWEEPS = 12
"""Of Jacobi's rotations, at most; they converge quadratically, in five or six."""

_SIZE = 4


@compiled
def fill_davenport(K: Floats, B: Floats) -> None:
    """Write Davenport's matrix, shape (4, 4), for ``B = Σ w b aᵀ``, shape (3, 3).

    The quaternion q, scalar first, that maximises ``Σ w bᵀ C(q) a`` maximises ``qᵀ K q``.
    """
    trace = B[0, 0] + B[1, 1] + B[2, 2]
    K[0, 0] = trace
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        K[0, 1 + i] = K[1 + i, 0] = B[k, j] - B[j, k]  # Σ w a x b
        for n in range(3):
            K[1 + i, 1 + n] = B[i, n] + B[n, i]
        K[1 + i, 1 + i] -= trace


@compiled
def largest_eigenvector(K: Floats, vectors: Floats, out: Floats) -> float:
    """Write the eigenvector to the largest eigenvalue to `out`, shape (4,); return the value.

    Parameters
    ----------
    K : array, shape (4, 4)
        Symmetric; diagonal afterwards.
    vectors : array, shape (4, 4)
        All eigenvectors afterwards, as columns.
    out : array, shape (4,)
    """
    for i in range(_SIZE):
        for k in range(_SIZE):
            vectors[i, k] = 1.0 if i == k else 0.0
    for _ in range(_SWEEPS):
        beside = 0.0
        for i in range(_SIZE):
            for k in range(i + 1, _SIZE):
                beside += abs(K[i, k])
                _rotate(K, vectors, i, k)
        if beside == 0.0:
            break
    best = 0
    for i in range(_SIZE):
        if K[i, i] > K[best, best]:
            best = i
    for i in range(_SIZE):
        out[i] = vectors[i, best]
    return float(K[best, best])


@compiled
def _rotate(K: Floats, vectors: Floats, p: int, q: int) -> None:
    """Make the element (p, q) zero by a rotation in its plane. Golub and Van Loan, 8.5.2."""
    if K[p, q] == 0.0:
        return
    tau = (K[q, q] - K[p, p]) / (2.0 * K[p, q])
    sign = 1.0 if tau >= 0.0 else -1.0
    tangent = sign / (abs(tau) + math.sqrt(1.0 + tau * tau))
    cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
    sine = tangent * cosine
    change = tangent * K[p, q]
    K[p, p] -= change
    K[q, q] += change
    K[p, q] = K[q, p] = 0.0
    for i in range(_SIZE):
        if i not in (p, q):
            along, across = K[i, p], K[i, q]
            K[i, p] = K[p, i] = cosine * along - sine * across
            K[i, q] = K[q, i] = sine * along + cosine * across
        along, across = vectors[i, p], vectors[i, q]
        vectors[i, p] = cosine * along - sine * across
        vectors[i, q] = sine * along + cosine * across


@compiled
def invert_symmetric(out: Floats, A: Floats) -> bool:
    """Write the inverse of a positive 3 x 3 matrix, by cofactors; return whether there is one."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for n in range(3):
            m, p = (n + 1) % 3, (n + 2) % 3
            out[n, i] = A[j, m] * A[k, p] - A[j, p] * A[k, m]
    determinant = A[0, 0] * out[0, 0] + A[0, 1] * out[1, 0] + A[0, 2] * out[2, 0]
    if not determinant > 0.0:
        return False
    for i in range(3):
        for n in range(3):
            out[i, n] /= determinant
    return True
