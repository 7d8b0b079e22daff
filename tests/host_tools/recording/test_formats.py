"""Every format, read by python-can and cantools alone, says what our reader and tables say."""

from __future__ import annotations

import shutil
import subprocess
import sys

import can
import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest

from rrins.dbc.codec import load
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.logs.signals import signals_of
from rrins.host_tools.logs.tables import export
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.recording.formats import READ, check_path, open_writer

RESOLUTION_S = {".log": 1e-6, ".asc": 1e-6, ".trc": 1e-6, ".blf": 2e-9}
TABLES = {"parquet": pyarrow.parquet.read_table, "csv": pyarrow.csv.read_csv}


@pytest.mark.slow
@pytest.mark.parametrize("ending", READ)
def test_python_can_and_cantools_decode_the_same_values(recordings, tmp_path, ending):
    recorded = recordings(ending)
    assert recorded.recorder.failure is None
    kind = "csv" if ending == ".log" else "parquet"
    exported = export(Log(recorded.path), tmp_path, kind)
    database = load().database
    theirs = {}
    with can.LogReader(recorded.path) as reader:
        for message in reader:
            values = database.decode_message(
                message.arbitration_id, bytes(message.data), decode_choices=False
            )
            name = database.get_message_by_frame_id(message.arbitration_id).name
            theirs.setdefault(name, []).append((message.timestamp, values))
    assert exported.rows == {name: len(rows) for name, rows in theirs.items()}
    assert sum(exported.rows.values()) == recorded.recorder.frames
    for name, rows in theirs.items():
        table = TABLES[kind](tmp_path / f"{name}.{kind}")
        assert table["time_s"].to_pylist() == [time_s for time_s, _ in rows]
        assert all(table["crc_holds"].to_pylist())
        for signal in signals_of(name):
            assert table[signal.column].to_pylist() == [values[signal.name] for _, values in rows]
            if signal.choices:
                names = [signal.choices[values[signal.name]] for _, values in rows]
                assert table[f"{signal.name}_name"].to_pylist() == names


@pytest.mark.parametrize("ending", READ)
def test_the_time_of_a_frame_is_the_simulated_time_of_its_epoch(recordings, read, ending):
    recorded = recordings(ending)
    piece = read(recorded.path)
    sync = piece.frames["can_id"] == load().frame_id("SYNC")
    period_s = recorded.scenario.period_ns * 1e-9
    expected_s = np.arange(np.count_nonzero(sync)) * period_s
    resolution_s = RESOLUTION_S.get(ending, 0) + 1e-12
    assert np.max(np.abs(piece.time_s[sync] - expected_s)) <= resolution_s
    assert np.all(np.diff(piece.time_s) >= 0)
    assert recorded.recorder.note.time == "simulated"


def test_candump_is_read_as_python_can_reads_it(tmp_path, read):
    path = tmp_path / "odd.log"
    path.write_text(
        "(1436509052.249713) vcan0 044#2A366C2BBA\n"
        "\n"
        "(1436509052.449847) can1 12345678#AABBCCDDEEFF0011 T\n"
        "(1436509052.650004) vcan0 0F6#R\r\n"
        "  (0000000001.5) vcan0 7FF# R\n"
        "(1436509052.850004) vcan0 123##1AABB\n"
        "(1436509053.000001) vcan0 20000080#0000000000000000\n"
    )
    piece = read(path)
    theirs = [message for message in can.LogReader(path) if not message.is_fd]
    assert piece.time_s.tolist() == [message.timestamp for message in theirs]
    assert piece.frames["can_id"].tolist() == [
        0x044, 0x12345678 | 0x8000_0000, 0x0F6 | 0x4000_0000, 0x7FF, 0x20000080,
    ]  # fmt: skip
    assert piece.frames["length"].tolist() == [5, 8, 0, 0, 8]
    assert int(piece.frames["data"][1]).to_bytes(8, "little") == bytes(theirs[1].data)


@pytest.mark.parametrize("ending", [".log.gz", ".asc.gz", ".csv.gz", ".trc.gz"])
def test_a_packed_log_holds_the_same_frames(recordings, tmp_path, read, ending):
    path = tmp_path / f"packed{ending}"
    writer = open_writer(path)
    with can.LogReader(recordings(".log").path) as reader:
        for message in reader:
            writer.on_message_received(message)
    writer.stop()
    assert path.read_bytes().startswith(b"\x1f\x8b")
    assert np.array_equal(read(path).frames, read(recordings(".log").path).frames)


@pytest.mark.parametrize("ending", READ)
def test_a_recording_takes_the_place_of_the_one_before(tmp_path, read, ending):
    path = tmp_path / f"bus{ending}"
    for count in (30, 2):
        writer = open_writer(path)
        for k in range(count):
            writer.on_message_received(
                can.Message(timestamp=k, arbitration_id=k, is_extended_id=False, data=[k])
            )
        writer.stop()
        assert read(path).frames["can_id"].tolist() == list(range(count))


@pytest.mark.parametrize("ending", READ)
@pytest.mark.parametrize("channel", ["rrins0", "test-4711", "bus-99999", None, 3])
def test_a_channel_may_have_any_name(tmp_path, read, ending, channel):
    writer = open_writer(tmp_path / f"bus{ending}")
    writer.on_message_received(can.Message(arbitration_id=5, channel=channel, data=[1]))
    writer.stop()
    assert len(read(tmp_path / f"bus{ending}")) == 1


def test_mf4_without_asammdf_is_one_line(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "asammdf", None)
    with pytest.raises(RecordError, match=r"bus\.mf4: \.mf4 needs asammdf: pip install asammdf$"):
        open_writer(tmp_path / "bus.mf4")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("bus.xls", "must be one of"),
        ("bus.blf.gz", "must be one of"),
        ("bus", "must be one of"),
        ("no/bus.log", "no such folder"),
    ],
)
def test_a_path_that_cannot_be_recorded_to(tmp_path, name, words):
    with pytest.raises(RecordError, match=words):
        check_path(tmp_path / name)


def test_a_candump_log_is_as_candump_writes_it(tmp_path):
    """Without a direction, which python-can's writer appends and Wireshark refuses."""
    path = tmp_path / "bus.log"
    writer = open_writer(path)
    for k, keys in enumerate(
        (
            {"arbitration_id": 0x10, "data": bytes(range(8)), "is_extended_id": False},
            {"arbitration_id": 0x10, "data": b"", "is_extended_id": False, "is_rx": False},
            {"arbitration_id": 0x18ABCDEF, "is_remote_frame": True},
            {"is_error_frame": True},
        )
    ):
        writer.on_message_received(can.Message(timestamp=k * 0.5, channel="rrins0", **keys))
    writer.stop()
    assert path.read_text().splitlines() == [
        "(0.000000) rrins0 010#0001020304050607", "(0.500000) rrins0 010#",
        "(1.000000) rrins0 18ABCDEF#R", "(1.500000) rrins0 20000080#",
    ]  # fmt: skip
    if tshark := shutil.which("tshark"):
        read = subprocess.run([tshark, "-r", path], capture_output=True, text=True, check=True)
        assert "Ext. ID: 413912559 (0x18abcdef)" in read.stdout
