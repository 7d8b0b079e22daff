"""MF4 (ASAM MDF 4, bus logging) by asammdf, many frames at a time.

python-can's own writer hands asammdf one frame at a time, at 14,000 a second, and counts time from
the moment of writing; this one writes 300,000 a second and keeps simulated time exact.
python-can's `MF4Reader` reads it.
"""

from __future__ import annotations

import gc
import logging
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import can
import numpy as np
from can.util import channel2int
from numpy.typing import NDArray

from dbc.frame import EFF_FLAG, FrameArray, frame_array
from host_tools.logs.errors import RecordError

_BATCH = 4096
_COMPRESSED = 2  # transposed and deflated
_RECORD_BYTES = 28
_PAYLOAD = 8  # bytes of a whole classic frame
_SHORTEST = 168  # bytes of the two blocks that every file begins with


def _asammdf() -> Any:
    """Return the module asammdf.

    Raises
    ------
    RecordError
        When it is not installed.
    """
    try:
        import asammdf
    except ImportError as error:
        raise RecordError(".mf4 needs asammdf: pip install 'rrins[mf4]'") from error
    return asammdf


def _channel_number(channel: Any) -> int:
    """Return the number at the end of a channel's name, 0 where there is none that fits."""
    number = channel2int(channel) or 0
    return number if 0 <= number < 256 else 0


def _dtype(group: str, with_data: bool) -> np.dtype[Any]:
    fields: list[Any] = [
        ("BusChannel", "<u1"),
        ("ID", "<u4"),
        ("IDE", "<u1"),
        ("DLC", "<u1"),
        ("DataLength", "<u1"),
    ]
    if with_data:
        fields.append(("DataBytes", "<u1", (8,)))
    fields.append(("Dir", "<u1"))
    return np.dtype([(f"{group}.{name}", *rest) for name, *rest in fields])


_GROUPS = (("CAN_DataFrame", True), ("CAN_ErrorFrame", True), ("CAN_RemoteFrame", False))
_DTYPES = tuple(_dtype(*group) for group in _GROUPS)


class Mf4Writer:
    """Writes classic frames to an MF4 file, which is there when the writer has stopped.

    Until then the frames are in a temporary file of 28 bytes each.

    Parameters
    ----------
    path : Path

    Raises
    ------
    RecordError
        When asammdf is not installed.
    OSError
        When the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        asammdf = _asammdf()
        self._file = path.open("wb+")
        self._mdf = asammdf.MDF(version="4.10")
        self._begun_s: float | None = None
        self._last_s = 0.0
        self._rows: tuple[list[Any], ...] = ([], [], [])
        self._times_s: tuple[list[float], ...] = ([], [], [])
        self._count = 0
        self._append_groups(asammdf)

    def _append_groups(self, asammdf: Any) -> None:
        from asammdf.blocks.v4_blocks import SourceInformation
        from asammdf.blocks.v4_constants import BUS_TYPE_CAN, SOURCE_BUS

        source = SourceInformation(source_type=SOURCE_BUS, bus_type=BUS_TYPE_CAN)
        for (name, _), dtype in zip(_GROUPS, _DTYPES, strict=True):
            nothing = np.zeros(0, dtype=dtype)
            times_s = np.zeros(0)
            self._mdf.append(
                asammdf.Signal(name=name, samples=nothing, timestamps=times_s, source=source)
            )

    def on_message_received(self, message: can.Message) -> None:
        """Take a frame; a time before that of the last one becomes that one."""
        if message.is_fd:
            return
        if self._begun_s is None:
            self._begin(message.timestamp)
        self._last_s = max(self._last_s, message.timestamp)
        group = 1 if message.is_error_frame else 2 if message.is_remote_frame else 0
        data = bytes(message.data)
        row: tuple[Any, ...] = (
            _channel_number(message.channel),
            message.arbitration_id,
            message.is_extended_id,
            message.dlc,
            len(data),
        )
        if group != 2:
            row += (np.frombuffer(data.ljust(8, b"\0"), dtype=np.uint8),)
        self._rows[group].append((*row, not message.is_rx))
        self._times_s[group].append(self._last_s)
        self._count += 1
        if len(self._rows[group]) == _BATCH:
            self._flush(group)

    def _begin(self, time_s: float) -> None:
        """Set where time counts from: the first frame, or zero of simulated time."""
        self._begun_s = 0.0 if is_simulated(time_s) else float(int(time_s))
        self._mdf.header.start_time = datetime.fromtimestamp(self._begun_s, tz=UTC)

    def _flush(self, group: int) -> None:
        if not self._rows[group]:
            return
        samples = np.array(self._rows[group], dtype=_DTYPES[group])
        times_s = np.array(self._times_s[group]) - (self._begun_s or 0.0)
        self._mdf.extend(group, [(times_s, None), (samples, None)])
        self._rows[group].clear()
        self._times_s[group].clear()

    def file_size(self) -> int:
        """Return the bytes so far, before they are compressed."""
        return self._count * _RECORD_BYTES

    def stop(self) -> None:
        """Write the file."""
        for group in range(len(_GROUPS)):
            self._flush(group)
        self._mdf.save(self._file, compression=_COMPRESSED)
        self._mdf.close()
        self._file.close()


_EARLIEST_UNIX_S = 631_152_000.0  # 1990


def is_simulated(time_s: float) -> bool:
    """Return whether a frame's time is simulated, and not seconds since 1970."""
    return time_s < _EARLIEST_UNIX_S


Block = tuple[FrameArray, NDArray[np.float64], NDArray[np.uint8], int]
"""Classic frames, their times and channels, and how many CAN FD frames are passed over."""


def read_data_frames(path: Path, capacity: int) -> Iterator[Block]:
    """Yield the data frames of an MF4 file, `capacity` at a time.

    For a file with one group of data frames and no other frames, as `Mf4Writer` writes it; yields
    nothing for another, which is python-can's to read.

    Raises
    ------
    RecordError
        When asammdf is not installed, or the file is no MF4.
    """
    with path.open("rb") as file:
        begin = file.read(_SHORTEST)
    if len(begin) < _SHORTEST or not begin.startswith((b"MDF ", b"UnFinMF ")):
        raise RecordError(f"{path}: no MF4")
    with _opened(path) as mdf:
        group = _only_group(mdf)
        if group is None:
            return
        begun_s = mdf.header.start_time.timestamp()
        total = mdf.groups[group].channel_group.cycles_nr
        for offset in range(0, total, capacity):
            found = mdf.get(
                "CAN_DataFrame", group, record_offset=offset, record_count=capacity, raw=False
            )
            is_classic = _is_classic(found.samples)
            samples = found.samples[is_classic]
            time_s = found.timestamps[is_classic] + begun_s
            channels = samples["CAN_DataFrame.BusChannel"].astype(np.uint8)
            passed_over = int(np.count_nonzero(~is_classic))
            yield _frames_of(samples), time_s, channels, passed_over


def _opened(path: Path) -> Any:
    """Open an MF4 file to read.

    What asammdf stumbles over it also logs, with tracebacks, and what it has left half made when it
    fails complains again when it goes; here the exception alone tells.
    """
    asammdf = _asammdf()
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        try:
            return asammdf.MDF(path)
        except Exception as error:  # noqa: BLE001 - of any kind, on a damaged file
            text = " ".join(str(error).split()) or type(error).__name__
        gc.collect()
    finally:
        sys.unraisablehook = hook
    raise RecordError(f"{path}: cannot be read as MF4 ({text})")


def _only_group(mdf: Any) -> int | None:
    """Return the one group with frames, if its records are of the kind that is read here."""
    used = [
        (index, {channel.name for channel in group.channels})
        for index, group in enumerate(mdf.groups)
        if group.channel_group.cycles_nr
    ]
    if len(used) != 1 or "CAN_DataFrame.DataBytes" not in used[0][1]:
        return None
    index = used[0][0]
    first = mdf.get("CAN_DataFrame", index, record_offset=0, record_count=1, raw=False).samples
    names = first.dtype.names or ()
    data = first.dtype["CAN_DataFrame.DataBytes"] if "CAN_DataFrame.DataBytes" in names else None
    is_plain = data is not None and data.base == np.uint8 and data.shape in ((8,), (64,))
    has_all = {"CAN_DataFrame.IDE", "CAN_DataFrame.BusChannel"} <= set(names)
    return index if is_plain and has_all else None


def _is_classic(samples: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which frames are none of CAN FD, by their flag where there is one."""
    is_short = np.asarray(samples["CAN_DataFrame.DataLength"] <= _PAYLOAD)
    if "CAN_DataFrame.EDL" not in (samples.dtype.names or ()):
        return is_short
    return is_short & (samples["CAN_DataFrame.EDL"] == 0)


def _frames_of(samples: NDArray[Any]) -> FrameArray:
    frames = frame_array(len(samples))
    extended = samples["CAN_DataFrame.IDE"].astype(bool)
    identifiers = samples["CAN_DataFrame.ID"].astype(np.uint32) & np.uint32(0x1FFF_FFFF)
    frames["can_id"] = identifiers | np.where(extended, np.uint32(EFF_FLAG), np.uint32(0))
    frames["length"] = samples["CAN_DataFrame.DataLength"]
    payload = np.ascontiguousarray(samples["CAN_DataFrame.DataBytes"][:, :8])
    frames["data"] = payload.view("<u8")[:, 0]
    return frames
