"""BLF logs: what is read as arrays is what python-can reads one by one, damaged or not."""

from __future__ import annotations

import random
import struct
import zlib

import can
import numpy as np
import pytest

from rrins.dbc.frame import EFF_FLAG, frame_array
from rrins.host_tools.bus.message import messages_of
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.recording import blf
from rrins.host_tools.recording.blf import Run
from rrins.host_tools.recording.blf_writer import BlfWriter
from rrins.host_tools.recording.errors import RecordError

_HEADER = 144  # bytes of a file's
_KINDS = ("classic", "newer", "coarse", "remote", "fd", "fd64", "error", "other", "padded")


def vector_object(kind, number, rng):
    """Return an object as Vector's tools write it; python-can writes only some of these."""
    what = {"fd": 100, "fd64": 101, "error": 73, "other": 65, "newer": 86}.get(kind, 1)
    channel = rng.choice((1, 1, 1, 2))
    identifier = rng.choice((0x10, 0x61, 0x1234567 | 1 << 31))
    data = rng.randbytes(8)
    flags, dlc = 0x80 if kind == "remote" else rng.randrange(2), rng.choice((8, 8, 3, 0, 12))
    body = {
        "fd": struct.pack("<HBBLLBBB5x64s", channel, 0, 8, identifier, 0, 0, 1, 8, data),
        "fd64": struct.pack("<BBBBLLLLLLLHBBL", 1, 9, 12, 0, 5, *(0,) * 10) + bytes(12),
        "error": struct.pack("<HHLBBBxLLH2x8s", channel, 0, 0, 0, 0, 8, 0, identifier, 0, data),
        "other": bytes(20),
    }.get(kind, struct.pack("<HBBL8s", channel, flags, dlc, identifier, data))
    body += bytes({"newer": 8, "padded": 2}.get(kind, 0))
    size = 32 + len(body)
    unit, time = (1, number * 500) if kind == "coarse" else (2, number * 5_000_123)
    head = struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, size, what, unit, 0, 0, time)
    return head + body + bytes(size % 4)


def content(rng, runs):
    """Return objects in runs of one kind each."""
    objects = []
    for kind, count in runs:
        objects += [vector_object(kind, len(objects) + k, rng) for k in range(count)]
    return b"".join(objects)


def write(path, data, container=4000):
    """Write a log of objects, in containers that cut them anywhere."""
    with can.BLFWriter(path) as writer:
        writer.on_message_received(can.Message(timestamp=1.7e9))
    parts = [path.read_bytes()[:_HEADER]]
    for at in range(0, len(data), container):
        packed = zlib.compress(data[at : at + container], 1)
        size = 32 + len(packed)
        parts.append(struct.pack("<4sHHLL", b"LOBJ", 16, 1, size, 10))
        parts.append(struct.pack("<H6xL4x", 2, len(data[at : at + container])))
        parts += [packed, bytes(size % 4)]
    path.write_bytes(b"".join(parts))
    return path


def read(path):
    """Return all that a log gives: frames, times, channels, what was passed over, damage."""
    log = Log(path)
    try:
        pieces = list(log.pieces())
    except RecordError as error:
        return str(error)
    return (
        b"".join(piece.frames.tobytes() for piece in pieces),
        b"".join(piece.time_s.tobytes() for piece in pieces),
        log.channels,
        log.passed_over,
        log.damage,
    )


def read_one_by_one(path, monkeypatch):
    """Read with python-can alone."""
    with monkeypatch.context() as patched:
        patched.setattr(blf, "_run", lambda data, at: (at, frame_array(0)))
        patched.setattr(blf, "_next_run", lambda data, at: len(data))
        return read(path)


def runs_of(rng):
    return [(rng.choice(_KINDS), rng.choice((1, 2, 31, 32, 33, 200))) for _ in range(6)]


@pytest.mark.parametrize("seed", range(12))
def test_frames_are_the_same_one_by_one(tmp_path, monkeypatch, seed):
    rng = random.Random(seed)
    path = write(tmp_path / "bus.blf", content(rng, runs_of(rng)), rng.choice((700, 4000, 1 << 17)))
    found = read(path)
    assert found == read_one_by_one(path, monkeypatch)
    assert len(found[0]) > 0


def test_what_is_damaged_is_read_as_far_and_told_as_one_by_one(tmp_path, monkeypatch):
    rng = random.Random(1)
    told = set()
    for _ in range(150):
        data = bytearray(content(rng, runs_of(rng)))
        for _ in range(rng.randrange(1, 4)):
            at = rng.randrange(len(data))
            data[at] = rng.choice((0, 1, 2, 10, 47, 255, data[at] ^ 1 << rng.randrange(8)))
        path = write(tmp_path / "bus.blf", bytes(data))
        found = read(path)
        assert found == read_one_by_one(path, monkeypatch)
        told.add(found if isinstance(found, str) else str(found[-1]))
    assert len(told) > 5


def test_usual_frames_come_as_arrays(tmp_path):
    """Frames of python-can's writer and of Vector's do, in runs however short beside others."""
    rng = random.Random(2)
    runs = [("classic", 100), ("fd", 3), ("newer", 100), ("coarse", 5), ("error", 1)]
    path = write(tmp_path / "bus.blf", content(rng, runs * 5), 1 << 17)
    with path.open("rb") as stream:
        found = list(blf.BlfReader(stream))
    in_arrays = sum(len(one.frames) for one in found if isinstance(one, Run))
    assert in_arrays == 5 * 200
    assert len(found) - sum(isinstance(one, Run) for one in found) == 5 * 9


@pytest.mark.parametrize("begin_s", [0.0, 1.7e9])
def test_thousands_of_frames_at_once_are_the_same_bytes(tmp_path, begin_s):
    rng = np.random.default_rng(1)
    count = 9000  # more than a container
    frames = frame_array(count)
    frames["can_id"] = rng.integers(0, 0x800, count)
    frames["length"] = rng.integers(0, 9, count)
    frames["data"] = rng.integers(0, 2**63, count)  # also behind the end of a short payload
    time_s = begin_s + np.sort(rng.uniform(0, 100, count))
    single, many = (BlfWriter(tmp_path / name) for name in ("single.blf", "many.blf"))
    assert many.takes(frames)
    for k in range(count):
        for message in messages_of(frames[k : k + 1], time_s[k], "rrins0"):
            single.on_message_received(message)
    for part in (slice(0, 1), slice(1, 5000), slice(5000, count)):
        many.on_frames(frames[part], time_s[part], "rrins0")
    single.stop()
    many.stop()
    assert (tmp_path / "single.blf").read_bytes() == (tmp_path / "many.blf").read_bytes()
    frames["can_id"][3] |= EFF_FLAG
    assert not many.takes(frames)
