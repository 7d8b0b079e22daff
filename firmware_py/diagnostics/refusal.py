"""What services give the server back besides a response."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from firmware_py.diagnostics.responses import Code


class RefusalError(Exception):
    """A service refuses: a negative response.

    Attributes
    ----------
    code : Code
    """

    def __init__(self, code: Code) -> None:
        super().__init__(code.name)
        self.code = code


@dataclass(frozen=True)
class Later:
    """A response that takes its time.

    Attributes
    ----------
    poll : callable
        Returns the positive response's data once there is one, None before; raises `RefusalError`
        when there will be none.
    """

    poll: Callable[[], bytes | None]


Answer = bytes | Later
"""What a service returns: the data of its positive response, or a promise of it."""


def require(holds: bool, code: Code) -> None:
    """Raise `RefusalError` unless something holds."""
    if not holds:
        raise RefusalError(code)
