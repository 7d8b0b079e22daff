"""Faults of the hardware by epoch: planned, put in and taken out while it runs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.host_tools.hardware import faults
from rrins.host_tools.hardware.fault_kinds import HardwareFault
from rrins.host_tools.hardware.sensors import installed_axis, measure
from rrins.host_tools.hardware.settings import PlannedFault, power_on
from rrins.host_tools.hardware.tables import Accelerometers, Gyros
from rrins.host_tools.hardware.units import ARCSEC
from rrins.host_tools.hardware.units import STANDARD_GRAVITY as G

ALPHA, BETA = 0.7, 1.1
INPUT = np.array([0.3, -0.2, 0.4])
ALONG = float(installed_axis(ALPHA, BETA, 0.0, 0.0) @ INPUT)
RANGE = 1.0
DT = 0.005


def increments(tools, kind, value=0.0, epochs=1, cycle=faults.ALWAYS, of="gyros", **errors):
    """Return what the sensor makes of `INPUT` in each epoch of a fault, and its flags."""
    axes = {f"{of[:-1]}_axes_deg": [tuple(np.degrees((ALPHA, BETA)))]}
    table = Gyros if of == "gyros" else Accelerometers
    wide = {"range_dps": math.degrees(RANGE / DT)} if of == "gyros" else {"range_g": RANGE / DT / G}
    sensors = {of: table(**wide | errors)}
    planned = PlannedFault(HardwareFault[f"{of[:-1].upper()}_{kind}"], 0, 0, -1, value, cycle)
    plant = power_on(tools.settings(**axes | sensors, faults=(planned,)))[0]
    found, flags = [], 0
    for epoch in range(epochs):
        plant["epoch"] = epoch
        faults.apply(plant)
        measure(plant[of], INPUT, np.zeros(3), 1e-12, 1 << 60)
        found.append(plant[of]["counts"][0] * 1e-12)
        flags |= int(plant[of]["saturated"])
    return found, flags


@pytest.mark.parametrize("of", ["gyros", "accelerometers"])
@pytest.mark.parametrize(
    ("kind", "value", "expected", "flag"),
    [
        ("BIAS", 2.0, ALONG + 2.0 * DT, 0),
        ("RAMP", 3.0, ALONG + 3.0 * DT**2 / 2, 0),  # the mean of the first epoch
        ("SCALE", 0.01, ALONG * 1.01, 0),
        ("SHIFT_U", 1e-3, installed_axis(ALPHA, BETA, 1e-3, 0.0) @ INPUT, 0),
        ("SHIFT_V", 1e-3, installed_axis(ALPHA, BETA, 0.0, 1e-3) @ INPUT, 0),
        ("DEAD", 0.0, 0.0, 0),
        ("FULL_SCALE", 0.0, RANGE, 1),
    ],
)
def test_what_a_failing_sensor_reads(tools, of, kind, value, expected, flag):
    (first,), flags = increments(tools, kind, value, of=of)
    assert (first, flags) == (pytest.approx(expected, abs=2e-12), flag)


def test_a_shift_adds_to_the_installation_error_and_ends_with_it(tools):
    cycle, installed = (
        (4, 2),
        {
            "installation_u_arcsec": 2e-3 / ARCSEC,
            "installation_v_arcsec": -1e-3 / ARCSEC,
        },
    )
    found, _ = increments(tools, "SHIFT_U", 1e-3, 6, cycle, **installed)
    shifted, sound = (installed_axis(ALPHA, BETA, u, -1e-3) @ INPUT for u in (3e-3, 2e-3))
    expected = [shifted, shifted, sound, sound, shifted, shifted]
    np.testing.assert_allclose(found, expected, atol=2e-12)


def test_a_ramp_grows_from_epoch_to_epoch(tools):
    found, _ = increments(tools, "RAMP", 3.0, epochs=400)
    seconds = 400 * DT
    assert sum(found) - 400 * ALONG == pytest.approx(3.0 * seconds**2 / 2, abs=1e-9)


def test_a_cycle_is_on_for_its_share_and_never_always_or_never():
    period_ns = 5_000_000
    assert faults.cycle_of(10.0, 0.2, period_ns) == (2000, 400)
    assert faults.cycle_of(1e-9, 0.5, period_ns) == (2, 1)
    assert faults.cycle_of(0.1, 1 - 1e-9, period_ns) == (20, 19)
    assert faults.cycle_of(0.1, 1e-9, period_ns) == (20, 1)
