"""Diagnosis as events: what a tool asks of the computer, and what it answers."""

from __future__ import annotations

from typing import Final

from rrins.host_tools.dashboard.events import Weight
from rrins.host_tools.monitor.dialogue import Spoken

_MOST_LETTERS: Final = 160
_BULK: Final = ("read_memory", "transfer_data")  # by the hundred, and bytes without a meaning
_READING: Final = ("read_", "report_", "result_of_")
_AGAIN_S: Final = 10.0
_MOST_KEPT: Final = 1000


class DiagnosisEvents:
    """Chooses the diagnostic messages that are events.

    A message that names its exchange alone only confirms what the other side has said. What a tool
    reads again and again, as the page itself does, is told once.
    """

    def __init__(self) -> None:
        self._last_s: dict[str, float] = {}

    def event_of(self, spoken: Spoken) -> tuple[str, Weight] | None:
        """Return text and weight of the event that a message is; None if it is none."""
        name, colon, _ = spoken.text.partition(":")
        if not spoken.is_warning and (not colon or name in _BULK):
            return None
        words = f"{spoken.sender}: {spoken.text}"
        is_reading = not spoken.is_warning and name.startswith(_READING)
        if self._is_again(f"{spoken.sender}: {name}" if is_reading else words, spoken.time_s):
            return None
        if len(words) > _MOST_LETTERS:
            words = f"{words[: _MOST_LETTERS - 1]}…"
        if spoken.is_warning:
            return words, "warning"
        return words, "note" if spoken.sender == "computer" else "order"

    def _is_again(self, key: str, time_s: float) -> bool:
        """Return whether this was said a moment ago."""
        before_s = self._last_s.get(key)
        if before_s is None and len(self._last_s) >= _MOST_KEPT:
            self._last_s.clear()
        self._last_s[key] = time_s
        return before_s is not None and 0 <= time_s - before_s < _AGAIN_S
