"""Lines parsed many at a time: to the bit what python-can's readers give them one by one."""

from __future__ import annotations

import random

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.dbc.frame import frame_array
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.recording import frame_lines
from rrins.host_tools.recording.asc import AscLines
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.recording.text_lines import CsvLines, TrcLines

LINES = {".asc": AscLines, ".csv": CsvLines, ".trc": TrcLines}
PEAK_1 = {
    "1.0": "{n:>6}) {ms:.0f} {id:>8} {length} {data}\n",
    "1.1": "{n:>6}) {ms:.1f} Rx {id:>8} {length} {data}\n",
    "1.3": "{n:>6}) {ms:.1f} {bus} Rx {id:>8} - {length} {data}\n",
}
VECTOR = (
    "   {s:.6f} {bus}  {id:<15} Tx   d {length} {data}  Length = 224000 BitCount = 116 ID = 67\n"
)


def frames_of(rng, count, begun_s, has_remote):
    for k in range(count):
        is_extended = rng.random() < 0.2
        yield can.Message(
            timestamp=begun_s + k * 0.0051 + rng.random() * 1e-4,
            arbitration_id=rng.randrange(0x2000_0000 if is_extended else 0x800),
            is_extended_id=is_extended,
            is_remote_frame=has_remote and rng.random() < 0.02,
            channel=rng.randrange(2),
            data=rng.randbytes(rng.randrange(9)),
        )


def content_of(path, kind, rng, count=60):
    """Return a log of a kind: of python-can's writer, or by hand."""
    begun_s = rng.choice((0.0, 0.0, 1.7e9, 123.456))
    frames = list(frames_of(rng, count, begun_s, kind in (".asc", ".csv")))
    if kind in LINES:
        with can.Logger(path.with_suffix(kind)) as logger:
            for frame in frames:
                frame.data = b"" if frame.is_remote_frame else frame.data
                logger.on_message_received(frame)
        return path.with_suffix(kind).read_bytes()
    head = f";$FILEVERSION={kind}\n;$STARTTIME=43008.9204986006946\n;\n"
    if kind == "Vector":
        head = "date Fri Nov 21 04:05:06.000 pm 2025\nbase hex  timestamps absolute\n"
    line = PEAK_1.get(kind, VECTOR)
    return (head if kind != "1.0" else "").encode() + "".join(
        line.format(
            n=k,
            s=frame.timestamp,
            ms=1000 * frame.timestamp,
            bus=frame.channel + 1,
            id=f"{frame.arbitration_id:0{8 if frame.is_extended_id else 4}X}"
            if kind != "Vector"
            else f"{frame.arbitration_id:X}{'x' * frame.is_extended_id}",
            length=len(frame.data),
            data=frame.data.hex(" ").upper(),
        )
        for k, frame in enumerate(frames)
    ).encode()


def damaged(rng, content):
    """Return a content with a few bytes changed, moved or lost."""
    out = bytearray(content)
    for _ in range(rng.choice((0, 1, 1, 3, 10))):
        at = rng.randrange(len(out))
        way = rng.randrange(5)
        if way == 0:
            out[at] ^= 1 << rng.randrange(8)
        elif way == 1:
            out[at] = rng.choice(b"\r\n\t 0aFxRT.,;\0\xff-=")
        elif way == 2:
            del out[at : at + rng.choice((1, 2, 30))]
        elif way == 3:
            out[at:at] = out[rng.randrange(len(out)) :][: rng.choice((1, 5, 90))]
        else:
            del out[rng.randrange(len(out) // 2, len(out)) :]
    return bytes(out)


def read(path):
    """Return all that a log says."""
    log = Log(path)
    try:
        pieces = list(log.pieces(50))
    except RecordError as error:
        return str(error)
    frames = np.concatenate([piece.frames for piece in pieces])
    times_s = np.concatenate([piece.time_s for piece in pieces])
    return frames.tobytes(), times_s.tobytes(), log.channels, log.damage, log.passed_over


@pytest.mark.parametrize("kind", [*LINES, *PEAK_1, "Vector"])
def test_what_is_parsed_is_what_the_readers_read(kind, tmp_path, monkeypatch):
    rng = random.Random(kind)
    ending = kind if kind in LINES else ".asc" if kind == "Vector" else ".trc"
    path = tmp_path / f"bus{ending}"
    parse, parsed = frame_lines.parse, 0

    def counting(form, text, at, end, roles, frames, times, channels, row):
        nonlocal parsed
        found = parse(form, text, at, end, roles, frames, times, channels, row)
        parsed += found[1] - row
        return found

    monkeypatch.setattr(frame_lines, "parse", counting)
    total = 0
    for _ in range(60):
        content = damaged(rng, content_of(tmp_path / "whole", kind, rng))
        total += content.count(b"\n")
        path.write_bytes(content)
        fast = read(path)
        with monkeypatch.context() as slow:
            slow.setattr(LINES[ending], "layout", lambda _: None)
            assert read(path) == fast, content
    assert parsed > 0.7 * total


@given(st.integers(0, 10**18 - 1), st.integers(0, 18))
def test_a_time_is_the_nearest_float(whole, decimals):
    digits = f"{whole:0{decimals + 1}d}"
    text = digits[: len(digits) - decimals] + ("." if decimals else "") + digits[-decimals or 99 :]
    line = f"{text},0x1,0,0,0,0,\n".encode()
    times = np.zeros(1)
    _, row = frame_lines.parse(
        frame_lines.CSV,
        np.frombuffer(line + bytes(64), dtype=np.uint8),
        0,
        len(line),
        np.zeros(0, dtype=np.int64),
        frame_array(1),
        times,
        np.zeros(1, dtype=np.int64),
        0,
    )
    assert row == 0 or times[0] == float(text)
    assert row == 1 or len(digits) > 15
