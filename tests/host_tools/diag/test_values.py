"""Values as text, and text as values."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.codecs import Field, Layout
from rrins.host_tools.diag.values import AssignmentError, parse_values, to_json, value_text

ANY_FIELD = st.sampled_from([f for did in table.IDENTIFIERS for f in did.fields])


@given(st.lists(st.floats(-3600, 3600), min_size=1, max_size=1).map(lambda v: v[0]))
def test_a_number_that_is_written_is_read_the_same(number):
    angle = table.identifier("axis_inner_control").fields[0]
    assert parse_values([angle], [f"target_angle_deg={number!r}"]) == {"target_angle_deg": number}
    assert parse_values([angle], [repr(number)]) == {"target_angle_deg": number}


@pytest.mark.slow
@given(ANY_FIELD, st.text(max_size=40))
def test_any_text_is_a_value_or_an_error(field, text):
    with contextlib.suppress(AssignmentError):
        values = parse_values([field], [f"{field.name}={text}"])
        field.check(values[field.name])
        field.pack(values[field.name])


def test_names_and_whole_numbers():
    method, seconds = table.identifier("alignment").fields
    for text in ("SELF_ALIGNED", "self-aligned", "1", "0x1"):
        assert parse_values([method, seconds], [f"method={text}", "alignment_s=3"])["method"] == 1
    with pytest.raises(AssignmentError, match="method is given twice"):
        parse_values([method, seconds], ["method=1", "method=0"])
    with pytest.raises(AssignmentError, match="missing: alignment_s="):
        parse_values([method, seconds], ["method=1"])


def test_equal_values_at_the_end_are_shown_once():
    row = Field("row", "f64", count=6)
    assert value_text(row, (1.0, 2.5, 0.0, 0.0, 0.0, 0.0)) == "1, 2.5, 0 (×4)"
    assert value_text(row, (1.0, 2.0, 3.0, 4.0, 5.0, 5.0)) == "1, 2, 3, 4, 5, 5"


@given(st.decimals(-(10**6), 10**6, places=2).map(float))
def test_json_has_numbers_as_they_were_typed(number):
    """An f32 has seven digits at least; a product with a unit is a few parts in 1e16 off."""
    layout = Layout((Field("short", "f32"), Field("long", "f64", count=2), Field("count", "u8")))
    typed = float(f"{number:.6g}")
    long = (number, number * 1e-9 / 1e-9)
    read = layout.decode(layout.encode({"short": typed, "long": long, "count": 7}))
    assert to_json(layout, read) == {"short": typed, "long": [number, number], "count": 7}


def test_json_of_what_is_no_number():
    layout = Layout((Field("short", "f32", count=2), Field("name", "ascii", count=3)))
    found = to_json(layout, {"short": (float("inf"), -0.0), "name": "abc"})
    assert found == {"short": [float("inf"), 0.0], "name": "abc"}
