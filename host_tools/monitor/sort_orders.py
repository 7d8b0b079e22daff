"""The sort orders of the messages, by name; importing this is quick."""

from __future__ import annotations

from typing import Final

ORDERS: Final = ("id", "name", "rate", "errors")
"""Sort orders of the messages; ties are sorted by identifier."""
