"""Logs by other tools, and damaged ones: what is read, and the line that says what is not."""

from __future__ import annotations

import gzip
import zlib

import can
import numpy as np
import pytest

from rrins.host_tools.logs.reader import Log
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.recording.formats import open_writer

VECTOR = """\
date Fri Nov 21 04:05:06.000 pm 2025
{base}
internal events logged
// version 9.0.0
Begin Triggerblock Fri Nov 21 04:05:06.000 pm 2025
   0.000000 Start of measurement
   0.000000 CAN 1 Status:chip status error active
   0.100000 1  43              Rx   d 8 01 02 03 04 05 06 07 08  Length = 224000 BitCount = 116
   0.100000 1  Statistic: D 99 R 0 XD 0 XR 0 E 0 O 0 B 2.64%
   0.100000 2  ErrorFrame
   0.100000 1  1ABCDEF0x       Tx   d 2 AA BB
   0.100000 1  44              TxRq r 8
   0.100000 CANFD   1 Rx 300 1 0 9 12 01 02 03 04 05 06 07 08 09 0a 0b 0c 0 0 1000 0 0 0 0 0
   0.100000 1  J1939TP FEE3p 6 0 0 - Rx d 23 A0 0F A6 60 3B D1 40 1F DE 80
   0.100000 log trigger event
   0.100000 1  45              Rx   d 0
End TriggerBlock
"""
ABSOLUTE = VECTOR.format(base="base hex  timestamps absolute")
RELATIVE = VECTOR.format(base="base hex  timestamps relative")


@pytest.fixture
def read_log(tmp_path):
    """Return a function that reads the content of a log; returns the log, its frames and times."""

    def reader(name, content, channel=None):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        log = Log(path, channel)
        pieces = list(log.pieces())
        frames = np.concatenate([piece.frames for piece in pieces])
        return log, frames, np.concatenate([piece.time_s for piece in pieces])

    return reader


def candump_lines(count):
    """Return lines that gzip cannot shrink to nothing."""
    words = np.random.default_rng(1).integers(0, 2**63, count).tolist()
    return [f"({k / 1000:.6f}) can0 043#{word:016X}\n" for k, word in enumerate(words)]


def whole_lines(content):
    """Return how many whole lines a piece of a gzip file unpacks to."""
    return zlib.decompressobj(31).decompress(content).count(b"\n")


@pytest.mark.parametrize("share", [0.05, 0.5, 0.9999])
def test_a_packed_log_that_is_cut_is_read_up_to_there(read_log, share):
    content = gzip.compress("".join(candump_lines(20_000)).encode())
    content = content[: int(share * len(content))]
    log, frames, _ = read_log("cut.log.gz", content)
    assert whole_lines(content) <= len(frames) <= whole_lines(content) + 1
    assert f"is cut off after {len(frames)} frames, its compressed data end too early" in log.damage


@pytest.mark.parametrize("ending", [".asc", ".csv", ".trc"])
def test_every_packed_text_is_read_up_to_where_it_is_cut(recordings, read_log, ending):
    content = gzip.compress(recordings(ending).path.read_bytes())
    log, frames, _ = read_log(f"cut{ending}.gz", content[: len(content) // 2])
    assert 0.4 * recordings(ending).recorder.frames < len(frames)
    assert "its compressed data end too early" in log.damage


def test_a_packed_log_that_is_damaged_is_read_up_to_there(read_log):
    lines = candump_lines(20_000)
    content = bytearray(gzip.compress("".join(lines).encode()))
    content[-8] ^= 1  # of the checksum
    log, frames, _ = read_log("checksum.log.gz", bytes(content))
    assert len(frames) == 20_000
    assert "its compressed data are damaged: " in log.damage
    content[len(content) // 2] ^= 0xFF
    log, frames, time_s = read_log("middle.log.gz", bytes(content))
    assert len(frames) > 9_500
    assert np.array_equal(time_s[:9_500], np.arange(9_500) / 1000)
    assert "its compressed data are damaged: " in log.damage


def test_a_packed_log_of_several_members_is_whole(read_log):
    lines = candump_lines(3000)
    members = [gzip.compress("".join(lines[k::3]).encode()) for k in range(3)]
    log, frames, _ = read_log("joined.log.gz", b"".join(members) + bytes(512))
    assert len(frames) == 3000
    assert log.damage is None


def test_a_packed_blf_is_no_damaged_one(recordings, read_log):
    recorded = recordings(".blf")
    content = gzip.compress(recorded.path.read_bytes())
    log, frames, _ = read_log("bus.blf.gz", content)
    assert (len(frames), log.damage) == (recorded.recorder.frames, None)
    log, _, _ = read_log("cut.blf.gz", content[: len(content) // 2])
    assert "its compressed data end too early" in log.damage


def test_candump_in_nanoseconds_with_length_codes_and_a_mark_of_its_encoding(read_log):
    log, frames, time_s = read_log(
        "bus.log",
        "\ufeff(1436509052.249713123) can0 010#6700000000000000\n"
        "(1436509052.249713) can0 011#6700000000000001_E\n"
        "(0000000001.500000001) can0 012#R8_E\n"
        "(1436509052.000000) can0 013#11223344556677_E\n"
        "(1436509052.000000) can0 014#1122334455667788_8\n",
    )
    assert time_s.tolist() == [1436509052.249713123, 1436509052.249713, 1.500000001]
    assert frames["can_id"].tolist() == [0x010, 0x011, 0x4000_0012]
    assert frames["length"].tolist() == [8, 8, 8]
    assert frames["data"][:2].tolist() == [0x67, 0x67 | 1 << 56]
    assert log.damage.endswith("bus.log: 2 lines are not frames; skipped")


@pytest.mark.parametrize("ending", [".asc", ".blf", ".csv", ".db", ".mf4"])
def test_frames_of_can_fd_are_passed_over(tmp_path, ending):
    path = tmp_path / f"fd{ending}"
    with can.Logger(path) as logger:
        for k in range(6):
            data = bytes(range(12 if k % 2 else 8))
            logger.on_message_received(
                can.Message(
                    timestamp=k, arbitration_id=0x43, is_extended_id=False, channel=0,
                    is_fd=len(data) > 8, data=data,
                )
            )  # fmt: skip
    log = Log(path)
    (frames,) = (piece.frames for piece in log.pieces() if len(piece))
    assert frames["length"].tolist() == [8, 8, 8]
    assert (log.passed_over, log.damage) == (3, None)


@pytest.mark.parametrize("content", [ABSOLUTE, RELATIVE, "\ufeff" + ABSOLUTE])
def test_an_asc_log_by_vector_is_whole(read_log, content):
    log, frames, _ = read_log("bus.asc", content)
    assert frames["can_id"].tolist() == [0x43, 0xA000_0000, 0x9ABC_DEF0, 0x4000_0044, 0x45]
    assert (log.passed_over, log.damage) == (1, None)


def test_relative_times_are_added_up_over_all_events(read_log):
    assert read_log("absolute.asc", ABSOLUTE)[2].tolist() == [0.1] * 5
    assert read_log("relative.asc", RELATIVE)[2].tolist() == [0.1, 0.3, 0.4, 0.5, 0.9]


def test_an_asc_log_in_decimal_is_read(read_log):
    content = "base dec timestamps absolute\n0.5 1 67 Rx d 3 1 20 255\n0.6 1 FF Rx d 1 1\n"
    log, frames, _ = read_log("bus.asc", content)
    assert frames["can_id"].tolist() == [67]
    assert frames["data"].tolist() == [0xFF1401]
    assert log.damage.endswith("1 line is not a frame; skipped")


@pytest.mark.parametrize(
    ("whole", "damaged"),
    [
        ("01 02 03 04", "01 0Z 03 04"),
        ("01 02 03 04 05 06 07 08", "01 02 03 04 05"),
        (" 43  ", " 4#  "),
        ("0.100000 1  43 ", "0#100000 1  43 "),
        ("Rx   d 8", "R"),
        ("43              Rx   d 8", "AB"),
        ("   0.100000 1  43              Rx ", "43              Rx "),
        ("   0.100000 1  43 ", "\0\0\0\0\0 1  43 "),
        ("1  43    ", "1  SENSOR_3    "),
    ],
)
def test_a_damaged_line_of_an_asc_log_costs_that_line_only(read_log, whole, damaged):
    assert whole in ABSOLUTE
    log, frames, _ = read_log("bus.asc", ABSOLUTE.replace(whole, damaged, 1))
    assert frames["can_id"].tolist() == [0xA000_0000, 0x9ABC_DEF0, 0x4000_0044, 0x45]
    assert log.damage.endswith("bus.asc: 1 line is not a frame; skipped")


@pytest.mark.parametrize("ending", [".asc", ".trc"])
def test_a_text_log_that_is_cut_anywhere_says_so_and_invents_nothing(tmp_path, read_log, ending):
    path = tmp_path / f"whole{ending}"
    writer = open_writer(path)
    for k in range(4):
        writer.on_message_received(
            can.Message(timestamp=k / 8, arbitration_id=k, is_extended_id=False, data=[k + 16] * 8)
        )
    writer.stop()
    content = path.read_bytes()
    whole = read_log(f"again{ending}", content)[1]
    begin = content.index(b"11 11 11 11 11 11 11 11")
    silent = []
    for size in range(begin, len(content) - 2):
        log, frames, _ = read_log(f"cut{ending}", content[:size])
        assert np.array_equal(frames, whole[: len(frames)])
        if log.damage is None:
            silent.append(content[:size].rpartition(b"\n")[2].strip())
    if ending == ".asc":
        assert not silent
    else:  # it has no end: what ends behind a whole frame is whole
        assert all(line == b"" or len(line.split()) == 16 for line in silent)


PEAK = {
    "1.0": "{n:>6}) {ms} 0300 {length} {data}\n",
    "1.1": "{n:>6}) {ms}.0 Rx 0300 {length} {data}\n",
    "1.3": "{n:>6}) {ms}.0 1 Rx 0300 - {length} {data}\n",
}


@pytest.mark.parametrize("version", PEAK)
def test_every_version_of_peak_is_read(read_log, version):
    head = "" if version == "1.0" else f";$FILEVERSION={version}\n;$STARTTIME=43008.9\n;\n"
    line = PEAK[version]
    content = head + "".join(
        line.format(n=k, ms=100 * k, length=2, data=f"0{k} AA") for k in range(1, 5)
    )
    log, frames, _ = read_log("peak.trc", content)
    assert frames["data"].tolist() == [0xAA00 + k for k in range(1, 5)]
    assert log.damage is None
    log, frames, _ = read_log("spoilt.trc", content.replace("02 AA", "0# AA"))
    assert frames["data"].tolist() == [0xAA01, 0xAA03, 0xAA04]
    assert log.damage.endswith("1 line is not a frame; skipped")
    log, frames, _ = read_log("cut.trc", content[:-2])
    assert frames["data"].tolist() == [0xAA01, 0xAA02, 0xAA03]
    assert log.damage.endswith("1 line is not a frame; skipped")


@pytest.mark.parametrize(
    ("version", "line", "begun_s"),
    [
        ("1.0", "1) 250 0043 2 01 02", 0.0),
        ("1.1", "1) 250.0 Rx 0043 2 01 02", 43008.5),
        ("1.3", "1) 250.0 1 Rx 0043 - 2 01 02", 43008.5),
    ],
)
def test_earlier_versions_of_peak_are_read(read_log, version, line, begun_s):
    head = f";$FILEVERSION={version}\n;$STARTTIME=43008.5\n;\n" if begun_s else ""
    log, frames, time_s = read_log("peak.trc", f"{head}{line}\n{line.replace('250', '500')}\n")
    assert frames["can_id"].tolist() == [0x43] * 2
    assert frames["data"].tolist() == [0x0201] * 2
    origin_s = (begun_s - 25_569) * 86_400 if begun_s else 0.0  # days from 1899-12-30 to 1970
    assert time_s.tolist() == [origin_s + 0.25, origin_s + 0.5]
    assert log.damage is None


def test_status_lines_of_peak_are_no_damage(read_log):
    content = (
        ";$FILEVERSION=2.1\n;$STARTTIME=43008.920986006946\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n;\n"
        "  1  1059.900 DT 1 0300 Rx - 7 00 00 00 00 04 00 00\n"
        "  2  1283.231 ST 1    - Rx - 4 00 00 00 08\n"
        "  3  1298.945 ER 1    - Rx - 5 04 00 02 00 00\n"
        "  4  1323.201 EV 1 User-defined event\n"
        "\n"
        "  5  1334.416 D# 1 0300 Rx - 7 00 00 00 00 04 00 00\n"
    )
    log, frames, _ = read_log("peak.trc", content)
    assert len(frames) == 1
    assert log.damage.endswith("1 line is not a frame; skipped")


@pytest.mark.parametrize("ending", [".asc", ".csv", ".log", ".trc"])
@pytest.mark.parametrize("wrong", [b"Z", b"\xff", b" ", b",", b"\0"])
def test_a_wrong_byte_in_a_text_costs_its_line_at_most(recordings, read_log, ending, wrong):
    lines = recordings(ending).path.read_bytes().splitlines(keepends=True)[:105]
    if ending == ".asc":
        lines.append(b"End TriggerBlock\n")
    log, whole, _ = read_log(f"whole{ending}", b"".join(lines))
    assert log.damage is None
    for at in range(len(lines[100])):
        spoilt = lines[100][:at] + wrong + lines[100][at + 1 :]
        content = b"".join([*lines[:100], spoilt, *lines[101:]])
        log, frames, _ = read_log(f"spoilt{ending}", content)
        left_out = len(whole) - len(frames)
        assert left_out <= 1 or (left_out == 2 and at >= len(lines[100].rstrip()))  # joined
        assert (log.damage is not None) == (left_out > 0)


CHANNELS = {
    "bus.log": "(1.0) can0 043#11\n(1.1) vcan10 043#22\n(1.2) can0 043#33\n",
    "bus.asc": "0.0 1 43 Rx d 1 11\n0.1 2 43 Rx d 1 22\n0.2 1 43 Rx d 1 33\n",
}


@pytest.mark.parametrize(("name", "channels"), [("bus.log", "can0 vcan10"), ("bus.asc", "1 2")])
def test_channels_of_a_log_are_counted_and_one_can_be_chosen(read_log, name, channels):
    first, second = channels.split()
    log, frames, _ = read_log(name, CHANNELS[name])
    assert log.channels == {first: 2, second: 1}
    assert frames["data"].tolist() == [0x11, 0x22, 0x33]
    _, frames, time_s = read_log(name, CHANNELS[name], second)
    assert frames["data"].tolist() == [0x22]
    assert len(time_s) == 1
    with pytest.raises(RecordError, match=f"has no frames on channel 7 .{first}, {second}."):
        read_log(name, CHANNELS[name], "7")


@pytest.mark.parametrize("ending", [".blf", ".mf4", ".trc"])
def test_channels_keep_their_numbers(tmp_path, ending):
    path = tmp_path / f"bus{ending}"
    with can.Logger(path) as logger:
        for k in range(3):
            logger.on_message_received(
                can.Message(timestamp=k, arbitration_id=5, channel=k % 2, data=[k])
            )
    log = Log(path)
    sum(len(piece) for piece in log.pieces())
    assert sorted(log.channels.values()) == [1, 2]
