"""Numbers as people read them."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from rrins.host_tools.rounding import (
    alike,
    as_stated,
    coarse,
    plus_minus,
    rounded,
    with_limits,
    with_sigma,
    with_unit,
)

ROOT = Path(__file__).parents[2]
ROOMS = ("rrins", "host_tools", "firmware_py")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (14.0, "14.0"),
        (8.94, "8.94"),
        (709.2, "709"),
        (2850.0, "2,850"),
        (28_512.0, "28,500"),
        (9.996, "10.0"),
        (999.6, "1,000"),
        (0.001234, "0.00123"),
        (-0.000123, "-1.23e-04"),
        (2.85e7, "2.85e+07"),
        (0.0, "0"),
        (None, "–"),
        (math.nan, "–"),
        (-math.inf, "-∞"),
    ],
)
def test_numbers_have_three_digits(value: float | None, text: str) -> None:
    assert rounded(value) == text


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (1.718, 0.0089, "1.7180 ± 0.0089"),
        (-13.754, 1.0, "-13.8 ± 1.0"),
        (0.0123, 0.0996, "0.01 ± 0.10"),
        (28_512.0, 312.0, "28,510 ± 310"),
        (-0.001, 30.0, "0 ± 30"),
        (0.0, 0.5, "0.00 ± 0.50"),
        (0.0, 2e-5, "0.0e-05 ± 2.0e-05"),
        (1.718e-8, 8.9e-11, "1.7180e-08 ± 0.0089e-08"),
        (12.345, math.nan, "12.3"),
        (12.345, None, "12.3"),
        (None, 1.0, "– ± 1.0"),
    ],
)
def test_a_value_ends_where_its_sigma_does(
    value: float | None, sigma: float | None, text: str
) -> None:
    assert plus_minus(value, sigma) == text


def test_a_value_without_uncertainty_has_three_digits() -> None:
    assert with_sigma(2.0, 0.0) == ("2.00", "0")


def test_numbers_that_are_compared_have_the_same_decimals() -> None:
    assert alike([14.0, 8.94, None, 0.0]) == ["14.0", "8.9", "–", "0.0"]
    assert alike([2853.0, 709.0]) == ["2,850", "710"]
    assert alike([3e7, 1e5]) == ["3.00e+07", "0.01e+07"]
    assert alike([]) == []


def test_a_length_has_the_unit_that_fits() -> None:
    lengths = {2214.0: "2.21 km", 12.4: "12.4 m", 0.0031: "3.10 mm", 0.0: "0 m", None: "–"}
    assert {value: with_unit(value, "m") for value in lengths} == lengths
    assert with_unit(2214.0, "m/s") == "2,210 m/s"
    stated = {9000.0: "9 km", 950.0: "950 m", 14.5: "14.5 m", 0.005: "5 mm", None: "–"}
    assert {value: as_stated(value, "m") for value in stated} == stated


@pytest.mark.parametrize(
    ("numbers", "text"),
    [
        ((12.34, 10.1, 14.9), "12.3 (10.1 to 14.9)"),
        ((0.0, 0.0, 3.689), "0.0 (0.0 to 3.7)"),
        ((0.1, 0.0026, 0.5568), "0.100 (0.003 to 0.557)"),
        ((98.0, 93.0, 99.75), "98.0 (93.0 to 99.8)"),
        ((111.8, 105.0, 119.6), "112 (105 to 120)"),
        ((208.3, 208.1, 208.6), "208.3 (208.1 to 208.6)"),
        ((5.0, 5.0, 5.0), "5.00"),
        ((5.0, None, 6.0), "5.00"),
    ],
)
def test_an_interval_has_the_decimals_it_deserves(
    numbers: tuple[float, float | None, float | None], text: str
) -> None:
    assert with_limits(*numbers) == text


def test_nothing_else_rounds_to_significant_digits() -> None:
    """Five digits and more are for files."""
    sources = (one for room in ROOMS for one in (ROOT / room).rglob("*.py"))
    assert not [one for one in sources if re.search(r":[^{}]*\.[1-4]g\}", one.read_text("utf-8"))]


def test_figures_from_random_draws_have_two_digits_and_three_from_10_on():
    figures = {0.0123: "0.012", 1.234: "1.2", 45.67: "45.7", 1234.5: "1,230", math.inf: "–"}
    assert {value: coarse(value) for value in figures} == figures
