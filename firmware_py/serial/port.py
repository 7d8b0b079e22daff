"""Serial ports and pseudo-terminals that never make the loop wait.

Output that a port cannot accept at once is dropped in whole pieces and counted. A pseudo-terminal
that nobody has open accepts nothing; a device that disappears is reported once.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import select
import struct
import termios
import tty
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

_GONE = select.POLLHUP | select.POLLERR | select.POLLNVAL
_DRAIN = 4096

OnLost = Callable[[str], None]
"""Called once, with a line that names what was lost."""


class SerialPortError(Exception):
    """A port that is misspelt or cannot be opened; the message has one line."""


@dataclass(frozen=True)
class PortName:
    """A port as the user names it."""

    text: str  #: as given
    kind: Literal["device", "pty", "file"]
    path: Path | None  #: the device, the link to the pseudo-terminal (None for none), or the file
    baud: int  #: of a device; 0 for the others


def parse_port(text: str, default_baud: int) -> PortName:
    """Read ``DEVICE[:BAUD]``, ``pty[:LINK]`` or ``file:PATH``.

    Raises
    ------
    SerialPortError
        When the text has none of these forms.
    """
    kind, _, rest = text.partition(":")
    if kind == "pty":
        return PortName(text, "pty", Path(rest) if rest else None, 0)
    if kind == "file":
        if not rest:
            raise SerialPortError(f"port {text!r}: file: needs a path, as in file:nmea.txt")
        return PortName(text, "file", Path(rest), 0)
    device, _, digits = text.rpartition(":")
    if device and digits.isdecimal() and not Path(text).exists():  # some names hold colons
        if not int(digits):
            raise SerialPortError(f"port {text!r}: 0 is not a baud rate")
        return PortName(text, "device", Path(device), int(digits))
    if not text:
        raise SerialPortError("port: expected DEVICE[:BAUD], pty[:LINK] or file:PATH")
    return PortName(text, "device", Path(text), default_baud)


class SerialPort:
    """An open port; its kinds are in this module, see `open_port`.

    Parameters
    ----------
    fd : int
        Open and non-blocking; the port closes it.
    name : str
        As the other end knows it.
    on_lost : callable

    Attributes
    ----------
    sent : int
        Pieces written.
    dropped : int
        Pieces dropped because of a slow reader.
    unread : int
        Pieces that had no reader.
    """

    _poll_for = select.POLLIN | select.POLLOUT

    def __init__(self, fd: int, name: str, on_lost: OnLost) -> None:
        self._fd = fd
        self.name = name
        self._on_lost = on_lost
        self._poll = select.poll()
        self._poll.register(fd, self._poll_for)
        self._rest = b""  # of a piece that was written in part
        self.is_open = True
        self.sent = 0
        self.dropped = 0
        self.unread = 0

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._fd

    def is_attached(self) -> bool:
        """Return whether the other end is connected, as far as the port can tell."""
        return self._events() is not None

    def _polled(self) -> int | None:
        """Return what the port is ready for; None when it hung up."""
        found = self._poll.poll(0)
        events = found[0][1] if found else 0
        return None if events & _GONE else events

    def _events(self) -> int | None:
        """Return what the port is ready for; None when it is lost or has no peer."""
        if not self.is_open:
            return None
        events = self._polled()
        if events is None:
            self._lose("it hung up")
        return events

    def _lose(self, why: str) -> None:
        self.close()
        self._on_lost(f"{self.name} is lost: {why}; continuing without it")

    def _has_room(self, size: int) -> bool:
        """Return whether data written now would go out soon."""
        return True

    def read(self, limit: int = 64) -> bytes:
        """Return up to `limit` received bytes; empty if there are none."""
        if not (self._events() or 0) & select.POLLIN:
            return b""
        try:
            data = os.read(self._fd, limit)
        except BlockingIOError:
            return b""
        except OSError as error:
            self._lose(error.strerror or str(error))
            return b""
        if not data:
            self._lose("it hung up")
        return data

    def write(self, data: bytes) -> int:
        """Write as much as possible without waiting; return the number of bytes."""
        if not self.is_open:
            return 0
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0
        except OSError as error:
            self._lose(error.strerror or str(error))
            return 0

    def offer(self, pieces: Sequence[bytes]) -> None:
        """Write pieces, each wholly or not at all, after the rest of an unfinished one."""
        events = self._events()
        if events is None:
            self._rest = b""
            self.unread += len(pieces)
            return
        if events & select.POLLIN:  # discard input, such as the probes of gpsd
            self.read(_DRAIN)
        data = self._rest + b"".join(pieces)
        is_ready = events & select.POLLOUT and self.is_open and self._has_room(len(data))
        taken = self.write(data) if is_ready else 0
        self._account(pieces, taken)

    def _account(self, pieces: Sequence[bytes], taken: int) -> None:
        """Count the pieces that were written, and keep the rest of an unfinished one."""
        end = len(self._rest)
        self._rest = self._rest[taken:]
        for piece in pieces:
            begin, end = end, end + len(piece)
            if taken <= begin:
                self.dropped += 1
                continue
            self.sent += 1
            self._rest = piece[taken - begin :]

    def close(self) -> None:
        """Close the port. Idempotent."""
        if self.is_open:
            self.is_open = False
            os.close(self._fd)


class _File(SerialPort):
    """A file, overwritten from its beginning when the first piece arrives."""

    _poll_for = select.POLLOUT
    _is_begun = False

    def write(self, data: bytes) -> int:
        if not self._is_begun and self.is_open:
            self._is_begun = True
            with contextlib.suppress(OSError):  # a pipe has no length
                os.ftruncate(self._fd, 0)
        return super().write(data)


class _Device(Protocol):
    """A serial device, as pyserial opens it."""

    def fileno(self) -> int: ...

    def close(self) -> None: ...


class _DevicePort(SerialPort):
    """A serial device."""

    def __init__(self, device: _Device, name: str, on_lost: OnLost) -> None:
        # pyserial configures the line; its own write would busy-wait on a full buffer.
        self._device = device
        os.set_blocking(device.fileno(), False)
        super().__init__(device.fileno(), name, on_lost)

    def _has_room(self, size: int) -> bool:
        """Refuse what would queue up behind an earlier set: late sentences help nobody."""
        waiting = fcntl.ioctl(self._fd, termios.TIOCOUTQ, struct.pack("i", 0))
        return int(struct.unpack("i", waiting)[0]) < size

    def close(self) -> None:
        if self.is_open:
            self.is_open = False
            self._device.close()


class _PseudoTerminal(SerialPort):
    """A pseudo-terminal: this process holds the master; others open the slave by name."""

    def __init__(self, link: Path | None, on_lost: OnLost) -> None:
        master, slave = os.openpty()
        tty.setraw(slave)
        os.fchmod(slave, 0o600)  # the group tty could otherwise type into the console
        self._path = os.ttyname(slave)
        os.close(slave)  # now the master shows whether anyone else has it open
        os.set_blocking(master, False)
        super().__init__(master, self._path, on_lost)
        self._was_attached = False
        self._link: Path | None = None
        if link is not None:
            self._set_link(link)

    def _set_link(self, link: Path) -> None:
        try:
            if link.is_symlink():  # left by a run that was killed
                link.unlink()
            link.symlink_to(self._path)
        except OSError as error:
            self.close()
            raise SerialPortError(f"pty:{link}: cannot be linked: {error.strerror}") from error
        self._link = link
        self.name = f"{self._path} ({link})"

    def _events(self) -> int | None:
        if not self.is_open:
            return None
        events = self._polled()
        if events is None and self._was_attached:
            self._forget()
        self._was_attached = events is not None
        return events

    def _forget(self) -> None:
        """Discard what the last reader left unread, and its terminal settings."""
        slave = os.open(self._path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        termios.tcflush(slave, termios.TCIFLUSH)
        tty.setraw(slave)
        os.close(slave)

    def _lose(self, why: str) -> None:
        """Treat it as having no reader: readers come and go."""

    def close(self) -> None:
        if self._link is not None and self.is_open:
            with contextlib.suppress(FileNotFoundError):
                self._link.unlink()
        super().close()


def open_port(port: PortName, on_lost: OnLost) -> SerialPort:
    """Open a port.

    Raises
    ------
    SerialPortError
        One line: which port, and what is wrong with it.
    """
    if port.kind == "pty":
        try:
            return _PseudoTerminal(port.path, on_lost)
        except OSError as error:
            raise SerialPortError(f"{port.text}: no pseudo-terminal: {error.strerror}") from error
    assert port.path is not None
    if port.kind == "file":
        flags = os.O_WRONLY | os.O_CREAT | os.O_NONBLOCK | os.O_CLOEXEC
        try:
            return _File(os.open(port.path, flags, 0o666), str(port.path), on_lost)
        except OSError as error:
            raise SerialPortError(f"{port.text}: cannot be written: {error.strerror}") from error
    return _open_device(port, on_lost)


_HINTS = {
    errno.EAGAIN: "another program uses it",
    errno.EBUSY: "another program uses it",
    errno.EACCES: "no permission (is the user in the group dialout?)",
    errno.ENOTTY: "not a serial device",
}


def _why(error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number is None:
        return " ".join(str(error).split())
    return _HINTS.get(number, os.strerror(number))


def _open_device(port: PortName, on_lost: OnLost) -> SerialPort:
    import serial

    try:
        device = serial.Serial(str(port.path), port.baud, timeout=0, exclusive=True)
    except (serial.SerialException, OSError, ValueError, OverflowError) as error:
        raise SerialPortError(f"serial port {port.text}: {_why(error)}") from error
    return _DevicePort(device, f"{port.path} at {port.baud} baud", on_lost)
