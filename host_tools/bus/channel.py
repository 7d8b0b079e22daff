"""The place of a channel in the file system, and the exclusive right to host it.

A channel ``NAME`` is the socket ``$XDG_RUNTIME_DIR/rrins/NAME.sock``, or, without a runtime
directory, ``<temporary directory>/rrins-<uid>/NAME.sock``; a channel with a slash in it is the path
of the socket itself. The directory and the socket belong to their owner alone; an end that attaches
checks that, and who its host is, before it sends or receives anything.

Beside the socket lies ``NAME.sock.lock``. Whoever holds its lock hosts the channel. The kernel
releases the lock of a process that dies, so a socket file without a locked file is stale and is
replaced without asking the socket. ``NAME.sock.reserved`` is locked by a process that is about to
start a host, so that others who look for a free channel take another.
"""

from __future__ import annotations

import fcntl
import os
import re
import socket
import tempfile
import time
from pathlib import Path
from typing import Final

from rrins.host_tools.bus.ownership import check_folder, check_host, own_folder
from rrins.host_tools.closing import Closing
from rrins.host_tools.errors import BusError

SUFFIX: Final = ".sock"
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
_PATH_LIMIT: Final = 107  # sun_path of struct sockaddr_un, less its terminating zero
_BACKLOG: Final = 128
_RETRY_S: Final = 0.001


class NoHostError(BusError):
    """Nobody hosts the channel."""


class HostedError(BusError):
    """Another process hosts the channel."""


def directory() -> Path:
    """Return the directory of the named channels; it need not exist."""
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime and Path(runtime).is_dir():
        return Path(runtime) / "rrins"
    return Path(tempfile.gettempdir()) / f"rrins-{os.geteuid()}"


def socket_path(channel: str) -> Path:
    """Return the path of a channel's socket.

    Raises
    ------
    BusError
        If the name is not one, or the path is too long for a socket.
    """
    if "/" in channel:
        path = Path(channel).absolute()
    elif _NAME.fullmatch(channel):
        path = directory() / (channel + SUFFIX)
    else:
        raise BusError(
            f"{channel!r} is not a channel name: use up to 64 letters, digits, '.', '_' and '-', "
            "starting with a letter or digit, or a path with a '/' in it"
        )
    length = len(os.fsencode(path))
    if length > _PATH_LIMIT:
        raise BusError(
            f"the socket path of channel {channel!r} has {length} bytes and a socket takes "
            f"{_PATH_LIMIT}: use a shorter name, or a shorter XDG_RUNTIME_DIR ({path})"
        )
    return path


def detect() -> list[str]:
    """Return the names of our channels that are hosted at this moment; none in an unsafe place."""
    names: list[str] = []
    try:
        check_folder(directory())
    except (BusError, FileNotFoundError):  # whoever hosts or attaches there is told why
        return names
    for path in sorted(directory().glob("*" + SUFFIX)):
        probe = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        probe.setblocking(False)
        with probe:
            try:
                probe.connect(str(path))
            except BlockingIOError:  # a host that is busy, with a queue of callers
                names.append(path.name.removesuffix(SUFFIX))
            except OSError:
                continue  # nobody behind the file, or it is not ours
            else:
                names.append(path.name.removesuffix(SUFFIX))
    return names


def connect(channel: str, timeout: float) -> socket.socket:
    """Return a socket connected to the host of a channel.

    Raises
    ------
    NoHostError
        If nobody hosts the channel.
    BusError
        If its host does not answer, does not let us in, or belongs to another user.
    """
    path = socket_path(channel)
    is_path = "/" in channel
    end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        if not is_path:
            check_folder(path.parent)
        _call(end, path, timeout)
        check_host(end, path, is_path)
    except (FileNotFoundError, ConnectionRefusedError, ConnectionResetError) as error:
        end.close()
        raise NoHostError(
            f"no bus {channel!r}: nobody hosts it at {path}; start its host first, "
            'or open it with host="auto" or host="here"'
        ) from error
    except TimeoutError as error:
        end.close()
        raise BusError(
            f"the host of channel {channel!r} has not answered for {timeout:g} s"
        ) from error
    except OSError as error:
        end.close()
        raise BusError(
            f"cannot attach to channel {channel!r} at {path}: {error.strerror}"
        ) from error
    except BaseException:
        end.close()
        raise
    return end


def _call(end: socket.socket, path: Path, timeout: float) -> None:
    """Connect to a host, waiting while more callers than it has room for come first."""
    deadline = time.monotonic() + timeout
    end.settimeout(timeout)
    while True:
        try:
            end.connect(str(path))
        except BlockingIOError as error:
            if time.monotonic() >= deadline:
                raise TimeoutError from error
            time.sleep(_RETRY_S)
        else:
            return


class _LockedError(Exception):
    """Another process holds a lock; `holder` is its number."""

    def __init__(self, holder: str) -> None:
        self.holder = holder or "unknown"


class _Lock:
    """A file that is locked, with the number of this process in it; the lock ends with the process.

    Raises
    ------
    _LockedError
        If another process holds it.
    OSError
        If the file cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = self._acquire()

    def _acquire(self) -> int:
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
        while True:
            lock = os.open(self._path, flags, 0o600)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if self._is_current(lock):
                    os.truncate(lock, 0)
                    os.pwrite(lock, str(os.getpid()).encode(), 0)
                    return lock
                os.close(lock)  # its holder removed the file between our open and our lock
            except BlockingIOError as error:
                holder = os.pread(lock, 16, 0).decode(errors="replace")
                os.close(lock)
                raise _LockedError(holder) from error
            except BaseException:
                os.close(lock)
                raise

    def _is_current(self, lock: int) -> bool:
        try:
            return os.path.samestat(os.fstat(lock), self._path.stat())
        except FileNotFoundError:
            return False

    def release(self) -> None:
        """Remove the file, then unlock it."""
        # Removed while it is still locked: whoever opened it in between finds it is not current.
        self._path.unlink(missing_ok=True)
        os.close(self._file)


class Claim:
    """The exclusive right to host a channel, with the listening socket that goes with it.

    Parameters
    ----------
    channel : str
        Name or path of the channel.

    Attributes
    ----------
    path : Path
        Path of the socket.
    listener : socket.socket
        Non-blocking, listening.

    Raises
    ------
    HostedError
        If another process hosts the channel.
    BusError
        If its place is not safe.
    """

    def __init__(self, channel: str) -> None:
        self.path = socket_path(channel)
        if "/" not in channel:
            own_folder(self.path.parent)
        try:
            self._lock = _Lock(self.path.with_name(self.path.name + ".lock"))
        except _LockedError as error:
            raise HostedError(
                f"channel {channel!r} is already hosted by process {error.holder}"
            ) from error
        except OSError as error:
            raise BusError(
                f"cannot host channel {channel!r} at {self.path}: {error.strerror}"
            ) from error
        try:
            self.listener = self._listen(channel)
        except BaseException:
            self._lock.release()
            raise

    def _listen(self, channel: str) -> socket.socket:
        # We hold the lock: a socket file that is there was left by a host that died.
        try:
            if self.path.is_symlink() or (self.path.exists() and not self.path.is_socket()):
                raise BusError(
                    f"cannot host channel {channel!r}: {self.path} exists and is not a socket"
                )
            self.path.unlink(missing_ok=True)
            listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            try:
                listener.setblocking(False)
                listener.bind(str(self.path))
                # Between bind and listen nobody can connect, so there is no moment of open doors.
                self.path.chmod(0o600)
                listener.listen(_BACKLOG)
            except BaseException:
                listener.close()
                raise
        except OSError as error:
            raise BusError(
                f"cannot host channel {channel!r} at {self.path}: {error.strerror}"
            ) from error
        return listener

    def release(self) -> None:
        """Remove the socket, then release the right to host."""
        self.path.unlink(missing_ok=True)
        self.listener.close()
        self._lock.release()


class Reservation(Closing):
    """A channel that nobody hosts; no other process reserves it until this is closed.

    Parameters
    ----------
    stem : str
        The channel is the first of its name with 0, 1, 2 and so on behind it.

    Attributes
    ----------
    channel : str

    Raises
    ------
    BusError
        If the place of channels is not safe.
    """

    def __init__(self, stem: str) -> None:
        own_folder(directory())
        number = 0
        while not self._reserve(f"{stem}{number}"):
            number += 1

    def _reserve(self, channel: str) -> bool:
        path = socket_path(channel)
        try:
            lock = _Lock(path.with_name(path.name + ".reserved"))
        except _LockedError:
            return False
        except OSError as error:
            raise BusError(f"cannot reserve channel {channel!r}: {error.strerror}") from error
        if channel in detect():
            lock.release()
            return False
        self.channel = channel
        self._lock = lock
        return True

    def close(self) -> None:
        """Let others have the channel."""
        self._lock.release()
