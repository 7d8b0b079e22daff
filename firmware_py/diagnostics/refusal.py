"""Outcomes of a service other than a response: refusals and promises."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rrins.firmware_py.diagnostics.responses import Code


class RefusalError(Exception):
    """A service refuses a request: a negative response."""

    def __init__(self, code: Code) -> None:
        super().__init__(code.name)
        self.code = code


@dataclass(frozen=True)
class Later:
    """A response that is not ready yet."""

    #: returns the positive response's data once it is ready, None before; raises `RefusalError` if
    #: the service refuses
    poll: Callable[[], bytes | None]


Answer = bytes | Later
"""Result of a service: the data of its positive response, or a promise of it."""


def require(holds: bool, code: Code) -> None:
    """Raise `RefusalError` unless the condition holds."""
    if not holds:
        raise RefusalError(code)
