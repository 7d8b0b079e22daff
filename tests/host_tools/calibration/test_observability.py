"""Observability by schemes: table 1 leaves out what its axes cannot excite."""

from __future__ import annotations

import numpy as np

from rrins.firmware_py.core.sensors.calibration import DPH, UG
from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.calibration.estimation import estimate
from rrins.host_tools.calibration.observability import LIMITS, observe
from rrins.host_tools.calibration.search import SearchLimits, search
from rrins.host_tools.calibration.table import record
from rrins.host_tools.calibration.unit import drawn_unit, unit_of
from rrins.host_tools.scenario.schemes import SCHEMES

UNIT = unit_of(drawn_unit(1))
CALIBRATION = Scheme(turns=SCHEMES["calibration"])


def test_table_1_shows_neither_all_scale_factors_nor_all_angles() -> None:
    found = observe(Scheme(turns=SCHEMES["16-position"]), UNIT)
    assert found.duration_s == 1600.0
    assert (found.rms[0][[1, 3]] > 100 * LIMITS[0][[1, 3]]).all()
    named = {name for direction in found.unseen for name, _ in direction.parts}
    assert {"λ of gyro 3", "δu of gyro 1", "δv of accelerometer 1"} <= named


def test_the_built_in_scheme_shows_all() -> None:
    found = observe(CALIBRATION, UNIT)
    assert found.duration_s == 1720.0
    assert not found.unseen
    for sigma, limit in zip(found.rms, LIMITS, strict=True):
        assert (sigma < 1.1 * limit).all()


def test_theory_agrees_with_what_a_calibration_reports() -> None:
    found = observe(CALIBRATION, UNIT)
    reported = estimate(UNIT, record(drawn_unit(1), CALIBRATION))
    for theory, one, unit in zip(
        (found.gyro_sigma, found.accelerometer_sigma),
        (reported.gyros.sigma, reported.accelerometers.sigma),
        (DPH, UG),
        strict=True,
    ):
        np.testing.assert_allclose(one[:, 0] / unit, theory[:, 0], rtol=0.1)


def test_the_search_keeps_its_limits_and_gains() -> None:
    limits = SearchLimits(duration_s=900.0, inner_range_deg=360.0)
    found = search(UNIT, limits, CALIBRATION, tries=1500)
    assert found.scheme.cycle_s <= 900.0
    inner = np.cumsum([t.angle_deg for t in found.scheme.turns if t.axis == "inner"])
    assert inner[-1] == 0.0
    assert max(inner.max(), 0) - min(inner.min(), 0) <= 360.0
    better = search(UNIT, limits, CALIBRATION, tries=6000)
    assert better.merit < found.merit
