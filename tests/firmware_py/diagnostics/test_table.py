"""The table: everything can be found, packed and unpacked; no number stands twice."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.firmware_py.core.records.diagnostic_records import Snapshot
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.trouble_table import FIRST, TROUBLES
from rrins.firmware_py.core.records.troubles import Kind
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.codecs import Field, Layout, LengthError, ValueRangeError
from rrins.firmware_py.diagnostics.responses import MEANINGS, Code

LAYOUTS = {did.name: did.layout for did in table.IDENTIFIERS}
LAYOUTS |= {f"{routine.name} arguments": routine.argument_layout for routine in table.ROUTINES}
LAYOUTS |= {f"{routine.name} results": routine.result_layout for routine in table.ROUTINES}


@pytest.mark.parametrize("name", LAYOUTS)
def test_what_is_decoded_is_encoded_to_the_same_bytes(name):
    layout = LAYOUTS[name]
    for seed in (0, 1, 0x55):
        data = bytes((seed + 7 * k) & 0x3F for k in range(layout.size))
        data = b"".join(
            b"text".ljust(field.size) if field.format == "ascii" else data[: field.size]
            for field in layout.fields
        )
        assert layout.encode(layout.decode(data)) == data


@given(st.sampled_from([8, 16, 24, 32, 64]), st.data())
def test_integers_of_every_length(bits, data):
    field = Field("x", f"u{bits}", count=data.draw(st.integers(1, 4)))  # type: ignore[arg-type]  # one of a Literal
    values = tuple(data.draw(st.integers(0, 2**bits - 1)) for _ in range(field.count))
    packed = field.pack(values if field.count > 1 else values[0])
    assert packed == b"".join(value.to_bytes(bits // 8, "big") for value in values)
    assert field.unpack(packed) == (values if field.count > 1 else values[0])


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.5, 3.5])
def test_a_value_beyond_its_limits_is_refused(value):
    with pytest.raises(ValueRangeError, match="x"):
        Field("x", "f64", minimum=-1.0, maximum=3.0).check(value)


def test_a_number_without_a_name_is_refused():
    with pytest.raises(ValueRangeError, match="INNER"):
        table.routine("go_to_axis_angle").argument_layout.check({"axis": 2, "angle_deg": 0.0})


def test_a_value_that_does_not_fit_is_refused():
    with pytest.raises(ValueRangeError):
        Field("x", "u8").pack(256)
    with pytest.raises(ValueRangeError, match="missing or unknown: y"):
        Layout((Field("x", "u8"),)).encode({"x": 1, "y": 2})
    with pytest.raises(LengthError):
        Layout((Field("x", "u16"),)).decode(b"\0")


def test_everything_is_found_by_number_and_by_name():
    for did in table.IDENTIFIERS:
        assert table.identifier(did.number) is table.identifier(did.name) is did
    for routine in table.ROUTINES:
        assert table.routine(routine.number) is table.routine(routine.name) is routine
    for trouble in table.TROUBLES:
        assert table.trouble(trouble.number) is table.trouble(trouble.name) is trouble
    with pytest.raises(table.UnknownError, match="no data identifier 0x9999"):
        table.identifier(0x9999)
    with pytest.raises(table.UnknownError, match="no routine dance"):
        table.routine("dance")


def test_everything_says_what_it_is():
    for thing in (*table.IDENTIFIERS, *table.ROUTINES, *table.TROUBLES, *table.SERVICES):
        assert thing.text, thing.name
    assert set(MEANINGS) == set(Code)


def test_trouble_codes_stand_in_the_order_of_their_bits():
    for index, trouble in enumerate(TROUBLES):
        assert FIRST[trouble.kind] + trouble.bit == index
    assert {trouble.kind for trouble in TROUBLES} == set(Kind)


def test_a_freeze_frame_has_all_that_its_identifiers_read():
    for did in table.SNAPSHOT:
        for field in did.fields:
            for dtype in (Snapshot.dtype, Ram.dtype):
                for part in field.source.split("."):
                    if not part.isdigit():
                        dtype = dtype.fields[part][0]


def test_the_code_is_written_as_sae_j2012_does():
    assert table.trouble("sensor_3_silent").code == "U1103-87"
    assert table.trouble("gyro_16_saturated").code == "C1110-85"
    assert table.trouble("bus_off").code == "U1004-88"


def test_the_regions_are_the_fields_of_the_ram_image():
    whole, *parts = table.regions()
    assert whole.size == Ram.dtype.itemsize == sum(part.size for part in parts)
    assert [part.name for part in parts] == list(Ram.dtype.names or ())
    assert all(a.address + a.size == b.address for a, b in itertools.pairwise(parts))
