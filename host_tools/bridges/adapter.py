"""An emulated serial CAN adapter with the LAWICEL protocol (slcan): commands in, answers out.

=======================  =====================================================================
command                  what it does
=======================  =====================================================================
``S0`` … ``S8``, ``s…``  set the bit rate, which has no effect
``O``, ``L``, ``C``      open the channel, open it to listen only, close it
``t``, ``T``, ``r``,     send a frame with an identifier of 11 or 29 bits, with data or
``R``                    remote; answered with ``z`` or ``Z`` once it is on the bus
``Z0``, ``Z1``           end received frames with four digits: milliseconds modulo a minute
``V``, ``N``, ``F``      version, serial number, status flags
=======================  =====================================================================

Each ends with a carriage return, and so does each answer. BEL is the answer to all else, and to a
frame that cannot be sent.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

_CR: Final = b"\r"
_BELL: Final = b"\a"
_LONGEST_COMMAND: Final = 32
_HEX: Final = frozenset(b"0123456789ABCDEFabcdef")
_HEAD: Final = {b"t": (3, True), b"T": (8, True), b"r": (3, False), b"R": (8, False)}
"""Frames by their letter: digits of the identifier, whether data follow."""

_MS_PER_MINUTE: Final = 60_000


def is_frame(command: bytes) -> bool:
    """Return whether a command is a well-formed classic frame."""
    digits, has_data = _HEAD.get(command[:1], (0, False))
    length = command[1 + digits : 2 + digits]
    if not digits or not length.isdigit() or int(length) > 8:
        return False
    whole = 2 + digits + (2 * int(length) if has_data else 0)
    return len(command) == whole and _HEX.issuperset(command[1:])


class Adapter:
    """The state of an adapter.

    Parameters
    ----------
    send : callable
        Puts a frame on the bus, given as a well-formed command; returns whether the bus took it.

    Attributes
    ----------
    bitrate : bytes
        Digit of the last ``S`` command; empty if there was none.
    is_open : bool
        Whether the channel is open.
    refused : int
        Commands answered with BEL.
    out : bytearray
        What waits for the host; who sends it on removes it.
    """

    def __init__(self, send: Callable[[bytes], bool]) -> None:
        self._send = send
        self.out = bytearray()
        self.refused = 0
        self.power_on()

    def power_on(self) -> None:
        """Start afresh, with the channel closed."""
        self.bitrate = b""
        self.is_open = False
        self.out.clear()
        self._is_listening_only = False
        self._has_times = False
        self._command = bytearray()

    def feed(self, data: bytes) -> None:
        """Process bytes from the host and answer them."""
        for byte in data:
            if byte == _CR[0]:
                command = bytes(self._command)
                self._command.clear()
                self.out += self._frame(command) if command[:1] in _HEAD else self._obey(command)
            elif len(self._command) < _LONGEST_COMMAND:
                self._command.append(byte)

    def hear(self, frame: bytes, time_ms: int = 0) -> None:
        """Pass a frame of the bus on to the host.

        Parameters
        ----------
        frame : bytes
            As a command, without the carriage return.
        time_ms : int
            Its time.
        """
        if self.is_open:
            self.out += frame
            if self._has_times:
                self.out += b"%04X" % (time_ms % _MS_PER_MINUTE)
            self.out += _CR

    def _frame(self, command: bytes) -> bytes:
        can_send = self.is_open and not self._is_listening_only
        if can_send and is_frame(command) and self._send(command):
            return (b"z" if command[:1] in b"tr" else b"Z") + _CR
        return self._refuse()

    def _refuse(self) -> bytes:
        self.refused += 1
        return _BELL

    def _obey(self, command: bytes) -> bytes:
        letter, rest = command[:1], command[1:]
        if letter == b"S" and len(rest) == 1 and rest in b"012345678" and not self.is_open:
            self.bitrate = rest
        elif letter == b"s" and rest and _HEX.issuperset(rest) and not self.is_open:
            pass
        elif letter in (b"O", b"L") and not rest and not self.is_open:
            self.is_open = True
            self._is_listening_only = letter == b"L"
        elif command == b"C" and self.is_open:
            self.is_open = False
        elif command in (b"Z0", b"Z1") and not self.is_open:
            self._has_times = command == b"Z1"
        elif command == b"V":
            return b"V1013" + _CR
        elif command == b"N":
            return b"NEMUL" + _CR
        elif command == b"F" and self.is_open:
            return b"F00" + _CR
        elif command:
            return self._refuse()
        return _CR
