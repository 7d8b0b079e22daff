"""Whose a place in the file system is, and who is at the other end of a socket.

A bus belongs to one user. Neither end trusts a name alone: whoever first makes the folder of
another user's number in the temporary directory could else pass for the host of that user's bus.
"""

from __future__ import annotations

import contextlib
import os
import socket
import stat
import struct
from pathlib import Path
from typing import Final

from rrins.host_tools.errors import BusError

_CREDENTIALS: Final = struct.Struct("3i")
_ROOT: Final = 0
_OTHERS: Final = 0o077


def credentials(end: socket.socket) -> tuple[int, int]:
    """Return process and user at the other end: as it connected or, of a host, began to listen."""
    raw = end.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    pid, uid, _ = _CREDENTIALS.unpack(raw)
    return pid, uid


def may_attach(uid: int) -> bool:
    """Return whether a user may attach to our bus: only we and root."""
    return uid in (os.geteuid(), _ROOT)


def check_host(end: socket.socket, path: Path, is_chosen: bool) -> None:
    """Check who hosts the channel that a socket is connected to.

    Parameters
    ----------
    end : socket.socket
        Connected to the host.
    path : Path
        Where.
    is_chosen : bool
        Whether the user has named the path itself: there, root may attach to the owner's host.

    Raises
    ------
    BusError
        If it belongs to another user.
    """
    pid, uid = credentials(end)
    if uid in (os.geteuid(), _ROOT):
        return
    if is_chosen and os.geteuid() == _ROOT and path.lstat().st_uid == uid:
        return
    raise BusError(
        f"the bus at {path} is hosted by process {pid} of another user (uid {uid}): not attached; "
        "set XDG_RUNTIME_DIR to a folder of your own"
    )


def check_folder(path: Path) -> None:
    """Check that a folder of channels is ours alone.

    Raises
    ------
    FileNotFoundError
        If it is not there.
    BusError
        If it belongs to another user, or others can enter it.
    """
    try:
        status = path.lstat()
    except FileNotFoundError:
        raise
    except OSError as error:
        raise BusError(f"cannot look at the folder of the bus {path}: {error.strerror}") from error
    if not stat.S_ISDIR(status.st_mode):
        raise BusError(f"{path} is not a folder: remove it, or set XDG_RUNTIME_DIR")
    if status.st_uid != os.geteuid():
        raise BusError(
            f"the folder of the bus {path} belongs to another user (uid {status.st_uid}): "
            "set XDG_RUNTIME_DIR to a folder of your own"
        )
    if status.st_mode & _OTHERS:
        raise BusError(f"the folder of the bus {path} is open to others: run 'chmod 700 {path}'")


def own_folder(path: Path) -> None:
    """Make a folder of channels if it is not there, and check that it is ours alone.

    Raises
    ------
    BusError
        If it cannot be made, belongs to another user, or others can enter it.
    """
    try:
        with contextlib.suppress(FileExistsError):
            path.mkdir(mode=0o700)
        check_folder(path)
    except OSError as error:
        raise BusError(f"cannot make the folder of the bus {path}: {error.strerror}") from error
