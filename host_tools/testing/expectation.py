"""Expectations of a test about the frames of a message."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rrins.host_tools.testing.recording import Contract, FrameRing, SignalValue, Values

Condition = Callable[[Any], object]
"""Holds if it returns a true value."""

Where = Mapping[str, SignalValue | Condition] | Callable[[Values], object] | None
"""Frames to match: wanted values by signal name, or a callable that accepts all values."""

_OWN = ("time_s", "crc_holds")


class Expectation:
    """Frames of a message that satisfy a condition.

    Parameters
    ----------
    contract : Contract
    message : str
        Name in the DBC.
    where : dict or callable, optional

    Raises
    ------
    BenchError
        If the DBC has no such message, signal or named value.
    """

    def __init__(self, contract: Contract, message: str, where: Where = None) -> None:
        self._contract = contract
        self._message = message
        self._can_id = contract.can_id(message)
        self._condition: Callable[[Values], object] | None = None
        self._wanted: dict[str, SignalValue | Condition] = {}
        if isinstance(where, Mapping):
            signals = [name for name in where if name not in _OWN]
            contract.check_signals(message, signals)
            for name, value in where.items():
                if callable(value) or name not in signals:
                    self._wanted[name] = value
                else:
                    self._wanted[name] = contract.named(message, name, value)
        else:
            self._condition = where

    def __str__(self) -> str:
        if self._condition is not None:
            name = getattr(self._condition, "__name__", repr(self._condition))
            return f"{self._message} that satisfies {name}"
        listed = (
            f"{name} = {getattr(value, '__name__', value)}" for name, value in self._wanted.items()
        )
        return self._message + (f" with {', '.join(listed)}" if self._wanted else "")

    def hits(self, ring: FrameRing, first: int) -> list[Values]:
        """Return the values of the matching frames in a ring, from frame number `first` on."""
        if not ring.has(self._can_id, first):
            return []
        frames, times_ns = ring.find(self._can_id, first)
        every = (
            self._contract.decode(self._message, frame, int(time_ns))
            for frame, time_ns in zip(frames, times_ns, strict=True)
        )
        return [values for values in every if self._holds(values)]

    def _holds(self, values: Values) -> bool:
        if not values["crc_holds"] and "crc_holds" not in self._wanted:
            return False
        if self._condition is not None:
            return bool(self._condition(values))
        return all(
            bool(wanted(values[name])) if callable(wanted) else bool(values[name] == wanted)
            for name, wanted in self._wanted.items()
        )


def in_words(values: Values) -> str:
    """Return the values of a frame as one line."""
    shown = (
        f"{name} {value:.10g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in values.items()
        if name not in ("crc", "alive_counter", *_OWN)
    )
    broken = "" if values["crc_holds"] else ", wrong CRC"
    return f"at {values['time_s']:.3f} s " + ", ".join(shown) + broken
