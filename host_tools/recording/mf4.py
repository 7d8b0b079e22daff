"""MF4 (ASAM MDF 4, bus logging) through asammdf, many frames at a time.

python-can's own writer passes asammdf one frame at a time, 14,000 per second, and counts time from
the moment of writing. This one writes 300,000 per second and keeps simulated time exact.
python-can's reader reads it.
"""

from __future__ import annotations

import gc
import logging
import sys
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import can
import numpy as np
from can.util import channel2int

from rrins.compiled.record import Bytes
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.recording.mf4_blocks import check_blocks

if TYPE_CHECKING:
    from can.typechecking import Channel

_BATCH = 4096
_COMPRESSED = 2  # transposed and deflated
_RECORD_BYTES = 28
_SHORTEST = 168  # bytes of the two blocks at the start of every file


def asammdf_module() -> ModuleType:
    """Return the asammdf module.

    Raises
    ------
    RecordError
        If it is not installed.
    """
    try:
        import asammdf
    except ImportError as error:
        raise RecordError(".mf4 needs asammdf: pip install asammdf") from error
    return asammdf


def _channel_number(channel: Channel | None) -> int:
    """Return the number at the end of a channel name, 0 if there is no usable one."""
    number = channel2int(channel) or 0
    return number if 0 <= number < 256 else 0


def _dtype(group: str, with_data: bool) -> np.dtype[np.void]:
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = [
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

_Row = tuple[int, int, bool, int, int, Bytes, bool] | tuple[int, int, bool, int, int, bool]
"""A frame as a record of its group; remote frames have no payload."""


class Mf4Writer:
    """Writes classic frames to an MF4 file, which is created when the writer stops.

    Until then the frames are kept in a temporary file, 28 bytes each.

    Parameters
    ----------
    path : Path

    Raises
    ------
    RecordError
        If asammdf is not installed.
    OSError
        If the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        asammdf = asammdf_module()
        self._file = path.open("wb+")
        self._mdf = asammdf.MDF(version="4.10")
        self._begun_s: float | None = None
        self._last_s = 0.0
        self._rows: tuple[list[_Row], ...] = ([], [], [])
        self._times_s: tuple[list[float], ...] = ([], [], [])
        self._count = 0
        self._append_groups(asammdf)

    def _append_groups(self, asammdf: ModuleType) -> None:
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
        """Add a frame; a time before the previous frame's is replaced by that time."""
        if message.is_fd:
            return
        if self._begun_s is None:
            self._begin(message.timestamp)
        self._last_s = max(self._last_s, message.timestamp)
        group = 1 if message.is_error_frame else 2 if message.is_remote_frame else 0
        data = bytes(message.data)
        begin = (
            _channel_number(message.channel),
            message.arbitration_id,
            message.is_extended_id,
            message.dlc,
            len(data),
        )
        if group == 2:
            self._rows[group].append((*begin, not message.is_rx))
        else:
            payload = np.frombuffer(data.ljust(8, b"\0"), dtype=np.uint8)
            self._rows[group].append((*begin, payload, not message.is_rx))
        self._times_s[group].append(self._last_s)
        self._count += 1
        if len(self._rows[group]) == _BATCH:
            self._flush(group)

    def _begin(self, time_s: float) -> None:
        """Set the time origin: the first frame, or zero for simulated time."""
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
        """Return the bytes so far, before compression."""
        return self._count * _RECORD_BYTES

    def stop(self) -> None:
        """Write the file."""
        for group in range(len(_GROUPS)):
            self._flush(group)
        self._mdf.save(self._file, compression=_COMPRESSED)
        self._mdf.close()
        self._file.close()


_EARLIEST_UNIX_S = 631_152_000.0  # 1990
_LATEST_UNIX_S = 253_402_300_800.0  # the year 10,000


def is_simulated(time_s: float) -> bool:
    """Return whether a frame's time is simulated rather than seconds since 1970."""
    return not _EARLIEST_UNIX_S <= time_s < _LATEST_UNIX_S


def open_mf4_reader(path: Path) -> can.MF4Reader:
    """Return python-can's reader of an MF4 file, once its blocks are known to have an end.

    asammdf also logs its errors with tracebacks, and its half-initialised objects complain again on
    deletion. Both are silenced here: the exception says enough.

    Raises
    ------
    RecordError
        If asammdf is not installed, or the file is not MF4.
    """
    with path.open("rb") as file:
        begin = file.read(_SHORTEST)
    if len(begin) < _SHORTEST or not begin.startswith((b"MDF ", b"UnFinMF ")):
        raise RecordError(f"{path}: not an MF4 file")
    check_blocks(path)
    asammdf_module()
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        try:
            return can.MF4Reader(path)
        except Exception as error:  # noqa: BLE001 - a damaged file can raise anything
            text = " ".join(str(error).split()) or type(error).__name__
        gc.collect()
    finally:
        sys.unraisablehook = hook
    raise RecordError(f"{path}: cannot be read as MF4 ({text})")
