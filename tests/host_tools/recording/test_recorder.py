"""The recorder writes every frame, in order, with one clock, in as many files as asked for."""

from __future__ import annotations

import errno
import os
import shutil
import time
from pathlib import Path

import can
import numpy as np
import pytest

from rrins.dbc.codec import load
from rrins.dbc.frame import frame_array
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.errors import BusError
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.logs.replay import replay
from rrins.host_tools.logs.tables import export
from rrins.host_tools.recording import recorder as recording
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.recording.note import Note, Part, write_note
from rrins.host_tools.recording.recorder import Recorder

SYNC = load().frame_id("SYNC")
STATUS = load().frame_id("AXIS_OUTER_STATUS")
COMMAND = load().frame_id("AXIS_OUTER_COMMAND")
STRANGER = 0x7DE


def batch(*identifiers):
    frames = frame_array(len(identifiers))
    frames["can_id"] = identifiers
    frames["length"] = 8
    return frames


def test_a_recording_lacks_nothing(recordings):
    recorded = recordings()
    assert recorded.recorder.failure is None
    assert Log(recorded.path).size == recorded.path.stat().st_size
    sent = recorded.firmware.frames_received + recorded.firmware.frames_sent
    assert recorded.recorder.frames == sent


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".log", ".asc", ".mf4", ".blf", ".log.gz"])
def test_parts_are_read_as_one(rehearse, short, read, tmp_path, ending, recordings):
    path = tmp_path / f"bus{ending}"
    recorded = rehearse(short(), path, rotate_bytes=60_000)
    names = [part.file for part in recorded.recorder.note.parts]
    assert names[:2] == [f"bus{ending}", f"bus.001{ending}"]
    assert len(names) > 2
    piece, reference = read(path), read(recordings().path)
    assert np.array_equal(piece.frames, reference.frames)
    assert np.max(np.abs(piece.time_s - reference.time_s)) < 2e-6
    for name in names[1:]:
        assert next(iter(Log(tmp_path / name).pieces())).frames["can_id"][0] == SYNC
    assert replay(Log(path), short()).firmware["navigation_sha256"] == recorded.sha256
    (tmp_path / names[1]).unlink()
    with pytest.raises(RecordError, match="is missing"):
        Log(path)


@pytest.fixture
def hosted():
    with RrinsBus("recorded", host="here", name="hardware") as host:
        yield host


def record(host, path, speed=None, **options):
    """Attach a recorder while the host serves the bus."""
    import threading

    note = Note(interface="rrins", channel="recorded", speed=speed)
    found = []
    address = Address("rrins", "recorded")
    thread = threading.Thread(
        target=lambda: found.append(Recorder(path, address, True, note, **options))
    )
    thread.start()
    host.wait_for("recorder", 10)
    thread.join()
    return found[0]


def attach(host, name):
    import threading

    found = []
    thread = threading.Thread(
        target=lambda: found.append(RrinsBus("recorded", host="never", name=name))
    )
    thread.start()
    host.wait_for(name, 10)
    thread.join()
    return found[0]


def serve(host, frames):
    """Relay what peers have sent, so many frames."""
    into = frame_array(64)
    while frames:
        found = host.recv_batch(into, 5.0)
        assert found is not None
        frames -= found.count


def test_a_recording_in_unix_time_keeps_its_intervals_and_says_so(hosted, tmp_path, read):
    before_s = time.time()
    recorder = record(hosted, tmp_path / "bus.blf", timestamps="unix")
    for epoch in (0, 400):
        hosted.send_batch(batch(SYNC), 1, epoch=epoch, time_ns=epoch * 5_000_000)
    hosted.shutdown()
    assert recorder.has_ended.wait(10)
    recorder.close()
    assert recorder.note.time == "unix"
    first_s, last_s = read(tmp_path / "bus.blf").time_s.tolist()
    assert before_s - 1e-6 <= first_s <= time.time()
    assert last_s - first_s == pytest.approx(2, abs=1e-6)


@pytest.mark.parametrize("speed", ["max", 1])
def test_in_lockstep_what_comes_before_the_answer_is_written_after_it(
    hosted, tmp_path, read, speed
):
    path = tmp_path / "bus.log"
    recorder = record(hosted, path, speed)
    firmware, stranger = attach(hosted, "firmware"), attach(hosted, "stranger")
    hosted.send_batch(batch(SYNC, STATUS), 2, epoch=0, time_ns=0, closes_epoch=True)
    stranger.send(can.Message(arbitration_id=STRANGER, is_extended_id=False, data=[1]))
    serve(hosted, 1)
    firmware.send_batch(batch(COMMAND), 1, epoch=0, time_ns=0, closes_epoch=True)
    serve(hosted, 1)
    hosted.send_batch(batch(SYNC), 1, epoch=1, time_ns=5_000_000, closes_epoch=True)
    for peer in (firmware, stranger, hosted):
        peer.shutdown()
    recorder.close()
    # The firmware in lockstep has it in its next epoch; in real time it most likely had it.
    answer = [COMMAND, STRANGER] if speed == "max" else [STRANGER, COMMAND]
    assert read(path).frames["can_id"].tolist() == [SYNC, STATUS, *answer, SYNC]


def test_time_never_goes_back(hosted, tmp_path, read):
    path = tmp_path / "bus.log"
    recorder = record(hosted, path)
    firmware = attach(hosted, "firmware")
    for epoch in (0, 1, 2):  # by its own count, before the hardware has begun
        firmware.send_batch(batch(COMMAND), 1, epoch=epoch, time_ns=epoch * 5_000_000)
    serve(hosted, 3)
    for epoch in (0, 1):
        hosted.send_batch(batch(SYNC), 1, epoch=epoch, time_ns=epoch * 5_000_000)
    firmware.send_batch(batch(COMMAND), 1, epoch=0, time_ns=0)  # late
    serve(hosted, 1)
    for peer in (firmware, hosted):
        peer.shutdown()
    recorder.close()
    assert read(path).time_s.tolist() == [0, 0, 0, 0, 0.005, 0.005]


def test_a_recording_ends_with_its_time(hosted, tmp_path, read):
    path = tmp_path / "bus.log"
    recorder = record(hosted, path, limit_s=0.1)
    for epoch in range(100):
        hosted.send_batch(batch(SYNC), 1, epoch=epoch, time_ns=epoch * 5_000_000)
    assert recorder.has_ended.wait(5)
    recorder.close()
    assert recorder.frames == 21
    assert read(path).time_s.tolist() == pytest.approx(np.arange(21) * 0.005)


@pytest.mark.parametrize("ending", [".log", ".asc", ".blf", ".mf4", ".db"])
def test_all_parts_of_a_recorder_that_was_killed_are_read(hosted, tmp_path, read, ending):
    folder, killed = tmp_path / "recorded", tmp_path / "killed"
    folder.mkdir()
    recorder = record(hosted, folder / f"bus{ending}", limit_s=49.99, rotate_bytes=30_000)
    for epoch in range(10_001):
        hosted.send_batch(batch(SYNC), 1, epoch=epoch, time_ns=epoch * 5_000_000)
    assert recorder.has_ended.wait(20)
    shutil.copytree(folder, killed)  # what is there without its end
    recorder.close()
    parts = recorder.note.parts
    assert len(parts) > 2
    log = Log(killed / f"bus{ending}")
    assert [part.file for part in log.note.parts] == [part.file for part in parts]
    time_s = np.concatenate([piece.time_s for piece in log.pieces()])
    assert time_s == pytest.approx(np.arange(len(time_s)) * 0.005, abs=2e-6)
    assert time_s[-1] >= parts[-1].first_s - 0.0051
    assert len(read(folder / f"bus{ending}")) == 9999


@pytest.mark.parametrize("ending", [".log", ".log.gz", ".blf", ".mf4", ".db"])
def test_a_file_has_one_recorder_at_a_time(tmp_path, read, ending):
    path = tmp_path / f"bus{ending}"
    for frames in (3, 5):  # the second time when the first is over
        recorder = Recorder(path, Address("virtual", "any"), False)
        with can.Bus(interface="virtual", channel="any") as bus:
            for k in range(frames):
                bus.send(can.Message(arbitration_id=k, is_extended_id=False))
            with pytest.raises(RecordError, match="another recorder is writing it"):
                Recorder(path, Address("virtual", "other"), False)
        recorder.close()
        assert recorder.failure is None
        assert len(read(path)) == frames
    names = {path.name, f"{path.name}.json"}
    assert {file.name for file in tmp_path.iterdir()} == names | {"previous"}
    assert {file.name for file in (tmp_path / "previous").iterdir()} == names
    assert len(read(tmp_path / "previous" / path.name)) == 3


def test_a_recording_moves_all_of_the_earlier_one_aside_and_nothing_else(tmp_path, read):
    path, other = tmp_path / "bus.log", tmp_path / "bus.002.log"
    other.write_text("(0.0) can0 010#00\n")
    for name in ("bus.log", "bus.001.log"):
        (tmp_path / name).write_text("(0.0) can0 010#00\n(1.0) can0 010#00\n")
    parts = (Part(file="bus.log"), Part(file="bus.001.log"))
    write_note(path, Note(interface="virtual", channel="any", parts=parts))
    recorder = Recorder(path, Address("virtual", "any"), False)
    assert recorder.kept_words == (
        f"the recording that was {path} is kept in {tmp_path / 'previous' / 'bus.log'}"
    )
    recorder.close()
    kept = {file.name for file in (tmp_path / "previous").iterdir()}
    assert kept == {"bus.log", "bus.001.log", "bus.log.json"}
    assert len(read(tmp_path / "previous" / "bus.log")) == 4
    assert {file.name for file in tmp_path.iterdir()} == {"bus.log", other.name, "previous"}


@pytest.mark.parametrize("note", ["", "{", '{"parts": 3}'])
def test_a_damaged_note_is_moved_aside_too(tmp_path, note):
    path = tmp_path / "bus.log"
    path.write_text("(0.0) can0 010#00\n")
    path.with_name("bus.log.json").write_text(note)
    Recorder(path, Address("virtual", "any"), False).close()
    assert {file.name for file in (tmp_path / "previous").iterdir()} == {"bus.log", "bus.log.json"}


def test_an_earlier_recording_that_cannot_be_moved_is_not_replaced(tmp_path):
    path = tmp_path / "bus.log"
    path.write_text("(0.0) can0 010#00\n")
    (tmp_path / "previous").write_text("")
    with pytest.raises(RecordError, match="previous: cannot be made: File exists"):
        Recorder(path, Address("virtual", "any"), False)
    assert path.read_text() == "(0.0) can0 010#00\n"


def test_a_recorder_that_cannot_begin_leaves_no_file(tmp_path, monkeypatch):
    def refuse(path):
        raise RecordError("no such format here")

    monkeypatch.setattr(recording, "open_writer", refuse)
    before = tmp_path / "before.log"
    before.write_text("(0.0) can0 010#00\n")
    for path in (before, tmp_path / "new.log"):
        with pytest.raises(RecordError, match="no such format"):
            Recorder(path, Address("virtual", "any"), False)
    assert list(tmp_path.iterdir()) == [before]
    assert before.read_text() == "(0.0) can0 010#00\n"


def test_a_note_that_cannot_be_written_is_told(tmp_path, monkeypatch, read):
    path = tmp_path / "bus.log"
    recorder = Recorder(path, Address("virtual", "any"), False)
    monkeypatch.setattr(Path, "replace", full_disk)
    with can.Bus(interface="virtual", channel="any") as bus:
        bus.send(can.Message(arbitration_id=7, is_extended_id=False))
    recorder.close()
    assert recorder.failure == f"its note: {path}.json: cannot be written: No space left on device"
    assert len(read(path)) == 1
    assert list(tmp_path.iterdir()) == [path]


def full_disk(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_where_nothing_can_be_recorded_the_file_before_stays(tmp_path):
    path = tmp_path / "bus.log"
    path.write_text("(0.0) can0 010#00\n")
    with pytest.raises(BusError, match="not running"):
        Recorder(path, Address("rrins", "nowhere"), False)
    assert path.read_text() == "(0.0) can0 010#00\n"


def test_any_python_can_bus_can_be_recorded(tmp_path, read):
    path = tmp_path / "bus.blf"
    recorder = Recorder(path, Address("virtual", "any"), False)
    with can.Bus(interface="virtual", channel="any") as bus:
        for k in range(50):
            bus.send(can.Message(arbitration_id=k, is_extended_id=k % 2 == 0, data=[k]))
        bus.send(can.Message(arbitration_id=7, is_remote_frame=True, dlc=3, is_extended_id=False))
    recorder.close()
    assert recorder.frames == 51
    assert recorder.note.time == "unix"
    frames = read(path).frames
    assert (frames["can_id"][:50] & 0x7FF).tolist() == list(range(50))
    assert int(frames["can_id"][50]) == 0x4000_0007


def test_strangers_are_told_and_damaged_frames_marked(recordings, tmp_path, read, write_candump):
    import pyarrow.parquet

    piece = read(recordings().path)
    frames, time_s = piece.frames[:2000].copy(), piece.time_s[:2000]
    sensors = np.flatnonzero(frames["can_id"] == load().frame_id("SENSOR_1"))
    frames["data"][sensors[3]] ^= np.uint64(1 << 20)
    frames["length"][sensors[4]] = 5
    frames["can_id"][sensors[5]] = STRANGER
    path = tmp_path / "spoilt.log"
    write_candump(path, frames, time_s)
    exported = export(Log(path), tmp_path / "tables")
    assert (exported.unknown, exported.wrong_length) == (1, 1)
    assert exported.rows["SENSOR_1"] == len(sensors) - 2
    table = pyarrow.parquet.read_table(tmp_path / "tables" / "SENSOR_1.parquet")
    holds = table["crc_holds"].to_pylist()
    assert holds.count(False) == 1
    assert not holds[3]
    assert table["sync_epoch"].to_pylist()[:5] == [0, 1, 2, 3, 6]
    assert table.schema.field("gyro_dtheta_rad").metadata[b"unit"] == b"rad"


def test_an_export_that_fails_leaves_what_was_there(copy, tmp_path):
    folder = tmp_path / "tables"
    folder.mkdir()
    (folder / "SYNC.parquet").write_bytes(b"before")
    path = copy(".db")
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(RecordError):
        export(Log(path), folder)
    assert [file.name for file in folder.iterdir()] == ["SYNC.parquet"]
    assert (folder / "SYNC.parquet").read_bytes() == b"before"
