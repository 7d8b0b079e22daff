"""Diagnosis as events: what a tool asks of the computer, and what it answers."""

from __future__ import annotations

from typing import Final

from rrins.host_tools.dashboard.events import Weight

_MOST: Final = 160  # letters
_BULK: Final = ("read_memory", "transfer_data")  # by the hundred, and bytes without a meaning


def event_of(sender: str, text: str, is_warning: bool) -> tuple[str, Weight] | None:
    """Return text and weight of the event that a diagnostic message is; None if it tells nothing.

    A message that names its exchange alone only confirms what the other side has said.
    """
    name, colon, _ = text.partition(":")
    if not is_warning and (not colon or name in _BULK):
        return None
    words = f"{sender}: {text}"
    if len(words) > _MOST:
        words = f"{words[: _MOST - 1]}…"
    if is_warning:
        return words, "warning"
    return words, "note" if sender == "computer" else "order"
