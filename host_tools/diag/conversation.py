"""Requests to the navigation computer: sessions, security, retries."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import udsoncan
from udsoncan.client import Client
from udsoncan.exceptions import (
    InvalidResponseException,
    NegativeResponseException,
    TimeoutException,
    UnexpectedResponseException,
)

from rrins.firmware_py.diagnostics import access, table
from rrins.firmware_py.diagnostics.access import ANYWHERE, Access, Session, key_of
from rrins.firmware_py.diagnostics.codecs import Value, Values
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.responses import Code
from rrins.host_tools.diag.advice import refusal
from rrins.host_tools.diag.connection import DisturbedError
from rrins.host_tools.diag.target import Target
from rrins.host_tools.errors import DiagError, NoAnswerError

PRESENCE_S = 2.0
"""Interval of the TesterPresent requests that keep a session alive."""

LOST_SESSION = (
    Code.SERVICE_NOT_SUPPORTED_IN_ACTIVE_SESSION,
    Code.SUB_FUNCTION_NOT_SUPPORTED_IN_ACTIVE_SESSION,
    Code.SECURITY_ACCESS_DENIED,
)
"""Negative responses which show that a session has ended or is locked again."""

_LOST_BETWEEN = (*LOST_SESSION, Code.REQUEST_SEQUENCE_ERROR)  # between seed and key
_ATTEMPTS = 4
_PAUSE_S = 0.05

_T = TypeVar("_T")


class _Codec(udsoncan.DidCodec):
    """udsoncan codec of a data identifier."""

    def __init__(self, did: DataIdentifier) -> None:
        super().__init__()
        self._did = did

    def encode(self, *did_value: Values, **named: Value) -> bytes:
        return self._did.encode(did_value[0] if did_value else named)

    def decode(self, string_bin: bytes) -> Values:
        return self._did.decode(string_bin)

    def __len__(self) -> int:
        return self._did.layout.size


class _Refused(Exception):  # noqa: N818 - internal to this module
    """A negative response."""

    def __init__(self, what: str, code: int) -> None:
        super().__init__(f"{what}: 0x{code:02X}")
        self.what = what
        self.code = code


def _configuration(timeout_s: float, secret: bytes) -> Any:
    """Return the configuration of udsoncan's client for the diagnostic table."""
    codecs = {did.number: _Codec(did) for did in table.IDENTIFIERS}
    record_size = sum(layout.size for layout in table.EXTENDED_DATA.values())
    return dict(udsoncan.configs.default_client_config) | {
        "data_identifiers": codecs,
        "input_output": {
            did.number: codecs[did.number] for did in table.IDENTIFIERS if did.control
        },
        "security_algo": lambda level, seed, params: key_of(seed, secret),
        "extended_data_size": {trouble.number: record_size for trouble in table.TROUBLES},
        "request_timeout": None,
        "p2_timeout": timeout_s,
        "p2_star_timeout": access.P2_STAR_MS / 1000 + timeout_s,
        "use_server_timing": False,
    }


class Conversation:
    """A conversation with the navigation computer by udsoncan's client.

    Each request first enters the session that it needs, and unlocks it if allowed. A session lost
    in the meantime is entered again: in a rehearsal faster than real time its five seconds may
    expire within milliseconds.

    Parameters
    ----------
    target : Target
    is_securing : bool
        Whether to unlock by SecurityAccess if a request needs it.
    secret : bytes
        The computer's secret.

    Attributes
    ----------
    client : udsoncan.client.Client
        Configured for the diagnostic table.
    connection : Connection
    session : Session
        Active session, as far as the tool knows.
    lock : threading.RLock
        Held during a request, also by a thread that keeps the session alive.

    Raises
    ------
    BusError
        If the bus cannot be opened.
    """

    def __init__(
        self,
        target: Target,
        is_securing: bool,
        secret: bytes,
    ) -> None:
        self.target = target
        self.is_securing = is_securing
        self.session = Session.DEFAULT
        self.lock = threading.RLock()
        self._is_unlocked = False
        self._has_answered = False
        self.connection = target.connect()
        self.client: Any = Client(self.connection, config=_configuration(target.timeout_s, secret))
        self.client.logger.disabled = True  # errors are raised instead
        self.client.open()

    def close(self) -> None:
        """Leave the bus."""
        self.client.close()

    # ---- sessions

    def enter(self, session: Session) -> None:
        """Enter a session; the programming session by way of the extended one."""
        self.request(f"session {session.name.lower()}", ANYWHERE, lambda: self._go(session))

    def _go(self, session: Session) -> None:
        if session == Session.PROGRAMMING:
            self._change_session(Session.EXTENDED)
        self._change_session(session)

    def _change_session(self, session: Session) -> None:
        self.forget_session()
        self.carry_out(
            f"session {session.name.lower()}", lambda: self.client.change_session(int(session))
        )
        self.session = session

    def forget_session(self) -> None:
        """Record that the computer is in the default session, and locked."""
        self.session, self._is_unlocked = Session.DEFAULT, False

    @property
    def is_unlocked(self) -> bool:
        """Whether SecurityAccess has been passed, as far as the tool knows."""
        return self._is_unlocked

    def unlock(self) -> None:
        """Unlock by SecurityAccess; enter the extended session if the active one lacks it."""
        self.is_securing = True
        wanted = table.service(0x27).access
        self.request("security access", Access(wanted.sessions, secured=True), lambda: None)

    def _pass_security(self) -> None:
        level = access.SEED_SUBFUNCTION
        self.carry_out("security access", lambda: self.client.unlock_security_access(level))
        self._is_unlocked = True

    def _provide(self, wanted: Access) -> None:
        """Enter the session that a request needs, and unlock if needed and allowed."""
        if not wanted.allows_in(self.session):
            extended = wanted.allows_in(Session.EXTENDED)
            self._go(Session.EXTENDED if extended else Session.PROGRAMMING)
        if wanted.secured and self.is_securing and not self._is_unlocked:
            self._pass_security()

    def keep(self) -> None:
        """Keep the session alive, without waiting for a response."""
        with self.lock:
            if self.session == Session.DEFAULT:
                self.connection.drain()
                return
            with self.client.suppress_positive_response:
                self.client.tester_present()

    def pass_time(self, seconds: float) -> None:
        """Let time pass, and keep the session alive."""
        left = seconds
        while left > 0:
            self.connection.pass_time(min(left, PRESENCE_S))
            left -= PRESENCE_S
            self.keep()

    # ---- requests

    def request(
        self,
        what: str,
        wanted: Access,
        call: Callable[[], _T],
        lost: Sequence[int] = LOST_SESSION,
        is_repeatable: bool = True,
        advice: Callable[[int], str] | None = None,
    ) -> _T:
        """Make a request in the session it needs; repeat it if the session was lost.

        Parameters
        ----------
        what : str
            Name of the request, for errors.
        wanted : Access
        call : callable
        lost : sequence of int
            Negative responses that indicate a lost session.
        is_repeatable : bool
            Whether the request can safely be repeated.
        advice : callable, optional
            Returns what to do about a negative response.

        Raises
        ------
        NegativeResponseError
            If the computer refuses.
        NoAnswerError
            If the computer does not answer.
        BusError
            If the bus has ended.
        """
        with self.lock:
            for _ in range(_ATTEMPTS):
                try:
                    self._provide(wanted)
                except _Refused as refused:
                    failure, is_lost = refused, refused.code in _LOST_BETWEEN
                else:
                    try:
                        return self.carry_out(what, call, is_repeatable)
                    except _Refused as refused:
                        failure, is_lost = refused, self._is_lost(refused.code, lost)
                if not is_lost:
                    break
                self.forget_session()
            words = advice(failure.code) if advice else ""
            raise refusal(failure.what, failure.code, words) from failure

    def _is_lost(self, code: int, lost: Sequence[int]) -> bool:
        """Return whether a negative response means that the assumed session was lost."""
        if code not in lost or self.session == Session.DEFAULT:
            return False
        return self._is_unlocked or code != Code.SECURITY_ACCESS_DENIED

    def carry_out(self, what: str, call: Callable[[], _T], is_repeatable: bool = True) -> _T:
        """Send a request; repeat it if the response was lost or the computer was busy.

        For a request within others, as the blocks of a transfer; it raises what `request` does.
        """
        last: Exception | None = None
        for _ in range(_ATTEMPTS):
            try:
                found = call()
            except NegativeResponseException as error:
                self._has_answered = True
                if error.response.code != Code.BUSY_REPEAT_REQUEST:
                    raise _Refused(what, int(error.response.code or 0)) from error
                last = error
                self.connection.pass_time(_PAUSE_S)
            except TimeoutException as error:
                last = error
                if not self._has_answered or not is_repeatable:
                    break
            except DisturbedError as error:
                last = error
                if not is_repeatable:
                    break
                self.connection.pass_time(_PAUSE_S)
            except (InvalidResponseException, UnexpectedResponseException) as error:
                last = error  # a late response to an earlier request
                if not is_repeatable:
                    break
            else:
                self._has_answered = True
                return found
        assert last is not None
        raise self._why_none(what, last) from last

    def _why_none(self, what: str, last: Exception) -> DiagError:
        where = self.connection.where
        if isinstance(last, DisturbedError):
            return last
        if isinstance(last, NegativeResponseException):
            return refusal(what, Code.BUSY_REPEAT_REQUEST)
        if not isinstance(last, TimeoutException):
            return DiagError(f"bus {where}: {what}: invalid response: {last}")
        if self._has_answered:
            return NoAnswerError(f"bus {where}: {what}: the navigation computer no longer answers")
        asked = f"nobody answers diagnostic requests (0x{table.request_id():03X})"
        if self.connection.hears_others():
            return NoAnswerError(
                f"bus {where}: {asked}, but there is traffic; is `rrins firmware` running?"
            )
        return NoAnswerError(
            f"bus {where}: {asked}, and there is no traffic; is a rehearsal running, or is another "
            "tool holding it up?"
        )
