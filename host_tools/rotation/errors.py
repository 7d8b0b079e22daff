"""The constant errors of a set of sensors, and their error rates in the body frame.

First order, paper (25) and (35): for sensor i with input axis h and input x (ω^s or f^s),

    bias   b
    MESSF  λ h x                       symmetric scale factor error
    MEASF  μ sign(h x) h x             asymmetric scale factor error
    MEIE   -(δu v + δv u) x            installation error

along its input axis. It maps to the body frame as ``C_s_b h'`` (24) or, weighted by its share in
the fused solution, as ``C_s_b`` times its column of ``(H'WH)^-1 H'W`` (54).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.hardware.sensors import input_axis, transverse_axes
from rrins.host_tools.hardware.tables import Accelerometers, Gyros
from rrins.host_tools.hardware.units import in_si

Kind = Literal["gyro", "accelerometer"]

ERRORS: Final = ("bias", "MESSF", "MEASF", "MEIE")
"""Kinds of error, in the order of the length-4 axis of all arrays."""
BIAS, MESSF, MEASF, MEIE = range(4)

_DUST = 1e-15
"""Rounding residue of components that are zero by geometry, such as cos 90°."""


def _without_dust(matrix: Floats) -> Floats:
    return np.where(np.abs(matrix) < _DUST, 0.0, matrix)


@dataclass(frozen=True)
class Sensors:
    """The m sensors of one kind.

    Attributes
    ----------
    scale_error, asymmetric_scale_error : array, shape (m,)
        λ and μ.
    """

    kind: Kind
    H: Floats  #: shape (m, 3); design directions of the input axes, one per row
    #: shape (m, 3); projection of an error along a sensor's axis into the sensor frame
    projection: Floats
    bias: Floats  #: shape (m,); rad/s or m/s²
    scale_error: Floats
    asymmetric_scale_error: Floats
    axis_error: Floats  #: shape (m, 3); ``h' - h = -(δu v + δv u)``, rows

    def __len__(self) -> int:
        return len(self.bias)

    @property
    def unit(self) -> str:
        """Unit of an integrated error."""
        return "rad" if self.kind == "gyro" else "m/s"


def sensors_of(
    kind: Kind,
    axes_deg: tuple[tuple[float, float], ...],
    errors: Gyros | Accelerometers,
    fused: bool = False,
    weights: tuple[float, ...] | None = None,
) -> Sensors:
    """Return the sensors of a kind.

    Parameters
    ----------
    kind : "gyro" or "accelerometer"
    axes_deg : pairs of floats
        Polar angle from z_s and azimuth from x_s of each input axis. Paper, figure 1.
    errors : Gyros or Accelerometers
        Noise is ignored.
    fused : bool
        Whether an error is weighted by its share in the weighted least-squares solution (54)
        instead of acting along its own axis (24).
    weights : floats, optional
        Weights of the least squares; all 1 by default.
    """
    angles = np.radians(np.asarray(axes_deg, dtype=float))
    H = _without_dust(np.array([input_axis(alpha, beta) for alpha, beta in angles]))
    pairs = _without_dust(np.array([transverse_axes(alpha, beta) for alpha, beta in angles]))
    u, v = pairs[:, 0], pairs[:, 1]
    values = {
        name: np.full(len(H), value) for name, value in in_si(errors).items() if value is not None
    }
    delta_u, delta_v = values["installation_u"], values["installation_v"]
    return Sensors(
        kind=kind,
        H=H,
        projection=_without_dust(_gain(H, weights).T) if fused else H,
        bias=values["bias"],
        scale_error=values["scale_error"],
        asymmetric_scale_error=values["asymmetric_scale_error"],
        axis_error=-(delta_u[:, None] * v + delta_v[:, None] * u),
    )


def _gain(H: Floats, weights: tuple[float, ...] | None) -> Floats:
    """Return ``(H'WH)^-1 H'W``, shape (3, m). Paper, (54)."""
    root = np.sqrt(np.ones(len(H)) if weights is None else np.asarray(weights))
    return np.asarray(np.linalg.pinv(root[:, None] * H) * root)


def error_rates(sensors: Sensors, C_s_b: Floats, felt_s: Floats) -> Floats:
    """Return the rates of all errors of all sensors in the body frame. Paper, (24), (25), (35).

    Parameters
    ----------
    sensors : Sensors
    C_s_b : array, shape (n, 3, 3)
    felt_s : array, shape (n, 3)
        ω^s in rad/s, or f^s in m/s².

    Returns
    -------
    array, shape (n, m, 4, 3)
        rad/s or m/s², kinds in the order of `ERRORS`, then the axes x, y, z of the body.
    """
    along = felt_s @ sensors.H.T
    rate = np.empty((*along.shape, len(ERRORS)))
    rate[..., BIAS] = sensors.bias
    rate[..., MESSF] = sensors.scale_error * along
    rate[..., MEASF] = sensors.asymmetric_scale_error * np.abs(along)
    rate[..., MEIE] = felt_s @ sensors.axis_error.T
    projected_b = np.einsum("nij,mj->nmi", C_s_b, sensors.projection)
    rates: Floats = rate[..., None] * projected_b[:, :, None, :]
    return rates
