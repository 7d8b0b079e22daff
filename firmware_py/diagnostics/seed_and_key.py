"""Seed and key, by which UDS and XCP let a tool change the computer."""

from __future__ import annotations

import hmac
from collections.abc import Callable
from enum import Enum, auto

from rrins.firmware_py.diagnostics import access

_NS_PER_MS = 1_000_000


class Verdict(Enum):
    """Judgement of a key."""

    RIGHT = auto()
    WRONG = auto()
    CLOSED = auto()  #: wrong, and no seed is given for some time
    NO_SEED = auto()  #: no seed was asked for


class SeedAndKey:
    """Issues seeds and checks keys.

    Parameters
    ----------
    secret : bytes
    random_bytes : callable
        Returns the given number of unpredictable bytes.
    """

    def __init__(self, secret: bytes, random_bytes: Callable[[int], bytes]) -> None:
        self._secret = secret
        self._random_bytes = random_bytes
        self._seed = b""
        self._attempts = 0
        self._closed_until_ns = -1

    def forget(self) -> None:
        """Forget the seed; the count of wrong keys remains."""
        self._seed = b""

    def seed(self, now_ns: int) -> bytes | None:
        """Return a new seed; None while the delay after wrong keys lasts."""
        if now_ns < self._closed_until_ns:
            return None
        seed = self._random_bytes(access.SEED_SIZE)
        self._seed = seed if any(seed) else bytes([1]) * access.SEED_SIZE  # zero: unlocked
        return self._seed

    def check(self, key: bytes, now_ns: int) -> Verdict:
        """Judge a key; each seed is good for one."""
        if not self._seed:
            return Verdict.NO_SEED
        right = access.key_of(self._seed, self._secret)
        self._seed = b""
        if hmac.compare_digest(key, right):
            self._attempts = 0
            return Verdict.RIGHT
        self._attempts += 1
        if self._attempts < access.ATTEMPTS:
            return Verdict.WRONG
        self._attempts = access.ATTEMPTS - 1  # one more after the delay
        self._closed_until_ns = now_ns + access.ATTEMPT_DELAY_MS * _NS_PER_MS
        return Verdict.CLOSED
