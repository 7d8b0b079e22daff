"""Which CAN frames ISO-TP accepts, and which it ignores (ISO 15765-2:2016, 9.6 and 9.8.3).

The library reads CAN FD frames as well, and aborts the current reception at any frame that
it cannot read. On a classic bus such frames must be ignored; so it never gets them.
"""

from __future__ import annotations

_SINGLE, _FIRST, _CONSECUTIVE, _FLOW_CONTROL = range(4)  # high nibble of the first byte
_CAN_DL = 8
_SINGLE_MOST = 7
_SHORT_MOST = 4095  # of a first frame's twelve bits
_FLOW_STATES = 3
_LONGEST_SEPARATION = 0x7F  # ms; used for reserved values (9.6.5.4)


def single(data: bytes) -> bytes | None:
    """Return the payload of a single frame; None if it is not a valid single frame."""
    if not data or data[0] >> 4 != _SINGLE or not 1 <= data[0] <= min(_SINGLE_MOST, len(data) - 1):
        return None
    return data[1 : 1 + data[0]]


def accepted(data: bytes, missing: int | None, awaits_flow_control: bool) -> bytes | None:
    """Return a frame in the form to process; None if it must be ignored.

    Parameters
    ----------
    missing : int or None
        Bytes still missing from the message being received; None when none is being received.
    awaits_flow_control : bool
        Whether the message being sent waits for flow control.
    """
    kind = data[0] >> 4 if data else None
    if kind == _SINGLE:
        return None if single(data) is None else data
    if kind == _FIRST:
        return data if _is_first(data) else None
    if kind == _CONSECUTIVE:
        fits = missing is not None and len(data) > min(_CAN_DL - 1, missing)
        return data if fits else None
    if kind == _FLOW_CONTROL and awaits_flow_control and len(data) >= 3:
        return data[:2] + bytes([_separation(data[2])]) + data[3:]
    return None


def _is_first(data: bytes) -> bool:
    """Return whether a first frame is complete, and announces more than a single frame holds."""
    if len(data) != _CAN_DL:
        return False
    length = (data[0] & 0x0F) << 8 | data[1]
    if length == 0:
        return int.from_bytes(data[2:6], "big") > _SHORT_MOST
    return length >= _CAN_DL


def _separation(st_min: int) -> int:
    """Return a separation time; the longest if the value is reserved."""
    return st_min if st_min <= 0x7F or 0xF1 <= st_min <= 0xF9 else _LONGEST_SEPARATION


def has_unknown_state(flow_control: bytes) -> bool:
    """Return whether a flow control's status is reserved, which aborts the message being sent."""
    return flow_control[0] >> 4 == _FLOW_CONTROL and flow_control[0] & 0x0F >= _FLOW_STATES
