"""Records: one declaration for numpy, the compiler and the checker."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest

from rrins.compiled.compilation import compiled
from rrins.compiled.record import I8, U1, Bool, Floats, Record, Records
from rrins.firmware_py.core.records.memory import Ram
from rrins.host_tools.hardware.memory import Plant

ROOT = Path(__file__).parents[3]


class Inner(Record):
    """A record inside another."""

    flag: Bool
    small: U1


class Outer(Record):
    """A record of every kind of field."""

    count: I8
    inner: Inner
    several: Annotated[Records[Inner], 2]
    vector: Annotated[Floats, 3]
    matrix: Annotated[Floats, (2, 3)]


def named_in(dtype):
    for name in dtype.names or ():
        yield name
        yield from named_in(dtype[name].base)


@pytest.mark.parametrize("record", [Ram, Plant])
def test_no_field_has_a_name_that_numpy_takes_for_its_own(record):
    """In plain Python `record.size` would be the number of elements, whatever the field holds."""
    assert set(named_in(record.dtype)) & set(dir(np.record)) == set()


def test_the_dtype_is_packed_in_the_order_of_the_fields():
    inner = np.dtype([("flag", "?"), ("small", "u1")])
    expected = np.dtype(
        [
            ("count", "<i8"),
            ("inner", inner),
            ("several", inner, (2,)),
            ("vector", "<f8", (3,)),
            ("matrix", "<f8", (2, 3)),
        ]
    )
    assert Outer.dtype.fields == expected.fields
    assert Outer.dtype.itemsize == expected.itemsize == 8 + 2 + 4 + 24 + 48


def test_a_record_is_read_and_written_by_its_fields():
    (record,) = records = Outer.zeros()
    record.count = 3
    record.inner.small = 200
    record.several[1].flag = True
    record.vector[:] = 1, 2, 3
    assert records["count"][0] == 3
    assert records["inner"]["small"][0] == 200
    assert records["several"]["flag"][0].tolist() == [False, True]
    assert record["vector"].tolist() == [1, 2, 3]


@compiled
def fill(records: Records[Outer]) -> float:
    record = records[0]
    record.inner.flag = True
    record.matrix[1, 2] = 4.5
    return record.matrix[1, 2] + record.count


def test_compiled_code_reads_the_same_fields():
    records = Outer.zeros()
    records["count"] = 2
    assert fill(records) == 6.5
    assert records[0].inner.flag
    assert records.tobytes()[-8:] == np.float64(4.5).tobytes()


def test_what_is_no_memory_of_fixed_size_is_refused():
    with pytest.raises(TypeError, match=r"Wrong\.text"):

        class Wrong(Record):
            text: str


def test_every_field_of_the_ram_image_has_its_place():
    assert Ram.dtype.names is not None
    assert "ins" in Ram.dtype.names
    assert Ram.zeros().tobytes() == bytes(Ram.dtype.itemsize)


@pytest.mark.typed
def test_a_misspelt_field_is_an_error_of_the_checker(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from rrins.firmware_py.core.records.memory import Ram\n\n\n"
        "def speed(state: Ram) -> float:\n"
        "    right = state.ins.velocity_n[0]\n"
        "    return right + state.ins.velocity_m[0]\n"
    )
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--no-error-summary", str(script)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    error = '"Ins" has no attribute "velocity_m"; maybe "velocity_n"?  [attr-defined]'
    # A second run takes the message, path and all, out of mypy's cache.
    told = [line.rpartition("/")[2] for line in done.stdout.splitlines()]
    assert told == [f"script.py:6: error: {error}"]
