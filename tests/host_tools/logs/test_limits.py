"""Damaged sizes and links, and content without an end: little memory, and one line at once."""

from __future__ import annotations

import gzip
import resource
import struct
import subprocess
import sys
import zlib

import can
import pytest
from click.testing import CliRunner

from rrins.host_tools.cli.main import rrins
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.recording.formats import open_writer
from rrins.host_tools.recording.mf4_blocks import check_blocks

_HEADER_BYTES, _CONTAINER_BYTES = 144, 32


@pytest.fixture
def blf(tmp_path):
    """Return a function that writes a BLF log of one container, changed; and returns its path."""
    path = tmp_path / "bus.blf"
    with can.BLFWriter(path) as writer:
        for k in range(20):
            writer.on_message_received(can.Message(timestamp=k, arbitration_id=k, data=[k] * 8))
    whole = path.read_bytes()
    begin = _HEADER_BYTES + _CONTAINER_BYTES
    objects = zlib.decompress(whole[begin:])

    def write(change, size=None):
        packed = zlib.compress(change(bytearray(objects)), 9)
        header = bytearray(whole[_HEADER_BYTES:begin])
        struct.pack_into(
            "<L", header, 8, begin - _HEADER_BYTES + len(packed) if size is None else size
        )
        content = whole[:_HEADER_BYTES] + header + packed + bytes(len(packed) % 4)
        path.write_bytes(content)
        return path

    return write


def damage_of(path):
    """Return the frames that can be read and what is said of the others."""
    log = Log(path)
    try:
        frames = sum(len(piece) for piece in log.pieces())
    except RecordError as error:
        return 0, str(error)
    return frames, log.damage


def sized(size):
    """Return a change that gives the sixth object a size."""

    def change(objects):
        at = -1
        for _ in range(6):
            at = objects.index(b"LOBJ", at + 1)
        struct.pack_into("<L", objects, at + 8, size)
        return bytes(objects)

    return change


def test_sizes_in_a_blf_log_are_checked(blf):
    assert damage_of(blf(bytes)) == (20, None)
    assert "an object of 4294967280 bytes" in damage_of(blf(bytes, size=0xFFFF_FFF0))[1]
    assert "an object of 0 bytes" in damage_of(blf(bytes, size=0))[1]
    for size in (0, 0xFFFF_FFF0):
        frames, said = damage_of(blf(sized(size)))
        assert (frames, f"after 5 frames (an object of {size} bytes)" in said) == (5, True)
    assert "a container of more than 64 MiB" in damage_of(blf(lambda _: bytes(65 << 20)))[1]


def test_blocks_of_an_mf4_log_in_a_circle(tmp_path):
    pytest.importorskip("asammdf")
    path = tmp_path / "bus.mf4"
    writer = open_writer(path)
    writer.on_message_received(can.Message(arbitration_id=5, data=[1]))
    writer.stop()
    whole = path.read_bytes()
    assert damage_of(path) == (1, None)
    for name in (b"##DG", b"##CG", b"##CN", b"##FH"):
        at = whole.index(name)
        content = bytearray(whole)
        struct.pack_into("<Q", content, at + 24, at)
        path.write_bytes(content)
        assert "blocks in a circle" in damage_of(path)[1]


def test_an_mf4_log_of_very_many_channels(tmp_path):
    path = tmp_path / "bus.mf4"
    blocks = [
        struct.pack("<4s4xQQ", b"##HD", 104, 6) + struct.pack("<6Q", 168, 0, 0, 0, 0, 0) + bytes(32)
    ]
    blocks.append(struct.pack("<4s4xQQQQ", b"##DG", 64, 4, 0, 208))
    blocks[-1] = blocks[-1].ljust(40, b"\0")
    blocks.append(struct.pack("<4s4xQQQQ", b"##CG", 104, 6, 0, 248).ljust(40, b"\0"))
    first = 248
    blocks += [
        struct.pack("<4s4xQQQQ", b"##CN", 160, 8, first + 88 * (k + 1), 0).ljust(88, b"\0")
        for k in range(10_002)
    ]
    path.write_bytes(b"MDF ".ljust(64) + b"".join(blocks))
    with pytest.raises(RecordError, match="more than 10000 channels"):
        check_blocks(path)


def test_very_many_channels_of_a_text_log(tmp_path):
    path = tmp_path / "bus.asc"
    lines = (f"   0.5 {k} 43  Rx   d 1 00\n" for k in range(20_000))
    path.write_text("base hex  timestamps absolute\n" + "".join(lines))
    log = Log(path)
    assert sum(len(piece) for piece in log.pieces()) == 20_000
    assert len(log.channels) == 255
    said = CliRunner().invoke(rrins, ["plot", "--list", str(path)]).stderr
    assert said.endswith("9 (1 frames) and 245 more; select one with --log-channel\n")


@pytest.mark.soak
@pytest.mark.parametrize("ending", [".log", ".trc"])
def test_zeros_without_end_take_little_memory(tmp_path, ending):
    path = tmp_path / f"zeros{ending}.gz"
    member = gzip.compress(bytes(1 << 24), 9)
    path.write_bytes(member * 64)  # 1 GiB
    most = 3 << 30  # of addresses: libraries take more than half
    ended = subprocess.run(
        [sys.executable, "-m", "rrins", "plot", "--list", str(path)],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (most, most)),
        capture_output=True,
        text=True,
        check=False,
        timeout=200,
    )
    assert (ended.returncode, ended.stderr.count("\n")) == (6, 1), ended.stderr
    assert ended.stderr.startswith(f"rrins: {path}: ")
