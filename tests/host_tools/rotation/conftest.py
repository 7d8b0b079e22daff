"""RIMUs with errors, as the tests of this room need them."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.host_tools.hardware.tables import Accelerometers, Gyros
from rrins.host_tools.hardware.units import ARCSEC, DPH, PPM, UG
from rrins.host_tools.rotation.errors import sensors_of
from rrins.host_tools.rotation.merit import SensorSet
from rrins.host_tools.scenario.geometry import GEOMETRIES

PAPER = {
    "gyro": Gyros(
        bias_dph=0.1,
        scale_error_ppm=50,
        asymmetric_scale_error_ppm=50,
        installation_u_arcsec=10,
        installation_v_arcsec=10,
    ),
    "accelerometer": Accelerometers(
        bias_ug=50,
        scale_error_ppm=30,
        asymmetric_scale_error_ppm=30,
        installation_u_arcsec=10,
        installation_v_arcsec=10,
    ),
}
"""Of sensor 3 in the paper, 4.2."""


def of_paper(kind, axes_deg, fused=False):
    """Return sensors that all have the paper's errors."""
    return sensors_of(kind, tuple(axes_deg), PAPER[kind], fused)


def si_sensors(kind, axes_deg, bias=0.0, scale=0.0, asymmetric=0.0, delta_u=0.0, delta_v=0.0):
    """Return sensors with errors in SI units, each a number or one per sensor."""
    table, key, unit = {
        "gyro": (Gyros, "bias_dph", DPH),
        "accelerometer": (Accelerometers, "bias_ug", UG),
    }[kind]
    keys = {
        key: np.divide(bias, unit),
        "scale_error_ppm": np.divide(scale, PPM),
        "asymmetric_scale_error_ppm": np.divide(asymmetric, PPM),
        "installation_u_arcsec": np.divide(delta_u, ARCSEC),
        "installation_v_arcsec": np.divide(delta_v, ARCSEC),
    }
    plain = {name: tuple(v) if np.ndim(v) else float(v) for name, v in keys.items()}
    return sensors_of(kind, axes_deg, table(**plain))


def paper_rimu(geometry="tetrahedron", fused=False):
    """Return a RIMU of a built-in geometry, all sensors with the paper's errors."""
    axes = GEOMETRIES[geometry]
    return SensorSet(of_paper("gyro", axes, fused), of_paper("accelerometer", axes, fused))


@pytest.fixture
def random():
    return np.random.default_rng(351)
