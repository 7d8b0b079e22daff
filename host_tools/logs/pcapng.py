"""Writes a log as pcapng, the format of Wireshark, with the diagnosis in words as comments."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import IO, Final

import numpy as np

from rrins.compiled.record import Integers
from rrins.dbc.frame import FrameArray
from rrins.firmware_py.version import VERSION
from rrins.host_tools.logs.diagnosis import Diagnosis
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.recording.errors import RecordError

_SECTION, _INTERFACE, _PACKET = 0x0A0D0D0A, 0x00000001, 0x00000006  # block types
_MAGIC: Final = 0x1A2B3C4D
_SOCKETCAN: Final = 227  # link type: the identifier is big-endian, with the flags of SocketCAN
_FRAME_SIZE: Final = 16
_COMMENT, _NAME, _APPLICATION, _RESOLUTION = 1, 2, 4, 9  # options
_NANOSECONDS: Final = 9  # a power of 1/10
_MOST_COMMENT: Final = 0xFFFF

_BLOCK: Final = np.dtype(
    [
        ("type", "<u4"), ("size", "<u4"), ("interface", "<u4"),
        ("time_high", "<u4"), ("time_low", "<u4"), ("captured", "<u4"), ("original", "<u4"),
        ("can_id", ">u4"), ("length", "u1"), ("reserved", "u1", 3), ("data", "<u8"),
        ("size_again", "<u4"),
    ]
)  # fmt: skip
"""An enhanced packet block without options."""


def _option(code: int, value: bytes) -> bytes:
    return struct.pack("<HH", code, len(value)) + value + bytes(-len(value) % 4)


def _block(kind: int, body: bytes, options: bytes) -> bytes:
    whole = body + (options + bytes(4) if options else b"")
    size = struct.pack("<I", len(whole) + 12)
    return struct.pack("<I", kind) + size + whole + size


def _head(name: str) -> bytes:
    section = struct.pack("<IHHq", _MAGIC, 1, 0, -1)
    interface = struct.pack("<HHI", _SOCKETCAN, 0, 0)
    resolution = _option(_RESOLUTION, bytes([_NANOSECONDS]))
    return _block(_SECTION, section, _option(_APPLICATION, f"rrins {VERSION}".encode())) + _block(
        _INTERFACE, interface, _option(_NAME, name.encode()) + resolution
    )


def _blocks(frames: FrameArray, times_ns: Integers) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    blocks = np.zeros(len(frames), dtype=_BLOCK)
    blocks["type"] = _PACKET
    blocks["size"] = blocks["size_again"] = _BLOCK.itemsize
    blocks["time_high"], blocks["time_low"] = times_ns >> 32, times_ns & 0xFFFF_FFFF
    blocks["captured"] = blocks["original"] = _FRAME_SIZE
    for name in ("can_id", "length", "data"):
        blocks[name] = frames[name]
    return blocks


def export_pcapng(
    log: Log, path: Path, on_progress: Callable[[int], None] = lambda position: None
) -> int:
    """Write all frames of a log; return how many messages of the diagnosis have a comment.

    Raises
    ------
    RecordError
        If the log cannot be read or the file cannot be written.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with part.open("wb") as file:
            told = _write_log(log, file, on_progress)
        part.replace(path)
    except OSError as error:
        raise RecordError(f"{path}: cannot be written: {error.strerror}") from error
    finally:
        part.unlink(missing_ok=True)
    return told


def _write_log(log: Log, file: IO[bytes], on_progress: Callable[[int], None]) -> int:
    diagnosis = Diagnosis()
    told = 0
    file.write(_head(log.path.name))
    for piece in log.pieces():
        times_ns = np.maximum(np.rint(piece.time_s * 1e9), 0).astype(np.int64)
        texts = diagnosis.texts(piece.frames)
        _write(file, _blocks(piece.frames, times_ns), texts)
        told += len(texts)
        on_progress(log.position)
    return told


def _write(
    file: IO[bytes], blocks: np.ndarray[tuple[int], np.dtype[np.void]], texts: dict[int, str]
) -> None:
    """Write blocks; those with a text get it as a comment."""
    done = 0
    for k, text in sorted(texts.items()):
        file.write(blocks[done:k].tobytes())
        body = blocks[k].tobytes()[8:-4]
        comment = text.encode()[:_MOST_COMMENT].decode(errors="ignore").encode()
        file.write(_block(_PACKET, body, _option(_COMMENT, comment)))
        done = k + 1
    file.write(blocks[done:].tobytes())
