"""Numbers as digits and a power of ten."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.dbc.contract import load_contract
from rrins.dbc.decimals import from_decimal, to_decimal

LAYOUT = load_contract()[0]["hardware_fault_active"]
SIGNALS = LAYOUT["value"], LAYOUT["exponent"]


@given(st.integers(-99999, 99999), st.integers(-8, 7))
def test_a_decimal_number_comes_back_as_written(digits, exponent):
    written = float(f"{digits}e{exponent}")
    assert from_decimal(*to_decimal(written, *SIGNALS)) == written


@given(st.floats(-1e11, 1e11))
def test_any_number_comes_back_to_five_digits(value):
    digits, exponent = to_decimal(value, *SIGNALS)
    assert abs(digits) <= 524287
    assert -8 <= exponent <= 7
    assert from_decimal(digits, exponent) == pytest.approx(value, rel=1e-5, abs=0.6e-8)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.0, (0, 0)),
        (10, (1, 1)),
        (0.1, (1, -1)),
        (-2.5, (-25, -1)),
        (180, (18, 1)),
        (1e-9, (0, 0)),
    ],
)
def test_as_few_digits_as_say_it(value, said):
    assert to_decimal(value, *SIGNALS) == said


def test_what_is_too_large():
    assert to_decimal(5e12, *SIGNALS) == (500000, 7)
    with pytest.raises(ValueError, match=r"5\.3e\+12 is too large"):
        to_decimal(5.3e12, *SIGNALS)
