"""The frames of an epoch, compared with those of our own firmware signal by signal."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Final

import numpy as np

from rrins.dbc.codec import load, to_physical, unpack
from rrins.dbc.e2e import crc_holds
from rrins.dbc.frame import Frame, FrameArray
from rrins.host_tools.rounding import rounded

Answer = bytes
"""The frames of an epoch, ``struct can_frame`` after ``struct can_frame``."""

SENT: Final = (
    "AXIS_INNER_COMMAND",
    "AXIS_OUTER_COMMAND",
    "FIRMWARE_STATUS",
    "FIRMWARE_FAULTS",
    "NAV_LATITUDE",
    "NAV_LONGITUDE",
    "NAV_VELOCITY",
    "NAV_HEIGHT",
    "NAV_ATTITUDE",
    "HEARTBEAT_FIRMWARE",
)
"""Messages that every navigation computer sends; others depend on what it has."""

_LAST: Final = ("AXIS_INNER_COMMAND", "AXIS_OUTER_COMMAND")
_POSITION: Final = ("latitude_deg", "longitude_deg")
_STEPS: Final = {
    "uptime": 1,
    "clock_error_ppm": 1,
    "velocity_east": 2,
    "velocity_north": 2,
    "velocity_up": 2,
    "height": 2,
    "roll_deg": 1,
    "pitch_deg": 1,
    "heading_deg": 1,
}
"""Permitted differences in steps of the signal; none for those that are not here."""

_TURNS: Final = {"longitude_deg": 360.0, "roll_deg": 360.0, "heading_deg": 360.0}
_COUNTER, _CRC = "alive_counter", "crc"


@cache
def _names() -> dict[int, str]:
    """Messages of the firmware by identifier."""
    messages = load().database.messages
    return {one.frame_id: one.name for one in messages if "FIRMWARE" in one.senders}


def difference(answer: Answer, wanted: Answer, position_steps: int) -> str:
    """Return how an epoch's frames differ from the wanted ones, in words; empty if not at all."""
    theirs, ours = Frame.from_bytes(answer), Frame.from_bytes(wanted)
    for frame in theirs:
        if int(frame.can_id) not in _names():
            return (
                f"it sends a frame {int(frame.can_id):#05x}, which is not its own by the contract"
            )
    sent, due = _compared(theirs), _compared(ours)
    if sorted(sent) != sorted(due):
        missing = [name for name in due if name not in sent]
        more = [name for name in sent if name not in due or sent.count(name) > due.count(name)]
        words = [f"no {', '.join(missing)}"] if missing else []
        words += [f"{', '.join(dict.fromkeys(more))} not due"] if more else []
        return "; ".join(words)
    if tuple(sent[-2:]) != _LAST:
        return f"the last frames of the epoch are {', '.join(sent[-2:])}, not {', '.join(_LAST)}"
    wanted_frames = {_names()[int(one.can_id)]: one for one in ours}
    for frame in theirs:
        name = _names()[int(frame.can_id)]
        if name in SENT:
            words_of_frame = _frame_difference(name, frame, wanted_frames[name], position_steps)
            if words_of_frame:
                return words_of_frame
    return ""


def _compared(frames: FrameArray) -> list[str]:
    names = (_names().get(can_id, "") for can_id in frames["can_id"].tolist())
    return [name for name in names if name in SENT]


def _frame_difference(name: str, frame: Frame, wanted: Frame, position_steps: int) -> str:
    codec = load()
    row = codec.messages[codec.message_index(name)]
    if int(frame.length) != int(row.length):
        return f"{name} has {int(frame.length)} bytes"
    if not crc_holds(frame, row):
        return f"the CRC of {name} is wrong"
    return next(_signal_differences(name, frame, wanted, position_steps), "")


def _signal_differences(
    name: str, frame: Frame, wanted: Frame, position_steps: int
) -> Iterator[str]:
    codec, used = load(), 0
    for signal in codec.database.get_message_by_name(name).signals:
        layout = codec.signals[codec.signal_index(name, signal.name)]
        used |= (1 << int(layout.length)) - 1 << int(layout.shift)
        if signal.name == _CRC:
            continue
        value, due = unpack(frame["data"], layout), unpack(wanted["data"], layout)
        steps = position_steps if signal.name in _POSITION else _STEPS.get(signal.name, 0)
        apart = abs(value - due)
        turn = _TURNS.get(signal.name)
        if signal.name == "target_angle_deg":
            apart = min(apart, (1 << 32) - apart)
        elif turn is not None:
            apart = min(apart, abs(round(turn / float(layout.scale)) - apart))
        if apart > steps:
            if signal.name == _COUNTER:
                yield f"the counter of {name} is {value}, not {due}"
                continue
            choices = codec.choices(name, signal.name)
            is_value, is_due = (
                choices.get(raw, f"{to_physical(raw, layout):.12g}") for raw in (value, due)
            )
            within = f" (to {steps} steps of {rounded(float(layout.scale))})" if steps else ""
            yield f"{name}.{signal.name} is {is_value}, not {is_due}{within}"
    if int(frame["data"] & ~np.uint64(used)):
        yield f"bits of {name} that belong to no signal are not 0"
