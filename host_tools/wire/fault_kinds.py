"""Kinds of fault on the wire, one entry each: what it does, its parameter.

The scenario's tables, `rrins inject`, the dashboard's form, the value tables of the DBC and the
page `docs/faults.md` follow from the entries. `rrins.host_tools.wire.faults` has the effects.
"""

from __future__ import annotations

from rrins.host_tools.hardware.fault_kinds import NumberedKind, Parameter

_BIT = ("bit", "bit of the payload", None, 0, 63, 1.0, True)
_FRAMES = ("frames_per_epoch", "frames", 20, 1, 200, 1.0, True)


class FaultKind(NumberedKind):
    """The kinds, as `kind` of FAULT_COMMAND; append new ones."""

    DROP = "frames are lost"
    DELAY = "frames arrive late", "delay_s", "s", 0.01, 0.001, 60
    DUPLICATE = "frames arrive twice; each further `duplicate` adds one copy"
    REORDER = "an epoch's frames arrive in a different order"
    CORRUPT_WIRE = "a bit error that the controllers' CRC-15 detects"
    CORRUPT = "a bit error that only the end-to-end CRC detects", *_BIT
    WRONG_COUNTER = "a counter that is one too high, with a correct CRC"
    BABBLE = "a node keeps sending the identifier of the highest priority", *_FRAMES
    SILENCE = "frames are lost"
    BUS_OFF = "a node's controller is bus-off"
    CUT = "no node receives any frame"
    STALE = "the frame that was sent when the fault began is repeated"
    POWER_OFF = "the navigation computer has no power, and begins anew when it is back"


def to_number(parameter: Parameter | None, value: float | None, rate_hz: int) -> int:
    """Return a parameter as `WireFault` has it.

    A time becomes epochs, at least one; a whole number counts from its minimum, which is 1; 0 for
    None.
    """
    if parameter is None or value is None:
        return 0
    if parameter.is_whole:
        return int(value - parameter.minimum) + 1
    return max(1, round(value * rate_hz))


def from_number(parameter: Parameter | None, number: int, rate_hz: int) -> float | None:
    """Return what `to_number` was given."""
    if parameter is None or (parameter.is_whole and not number):
        return None
    return number - 1 + int(parameter.minimum) if parameter.is_whole else number / rate_hz
