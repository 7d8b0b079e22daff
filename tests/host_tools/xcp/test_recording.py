"""Packing of signals into packets, putting them together, names, and files."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("pyxcp")

from rrins.host_tools.cli.main import rrins
from rrins.host_tools.errors import XcpError
from rrins.host_tools.xcp.recording import Recording, packed
from rrins.host_tools.xcp.samples import Samples
from rrins.host_tools.xcp.signals import fields_like, signals_of
from rrins.host_tools.xcp.writing import write

SIGNALS = signals_of(["epoch", "modes.mode", "gyros.calibrated", "dtheta_s", "C_s_b"])


@given(st.lists(st.sampled_from(SIGNALS), min_size=1, max_size=60))
def test_entries_cover_every_byte_in_order(signals):
    odts = packed(signals)
    sizes = [sum(size for _, size in odt) for odt in odts]
    assert sizes[0] <= 3
    assert all(0 < size <= 7 for size in sizes[1:])
    covered = [a + k for odt in odts for a, size in odt for k in range(size)]
    assert covered == [signal.address + k for signal in signals for k in range(signal.size)]


def test_too_many_signals_are_refused():
    with pytest.raises(XcpError, match="of 192 at most"):
        packed(SIGNALS[:1] * 200)


@given(st.lists(st.integers(0, 3), max_size=60))
def test_only_whole_samples_count(numbers):
    samples = Samples(4)
    for number in numbers:
        samples.put(bytes([number]) + bytes([number] * 7))
    assert all(row == bytes(k for n in range(4) for k in [n] * 7) for row in samples.rows)
    text = "".join(map(str, numbers))
    assert len(samples.rows) == text.count("0123")


def test_an_array_stands_for_its_elements():
    names = [signal.name for signal in signals_of(["C_s_b"])]
    assert names[:4] == ["C_s_b[0][0]", "C_s_b[0][1]", "C_s_b[0][2]", "C_s_b[1][0]"]
    assert [s.address for s in signals_of(["C_s_b[1][0]"])] == [SIGNALS[-9].address + 24]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("navigation.latitud", "did you mean navigation.latitude"),
        ("dtheta_s[3]", r"has the shape \[3\]"),
        ("qqq", "shows all"),
        ("", "shows all"),
    ],
)
def test_a_wrong_name_is_told(name, words):
    with pytest.raises(XcpError, match=words):
        signals_of([name])


def test_list_shows_parameters_with_their_limits():
    assert [name for name, *_ in fields_like("gyros.cal*")] == ["gyros.calibrated"]
    listed = CliRunner().invoke(rrins, ["xcp", "list", "bridge_epochs", "--json"])
    (row,) = json.loads(listed.output)
    assert (row["minimum"], row["maximum"], row["type"]) == (0, 10_000, "int64")


def recording() -> Recording:
    time_s = np.arange(3) * 0.005
    values: dict[str, np.ndarray] = {
        "epoch": np.arange(3),
        "modes.mode": np.full(3, 5),
        "gyros.calibrated": np.array([False, True, True]),
        "dtheta_s[0]": np.array([1e-9, -2.5e-5, 0.1]),
    }
    signals = signals_of(list(values))
    units = {signal.name: signal.field.unit for signal in signals}
    texts = {signal.name: signal.field.text for signal in signals}
    return Recording(time_s, values, units, texts, 0, 0, 0.1)


def columns_of(path):
    if path.suffix == ".parquet":
        parquet = pytest.importorskip("pyarrow.parquet")
        table = parquet.read_table(path)
        assert table.schema.field("dtheta_s[0]").metadata[b"unit"] == b"rad"
        return {name: table[name].to_pylist() for name in table.column_names}
    if path.suffix == ".csv":
        head, *rows = (line.split(",") for line in path.read_text().splitlines())
        words = {"True": 1.0, "False": 0.0}
        columns = zip(*rows, strict=True)
        return {
            name: [words[cell] if cell in words else float(cell) for cell in column]
            for name, column in zip(head, columns, strict=True)
        }
    if path.suffix == ".mf4":
        with pytest.importorskip("asammdf").MDF(path) as mdf:
            found = {name: mdf.get(name) for name in recording().values}
            assert found["dtheta_s[0]"].unit == "rad"
            return {name: signal.samples.tolist() for name, signal in found.items()} | {
                "time": found["epoch"].timestamps.tolist()
            }
    reader = pytest.importorskip("mcap.reader")
    with path.open("rb") as file:
        messages = [message for _, _, message in reader.make_reader(file).iter_messages()]
    rows = [json.loads(message.data) for message in messages]
    return {name: [row[name] for row in rows] for name in recording().values} | {
        "time": [message.log_time / 1e9 for message in messages]
    }


@pytest.mark.parametrize("ending", ["parquet", "csv", "mf4", "mcap"])
def test_files_have_every_value(tmp_path, ending):
    path = tmp_path / f"out.{ending}"
    write(recording(), path)
    columns = columns_of(path)
    assert columns["time"] == [0.0, 0.005, 0.01]
    for name, column in recording().values.items():
        assert [float(value) for value in columns[name]] == column.astype(float).tolist()
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize(
    ("out", "status", "words"),
    [
        ("out.txt", 25, "ends in none of .parquet, .csv, .mf4, .mcap"),
        ("missing/out.csv", 25, "missing is not a folder to write to"),
        ("out.parquet", 1, "this needs pyarrow: pip install 'rrins[tables]'"),
    ],
)
def test_a_file_that_cannot_be_written_is_told_before_it_is_measured(
    tmp_path, monkeypatch, out, status, words
):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(rrins, ["xcp", "record", out, "epoch", "--channel", "nobody"])
    assert (result.exit_code, words in result.output) == (status, True), result.output
