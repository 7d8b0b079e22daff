"""Files: read only if they are files and of a sane size, written whole or not at all."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from rrins.host_tools.errors import RehearsalError

JsonObject = dict[str, Any]
"""A JSON object, for `--json` and for files; a table of a TOML file as well."""


LARGEST_TOML = 1 << 20
"""Bytes of a TOML file at most; a scenario with 100 faults has some 20,000."""

PREVIOUS = "previous"
"""Folder for results that others of the same name have replaced."""

_KINDS = {stat.S_IFIFO: "a pipe", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device"}


def content_of(path: Path, most: int) -> bytes:
    """Return the content of a file. Never waits, as a pipe would make it, and takes no more memory.

    Parameters
    ----------
    path : Path
    most : int
        Size at most, bytes.

    Raises
    ------
    OSError
        When it cannot be read, is not a file, or is larger; `strerror` says which.
    """
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK), "rb") as file:
        found = os.fstat(file.fileno())
        if not stat.S_ISREG(found.st_mode):
            kind = _KINDS.get(stat.S_IFMT(found.st_mode), "something else")
            raise OSError(errno.EINVAL, f"is {kind}, not a file", str(path))
        if found.st_size > most:
            size = f"{most >> 20} MiB" if most < 1 << 30 else f"{most >> 30} GiB"
            raise OSError(errno.EFBIG, f"is larger than {size}", str(path))
        return file.read()


def text_of(path: Path, most: int = LARGEST_TOML) -> str:
    """Return the text of a UTF-8 file, without a mark of its encoding, as `content_of` does.

    Raises
    ------
    OSError
        When it cannot be read, is not a file, is larger than `most` bytes, or is not UTF-8.
    """
    try:
        return content_of(path, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise OSError(errno.EILSEQ, "is not UTF-8 text", str(path)) from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give the path of a file that takes the place of `path` when it has been written.

    Raises
    ------
    RehearsalError
        When it cannot be written; what was at `path` before is there still.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        yield part
        part.replace(path)
    except OSError as error:
        raise RehearsalError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)


def write_whole(path: Path, write: Callable[[IO[str]], None]) -> None:
    """Write a text file so that it is there whole or not at all.

    Raises
    ------
    RehearsalError
        When it cannot be written.
    """
    with replacing(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        write(file)


def write_text(path: Path, text: str) -> None:
    """Write a text as a file that is there whole or not at all.

    Raises
    ------
    RehearsalError
        When it cannot be written.
    """
    with replacing(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        file.write(text)


def keep(folder: Path, names: Sequence[str]) -> Path:
    """Move files of a folder into its folder `previous`, in place of those there; return that.

    Raises
    ------
    RehearsalError
        When they cannot be moved.
    """
    place = folder / PREVIOUS
    make_folder(place)
    try:
        for name in names:
            (place / name).unlink(missing_ok=True)
            if (folder / name).exists():
                (folder / name).replace(place / name)
    except OSError as error:
        raise RehearsalError(f"{place}: {name} cannot be kept: {error.strerror}") from error
    return place


def make_folder(path: Path) -> None:
    """Make a folder, and those above it, if they are not there.

    Raises
    ------
    RehearsalError
        When it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RehearsalError(f"{path}: cannot be made: {error.strerror}") from error
