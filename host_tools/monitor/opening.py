"""Progress in the terminal until the screen is there: loading takes seconds."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

_ENTER: Final = "\x1b[?1049h\x1b[2J\x1b[H"  # the terminal's second screen, cleared
_LEAVE: Final = "\x1b[?1049l"


@contextmanager
def opening_screen(text: str) -> Iterator[Callable[[], None]]:
    """Show a text on the terminal's second screen; the first one comes back at the end.

    Yields what hands the second screen over to somebody who leaves it by himself.
    """
    is_ours = True

    def hand_over() -> None:
        nonlocal is_ours
        is_ours = False

    _write(f"{_ENTER}{text}\r\n")
    try:
        yield hand_over
    finally:
        if is_ours:
            _write(_LEAVE)


def _write(text: str) -> None:
    sys.stdout.write(text)
    sys.stdout.flush()
