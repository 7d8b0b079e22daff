"""The UDS server: sessions, order of checks, and handling of responses (ISO 14229-1, 8.7).

It knows neither frames nor a clock: it receives requests and the time, and returns responses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from rrins.firmware_py.diagnostics import access
from rrins.firmware_py.diagnostics.access import Access, Session
from rrins.firmware_py.diagnostics.refusal import Answer, Later, RefusalError, require
from rrins.firmware_py.diagnostics.responses import (
    NEGATIVE,
    POSITIVE_OFFSET,
    SUPPRESS_BIT,
    Code,
    Service,
)
from rrins.firmware_py.diagnostics.table import SERVICE_BY_NUMBER

_NS_PER_MS = 1_000_000
PENDING_SHARE = 0.8
"""Of P2 and P2*, after which a response pending is sent."""

SILENT_WHEN_FUNCTIONAL = frozenset(
    {
        Code.SERVICE_NOT_SUPPORTED,
        Code.SUB_FUNCTION_NOT_SUPPORTED,
        Code.REQUEST_OUT_OF_RANGE,
        Code.SUB_FUNCTION_NOT_SUPPORTED_IN_ACTIVE_SESSION,
        Code.SERVICE_NOT_SUPPORTED_IN_ACTIVE_SESSION,
    }
)
"""Refusals of functional requests that are not sent: such a request may be for others."""


class Reset(IntEnum):
    """Sub-functions of ECUReset (0x11)."""

    HARD = 0x01
    SOFT = 0x03


Handler = Callable[["Server", bytes], Answer]
"""A service: gets the request after its identifier, without the suppress bit; returns the data of
the response after its identifier, or raises `RefusalError`."""


@dataclass
class _Pending:
    """A response in preparation."""

    service: int
    later: Later
    wanted: bool
    is_functional: bool
    due_ns: int


class Part:
    """State of a group of services; notified when the session changes."""

    def leave_session(self, session: Session) -> None:
        """Release what was held for a session; `session` is the next one."""

    def work(self) -> None:
        """Do one epoch's work, while `is_busy`."""

    @property
    def is_busy(self) -> bool:
        """Whether `work` must be called."""
        return False


class Server:
    """A UDS server.

    Attributes
    ----------
    reset_wanted : Reset or None
        Requested by ECUReset; due once the response has been sent.
    now_ns : int
        Time of the current epoch.
    parts : list of Part
        State of the groups of services.
    handlers : dict
        The services of the table, by number.
    """

    def __init__(self) -> None:
        self.session = Session.DEFAULT
        self.is_unlocked = False
        self.reset_wanted: Reset | None = None
        self.now_ns = 0
        self.parts: list[Part] = []
        self.handlers: dict[int, Handler] = {}
        self._pending: _Pending | None = None
        self._last_ns = 0  # when the last request arrived or was answered

    @property
    def is_idle(self) -> bool:
        """Whether nothing happens until the next request."""
        return (
            self._pending is None
            and self.session == Session.DEFAULT
            and self.reset_wanted is None
            and not any(part.is_busy for part in self.parts)
        )

    @property
    def is_busy(self) -> bool:
        """Whether a response is in preparation."""
        return self._pending is not None

    def allows(self, wanted: Access) -> bool:
        """Return whether the active session and the lock state allow an access."""
        return wanted.allows_in(self.session)

    def require_unlocked(self, wanted: Access) -> None:
        """Raise `RefusalError` when SecurityAccess is required but the computer is locked."""
        require(self.is_unlocked or not wanted.secured, Code.SECURITY_ACCESS_DENIED)

    def enter_session(self, session: Session) -> None:
        """Enter a session, and lock the computer again."""
        self.is_unlocked = False
        for part in self.parts:
            part.leave_session(session)
        self.session = session

    def power_on(self) -> None:
        """Start afresh after a reset."""
        self.enter_session(Session.DEFAULT)
        self._pending = None
        self.reset_wanted = None

    def keep_session(self, now_ns: int) -> None:
        """Restart the session timer, as while a response is being sent."""
        self._last_ns = now_ns

    def handle(self, request: bytes, is_functional: bool, now_ns: int) -> bytes | None:
        """Process a request; return the response, or None if there is none or none yet."""
        self.now_ns = self._last_ns = now_ns
        if not request:
            return None
        if self._pending is not None:
            if is_functional:
                return None
            return bytes([NEGATIVE, request[0], Code.BUSY_REPEAT_REQUEST])
        try:
            return self._serve(request, is_functional)
        except RefusalError as refusal:
            return _refused(request[0], refusal.code, is_functional)

    def _serve(self, request: bytes, is_functional: bool) -> bytes | None:
        number, data = request[0], request[1:]
        service = SERVICE_BY_NUMBER.get(number)
        if service is None or self.reset_wanted is not None:
            raise RefusalError(Code.SERVICE_NOT_SUPPORTED)
        is_here = self.allows(service.access)
        require(is_here, Code.SERVICE_NOT_SUPPORTED_IN_ACTIVE_SESSION)
        self.require_unlocked(service.access)
        wanted = True
        if service.subfunctions:
            data, wanted = self._subfunction(service, data)
        answer = self.handlers[number](self, data)
        if isinstance(answer, Later):
            due_ns = self.now_ns + round(PENDING_SHARE * access.P2_MS * _NS_PER_MS)
            self._pending = _Pending(number, answer, wanted, is_functional, due_ns)
            return self._poll(self._pending)
        return bytes([service.positive]) + answer if wanted else None

    def _subfunction(self, service: Service, data: bytes) -> tuple[bytes, bool]:
        """Check the sub-function; return the data without suppress bit, and whether to answer."""
        require(len(data) >= 1, Code.INCORRECT_MESSAGE_LENGTH)
        chosen = data[0] & ~SUPPRESS_BIT
        require(chosen in service.subfunctions, Code.SUB_FUNCTION_NOT_SUPPORTED)
        own = service.only_in.get(chosen)
        if own is not None:
            is_here = self.allows(own)
            require(is_here, Code.SUB_FUNCTION_NOT_SUPPORTED_IN_ACTIVE_SESSION)
            self.require_unlocked(own)
        return bytes([chosen]) + data[1:], not data[0] & SUPPRESS_BIT

    def poll(self, now_ns: int) -> bytes | None:
        """Advance by one epoch; return a response that has become due, or None."""
        self.now_ns = now_ns
        for part in self.parts:
            if part.is_busy:
                part.work()
        response = None if self._pending is None else self._poll(self._pending)
        if self._pending is not None:
            self._last_ns = now_ns
        elif self.session != Session.DEFAULT and self._is_timed_out():
            self.enter_session(Session.DEFAULT)
        return response

    def _is_timed_out(self) -> bool:
        return self.now_ns - self._last_ns >= access.S3_MS * _NS_PER_MS

    def _poll(self, pending: _Pending) -> bytes | None:
        try:
            data = pending.later.poll()
        except RefusalError as refusal:
            self._pending = None
            return _refused(pending.service, refusal.code, pending.is_functional)
        if data is not None:
            self._pending = None
            service = SERVICE_BY_NUMBER[pending.service]
            return bytes([service.positive]) + data if pending.wanted else None
        if self.now_ns < pending.due_ns:
            return None
        pending.due_ns = self.now_ns + round(PENDING_SHARE * access.P2_STAR_MS * _NS_PER_MS)
        pending.wanted = True  # a response pending obliges to respond
        return bytes([NEGATIVE, pending.service, Code.RESPONSE_PENDING])


def pending_before(response: bytes) -> bytes:
    """Return the response pending that announces a positive response."""
    return bytes([NEGATIVE, response[0] - POSITIVE_OFFSET, Code.RESPONSE_PENDING])


def _refused(service: int, code: Code, is_functional: bool) -> bytes | None:
    """Return a negative response; None if a functional request is not for this computer."""
    if is_functional and code in SILENT_WHEN_FUNCTIONAL:
        return None
    return bytes([NEGATIVE, service, code])
