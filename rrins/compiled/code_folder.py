"""The folder of compiled code: files that are whole, checked before use, and their owner's alone.

Compiled code is run as it is read. So a file counts only if its checksum is right, and the folder
only if nobody but its owner can write there. Whatever is missing or damaged is compiled anew.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import hashlib
import logging
import os
import platform
import re
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

from llvmlite import binding as llvm

from rrins.compiled.compile_events import heed_signals
from rrins.compiled.sources import PACKAGE, Sources

_log = logging.getLogger(__name__)

SHIPPED = PACKAGE / "compiled" / "objects"
"""Where the package carries objects, if it does: read by whoever can import it."""
KEY = "key"
"""File beside them: `shipped_key`."""
_LIBRARIES = "numba", "llvmlite", "numpy"
_KEPT = 4
"""Folders of former sources to keep, for a return to those sources."""
_KEPT_S = 24 * 3600.0
"""How long a folder is kept after its last use, whatever their number."""
_STALE_S = 3600.0
"""Age from which a file that is not finished never will be."""
_MAGIC = b"rrins compiled code 1\n"
_DIGEST_BYTES = 32
_CLAIM_POLL_S = 0.01
_ENDING = ".code"
_UNFINISHED = ".part"
_NAME_OF_FOLDER = re.compile(r"[0-9a-f]{16}")
_WAY_OUT = "have XDG_CACHE_HOME name another folder"


class CodeFolderError(Exception):
    """The folder of compiled code is not its user's alone."""


def _base() -> Path:
    """Return where the folders are.

    Raises
    ------
    RuntimeError
        When the user has no home.
    """
    named = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    return (Path(named) if named else Path.home() / ".cache").absolute() / "rrins"


@functools.cache
def sources() -> Sources:
    """Return the sources of this package; facts about them are kept where the folders are."""
    place = hashlib.sha256(os.fsencode(PACKAGE)).hexdigest()[:8]
    try:
        return Sources(memory=_base() / f"sources-{place}.json")
    except RuntimeError:
        return Sources()


@functools.cache
def code_folder() -> CodeFolder | None:
    """Return the folder of these sources, by `NUMBA_CACHE_DIR` or `XDG_CACHE_HOME` if one is set.

    None if the user has no home.
    """
    try:
        named = os.environ.get("NUMBA_CPU_NAME"), os.environ.get("NUMBA_CPU_FEATURES")
        host = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
        processor = named if named[0] else host
        versions = [version(name) for name in _LIBRARIES]
        key = repr((versions, sys.version, processor, sources().digest))
        return CodeFolder(_base() / hashlib.sha256(key.encode()).hexdigest()[:16])
    except RuntimeError:
        return None


def shipped_key() -> str:
    """Return what objects that a wheel carries have to be of: Python, machine, sources."""
    return " ".join((sys.implementation.cache_tag, platform.machine(), sources().digest))


@functools.cache
def shipped() -> Path | None:
    """Return the folder of the objects that the package carries; None if they are of others."""
    with contextlib.suppress(OSError):
        if (SHIPPED / KEY).read_text() == shipped_key():
            return SHIPPED
    return None


def _check_owner(path: Path) -> None:
    """Refuse a folder that somebody else can write."""
    found = path.stat()
    if found.st_uid != os.geteuid():
        wrong = f"belongs to user {found.st_uid}, you are user {os.geteuid()}"
        raise CodeFolderError(f"folder of compiled code {path}: {wrong}: {_WAY_OUT}")
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        wrong = f"others can write to it (mode {stat.S_IMODE(found.st_mode):o})"
        raise CodeFolderError(f"folder of compiled code {path}: {wrong}: delete it, or {_WAY_OUT}")


def _checksum(name: str, code: bytes) -> bytes:
    """Return the checksum of a file: it covers the name, so files cannot stand for each other."""
    return hashlib.sha256(b"\0".join((name.encode(), code))).digest()


class CodeFolder:
    """Compiled code by name, one file each.

    Parameters
    ----------
    path : Path
        Made with the first file, for its owner alone. Folders beside it belong to other sources;
        of those not used for long, the last few are kept.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._is_known = False
        self._is_swept = False
        self._said: set[str] = set()

    def check(self) -> None:
        """Refuse the folder if somebody else can write there.

        Raises
        ------
        CodeFolderError
            With what to do.
        """
        for folder in (self.path.parent, self.path):
            with contextlib.suppress(FileNotFoundError, NotADirectoryError):
                _check_owner(folder)

    def load(self, name: str) -> bytes | None:
        """Return a file's content; None if it is not there, or was damaged and is gone now.

        Raises
        ------
        CodeFolderError
            When somebody else can write to the folder.
        """
        self._enter()
        try:
            return self._read(name)
        except FileNotFoundError:
            return None
        except (OSError, ValueError):
            self.heal()
            return None

    def save(self, name: str, code: bytes) -> None:
        """Keep a file; where that fails, say so once.

        Raises
        ------
        CodeFolderError
            When somebody else can write to the folder.
        """
        try:
            self._make()
            self._write(name, code)
        except OSError as error:
            self._say("cannot be kept", f"{error.strerror}; every start compiles, or {_WAY_OUT}")

    @contextlib.contextmanager
    def claimed(self, name: str) -> Iterator[None]:
        """Let no other process make a file meanwhile; wait while one does, open to Ctrl-C.

        Claims may nest, the file that another one needs within it.
        """
        claims = self._claims()
        if claims is None:
            yield
            return
        place = int.from_bytes(hashlib.sha256(name.encode()).digest()[:7], "little")
        while not _lock_byte(claims, place):
            heed_signals()
            time.sleep(_CLAIM_POLL_S)
        try:
            yield
        finally:
            fcntl.lockf(claims, fcntl.LOCK_UN, 1, place)

    def heal(self, *also: str) -> None:
        """Delete all damaged files, and those named; say once that there were any."""
        with self._locked():
            damaged = [path for path in self._files() if not self._is_whole(path.name)]
            damaged += [path for name in also if (path := self.path / name).exists()]
            for path in damaged:
                _delete(path)
        if damaged:
            what = "1 file" if len(damaged) == 1 else f"{len(damaged)} files"
            self._say("was damaged", f"{what} deleted, to be compiled anew")

    def _claims(self) -> int | None:
        """Return the descriptor of the file whose bytes stand for claims; None if there is none."""
        try:
            self._make()
            return _open_claims(self.path / "claims")
        except OSError:
            return None

    def _enter(self) -> None:
        """Check the folder at its first use, and note that it is used."""
        if not self._is_known:
            self.check()
            self._is_known = True
            with contextlib.suppress(OSError):
                os.utime(self.path)

    def _make(self) -> None:
        if not self.path.is_dir():
            self.path.parent.parent.mkdir(parents=True, exist_ok=True)
            self.path.parent.mkdir(mode=0o700, exist_ok=True)
            self.check()
            with contextlib.suppress(FileExistsError):  # by another process, or it is not a folder
                self.path.mkdir(mode=0o700)
            if not self.path.is_dir():
                self.path.unlink(missing_ok=True)
                self.path.mkdir(mode=0o700, exist_ok=True)
            self._tidy()
        self.check()
        if not self._is_swept:
            self._is_swept = True
            self._sweep()

    def _read(self, name: str) -> bytes:
        """Return a file's content; ValueError if it is damaged."""
        data = (self.path / name).read_bytes()
        start = len(_MAGIC) + _DIGEST_BYTES
        code = data[start:]
        if data[:start] != _MAGIC + _checksum(name, code):
            raise ValueError("damaged")
        return code

    def _write(self, name: str, code: bytes) -> None:
        descriptor, unfinished = tempfile.mkstemp(_UNFINISHED, ".", self.path)
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(_MAGIC + _checksum(name, code))
                file.write(code)
            Path(unfinished).replace(self.path / name)
        except BaseException:
            Path(unfinished).unlink(missing_ok=True)
            raise

    def _files(self) -> Iterator[Path]:
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            yield from sorted(self.path.glob(f"*{_ENDING}"))

    def _is_whole(self, name: str) -> bool:
        try:
            self._read(name)
        except FileNotFoundError:
            return True  # another process has healed it
        except (OSError, ValueError):
            return False
        return True

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        """Let one process at a time look for damage, so that one line says it."""
        try:
            file = (self.path / "lock").open("a")
        except OSError:
            yield
            return
        with file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield

    def _say(self, what: str, more: str) -> None:
        """Tell the user something about the folder, once."""
        if what not in self._said:
            self._said.add(what)
            _log.warning("compiled code in %s %s: %s", self.path, what, more)

    def _tidy(self) -> None:
        """Delete the folders of former sources, except for the last ones."""
        now = time.time()
        former = [
            (entry.stat().st_mtime, entry.path)
            for entry in os.scandir(self.path.parent)
            if _NAME_OF_FOLDER.fullmatch(entry.name) and entry.path != str(self.path)
        ]
        for used, path in sorted(former, reverse=True)[_KEPT:]:
            if now - used > _KEPT_S:
                shutil.rmtree(path, ignore_errors=True)

    def _sweep(self) -> None:
        """Delete what processes that were killed have not finished."""
        for path in self.path.glob(f".*{_UNFINISHED}"):
            with contextlib.suppress(FileNotFoundError):
                if time.time() - path.stat().st_mtime > _STALE_S:
                    path.unlink()


def name_of_code(function: str, key: str) -> str:
    """Return the name of the file for a function with a key: signature, processor, source."""
    return f"{function}-{hashlib.sha256(key.encode()).hexdigest()[:32]}{_ENDING}"


@functools.cache
def _open_claims(path: Path) -> int:
    # Never closed: that would let go of all claims of this process.
    return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)


def forget_claims() -> None:
    """Open the files of claims anew: what a process does that has closed what it inherited."""
    _open_claims.cache_clear()


def _lock_byte(descriptor: int, place: int) -> bool:
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, place)
    except BlockingIOError:
        return False
    return True


def _delete(path: Path) -> None:
    with contextlib.suppress(OSError):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
