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
"""P2server_max: by when a response has begun, ms."""

P2_STAR_MS = 5000
"""P2*server_max: by when the next response has begun after a response pending (0x78), ms."""

S3_MS = 5000
"""S3server: a session but the default one ends when no request has come for so long, ms."""

N_BS_MS = 1000
"""How long the transport waits for flow control, ms."""

N_CR_MS = 1000
"""How long the transport waits for the next consecutive frame, ms."""

ST_MIN_MS = 1
"""Separation time that the firmware asks for, ms."""

BLOCK_SIZE = 0
"""Consecutive frames to one flow control that the firmware asks for; 0: all."""

PADDING = 0xCC
"""What fills up frames to eight bytes (ISO 15765-2)."""

MESSAGE_CAPACITY = 4095
"""The longest request and response, bytes."""

FRAMES_PER_SECOND = 800
"""Diagnostic frames that the firmware sends at most: a tenth of 1 Mbit/s."""

SEED_SUBFUNCTION, KEY_SUBFUNCTION = 0x01, 0x02
"""The sub-functions of SecurityAccess (0x27); there is one level."""

SEED_SIZE = 8
KEY_SIZE = 8
ATTEMPTS = 3
"""Wrong keys before there is a delay."""

ATTEMPT_DELAY_MS = 10_000
"""How long no seed is given after that, ms."""

DEFAULT_SECRET = b"RRINS rehearsal"
"""The secret of a computer that has not been given one of its own."""


def key_of(seed: bytes, secret: bytes = DEFAULT_SECRET) -> bytes:
    """Return the key to a seed: the first 8 bytes of HMAC-SHA-256 (RFC 2104) of it by the secret.

    The message is the sub-function of the request for the seed (0x01), then the seed.
    """
    message = bytes([SEED_SUBFUNCTION]) + seed
    return hmac.new(secret, message, hashlib.sha256).digest()[:KEY_SIZE]


@dataclass(frozen=True, repr=False)
class Access:
    """What it takes to be allowed something.

    Attributes
    ----------
    sessions : frozenset of Session
    secured : bool
        Whether SecurityAccess has to be passed before.
    """

    sessions: frozenset[Session]
    secured: bool = False

    def allows_in(self, session: Session) -> bool:
        """Return whether it can be had in a session."""
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
