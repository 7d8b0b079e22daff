"""Diagnostic and communication management: 0x10, 0x11, 0x27, 0x28, 0x3E, 0x85."""

from __future__ import annotations

from collections.abc import Callable

from rrins.firmware_py.diagnostics import access
from rrins.firmware_py.diagnostics.access import Session
from rrins.firmware_py.diagnostics.computer import NAVIGATION_MODES, Computer
from rrins.firmware_py.diagnostics.refusal import RefusalError, require
from rrins.firmware_py.diagnostics.responses import Code
from rrins.firmware_py.diagnostics.seed_and_key import SeedAndKey, Verdict
from rrins.firmware_py.diagnostics.server import Handler, Part, Reset, Server

_NORMAL, _MANAGEMENT = 0x01, 0x02  # communication types of 0x28, one bit each
_ALL_NETWORKS, _THIS_NETWORK = 0x00, 0xF0  # high nibble: there is one network
_DISABLE_TRANSMISSION = 0x01
_SETTING_OFF = 0x02
_REFUSALS = {
    Verdict.WRONG: Code.INVALID_KEY,
    Verdict.CLOSED: Code.EXCEEDED_NUMBER_OF_ATTEMPTS,
    Verdict.NO_SEED: Code.REQUEST_SEQUENCE_ERROR,
}


def _exactly(data: bytes, length: int) -> None:
    require(len(data) == length, Code.INCORRECT_MESSAGE_LENGTH)


def session_control(server: Server, data: bytes) -> bytes:
    """Enter a session (0x10)."""
    _exactly(data, 1)
    server.enter_session(Session(data[0]))
    return data + access.P2_MS.to_bytes(2, "big") + (access.P2_STAR_MS // 10).to_bytes(2, "big")


def tester_present(server: Server, data: bytes) -> bytes:
    """Keep the session alive (0x3E); the server has already noted the request."""
    _exactly(data, 1)
    return data


class Lock(Part):
    """SecurityAccess: a seed and its key.

    Parameters
    ----------
    random_bytes : callable
        Returns the given number of unpredictable bytes.
    """

    def __init__(self, secret: bytes, random_bytes: Callable[[int], bytes]) -> None:
        self._keys = SeedAndKey(secret, random_bytes)

    def leave_session(self, session: Session) -> None:
        """Forget the seed; the count of wrong keys remains."""
        self._keys.forget()

    def access(self, server: Server, data: bytes) -> bytes:
        """Issue a seed, or check a key (0x27)."""
        if data[0] == access.SEED_SUBFUNCTION:
            _exactly(data, 1)
            return data + self._give_seed(server)
        _exactly(data, 1 + access.KEY_SIZE)
        verdict = self._keys.check(data[1:], server.now_ns)
        if verdict is not Verdict.RIGHT:
            raise RefusalError(_REFUSALS[verdict])
        server.is_unlocked = True
        return data[:1]

    def _give_seed(self, server: Server) -> bytes:
        if server.is_unlocked:
            return bytes(access.SEED_SIZE)
        seed = self._keys.seed(server.now_ns)
        if seed is None:
            raise RefusalError(Code.REQUIRED_TIME_DELAY_NOT_EXPIRED)
        return seed


class Communication(Part):
    """CommunicationControl.

    Attributes
    ----------
    silent : int
        Stopped communication types, one bit each: 1 normal messages, 2 network management.
    """

    def __init__(self) -> None:
        self.silent = 0

    def leave_session(self, session: Session) -> None:
        """Resume communication in the default session."""
        if session == Session.DEFAULT:
            self.silent = 0

    def control(self, server: Server, data: bytes) -> bytes:
        """Stop or resume cyclic messages (0x28)."""
        _exactly(data, 2)
        types, network = data[1] & 0x0F, data[1] & 0xF0
        is_here = network in (_ALL_NETWORKS, _THIS_NETWORK)
        require(is_here and 0 < types <= _NORMAL | _MANAGEMENT, Code.REQUEST_OUT_OF_RANGE)
        if data[0] == _DISABLE_TRANSMISSION:
            self.silent |= types
        else:
            self.silent &= ~types
        return data[:1]


class Restart:
    """ECUReset: of a computer that navigates only if it is unlocked."""

    def __init__(self, computer: Computer) -> None:
        self._computer = computer

    def reset(self, server: Server, data: bytes) -> bytes:
        """Reset the computer (0x11)."""
        _exactly(data, 1)
        navigates = self._computer.mode in NAVIGATION_MODES
        require(server.is_unlocked or not navigates, Code.CONDITIONS_NOT_CORRECT)
        server.reset_wanted = Reset(data[0])
        return data


class DTCSetting(Part):
    """ControlDTCSetting."""

    def __init__(self, computer: Computer) -> None:
        self._held = computer.ram["diagnostics"]["held"]

    def leave_session(self, session: Session) -> None:
        """Resume the setting of trouble codes in the default session."""
        if session == Session.DEFAULT:
            self._held[0] = False

    def control(self, server: Server, data: bytes) -> bytes:
        """Stop or resume the setting of trouble codes (0x85)."""
        _exactly(data, 1)
        self._held[0] = data[0] == _SETTING_OFF
        return data


def handlers(
    lock: Lock, communication: Communication, setting: DTCSetting, restart: Restart
) -> dict[int, Handler]:
    """Return the services of this group."""
    return {
        0x10: session_control,
        0x11: restart.reset,
        0x27: lock.access,
        0x28: communication.control,
        0x3E: tester_present,
        0x85: setting.control,
    }
