"""Sessions, security and timing of the UDS server (ISO 14229-1, ISO 14229-2, ISO 15765-2)."""

from __future__ import annotations

import hashlib
import hmac
from dataclasses import dataclass
from enum import IntEnum


class Session(IntEnum):
    """Diagnostic sessions: the sub-function of DiagnosticSessionControl (0x10)."""

    DEFAULT = 0x01
    PROGRAMMING = 0x02
    EXTENDED = 0x03


P2_MS = 50
"""P2server_max: deadline for the start of a response, ms."""

P2_STAR_MS = 5000
"""P2*server_max: deadline for the next response after a response pending (0x78), ms."""

S3_MS = 5000
"""S3server: a non-default session ends after this time without a request, ms."""

N_BS_MS = 1000
"""N_Bs: timeout of the flow control, ms."""

N_CR_MS = 1000
"""N_Cr: timeout of the next consecutive frame, ms."""

ST_MIN_MS = 1
"""STmin: separation time that the firmware requests, ms."""

BLOCK_SIZE = 64
"""Block size that the firmware requests: consecutive frames per flow control.

Half of the shortest queue for them (`transport.Transport.put`), so that a tool that goes on while
the firmware is held up loses nothing.
"""

PADDING = 0xCC
"""Padding byte that fills frames up to eight bytes (ISO 15765-2)."""

MESSAGE_CAPACITY = 4095
"""The longest request and response, bytes."""

FRAMES_PER_SECOND = 800
"""Most diagnostic frames that the firmware sends: a tenth of 1 Mbit/s."""

SEED_SUBFUNCTION, KEY_SUBFUNCTION = 0x01, 0x02
"""The sub-functions of SecurityAccess (0x27); there is one level."""

SEED_SIZE = 8
KEY_SIZE = 8
ATTEMPTS = 3
"""Wrong keys that trigger the delay."""

ATTEMPT_DELAY_MS = 10_000
"""Delay after too many wrong keys, during which no seed is given, ms."""

DEFAULT_SECRET = b"RRINS rehearsal"
"""Default secret, for a computer that was given no other."""


def key_of(seed: bytes, secret: bytes = DEFAULT_SECRET) -> bytes:
    """Return the key for a seed: the first 8 bytes of an HMAC-SHA-256 (RFC 2104) with the secret.

    The message is the sub-function of the seed request (0x01), followed by the seed.
    """
    message = bytes([SEED_SUBFUNCTION]) + seed
    return hmac.new(secret, message, hashlib.sha256).digest()[:KEY_SIZE]


@dataclass(frozen=True, repr=False)
class Access:
    """The conditions under which a request is allowed."""

    sessions: frozenset[Session]
    secured: bool = False  #: whether SecurityAccess is required

    def allows_in(self, session: Session) -> bool:
        """Return whether a session allows it."""
        return session in self.sessions

    def __repr__(self) -> str:
        names = ", ".join(session.name.lower() for session in sorted(self.sessions))
        names = "any session" if len(self.sessions) == len(Session) else names
        return names + (", unlocked" if self.secured else "")


ANYWHERE = Access(frozenset(Session))
"""In every session, locked or not."""

EXTENDED = Access(frozenset({Session.EXTENDED, Session.PROGRAMMING}))
"""In every session but the default one."""

UNLOCKED = Access(EXTENDED.sessions, secured=True)
"""Likewise, after SecurityAccess: what changes the computer."""

PROGRAMMING = Access(frozenset({Session.PROGRAMMING}), secured=True)
"""In the programming session, after SecurityAccess."""
