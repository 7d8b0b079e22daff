"""The cache of compiled code between runs.

numba caches a function's machine code until the function's own file changes; it misses changes in
other files, such as constants and inlined functions. So the code is cached in a folder named after
a digest of all sources, under the user's cache folder, and is never stale.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar, cast

import numba

_ROOMS = ("dbc", "firmware_py/core", "host_tools/hardware", "host_tools/wire")
_F = TypeVar("_F", bound=Callable[..., object])
_KEPT = 4
"""Cache folders of former sources to keep, for a return to those sources."""


def _digest() -> str:
    """Return a digest of the compiler and of the sources of all rooms with compiled code."""
    digest = hashlib.sha256(numba.__version__.encode())
    root = Path(__file__).parent.parent
    for room in _ROOMS:
        for path in sorted((root / room).rglob("*.py")):
            digest.update(str(path.relative_to(root)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def keep_compiled_code() -> None:
    """Make numba cache compiled code by the content of the sources.

    A NUMBA_CACHE_DIR set by the user takes precedence.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rrins"
    folder = base / _digest()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return  # read-only home: numba caches next to the sources, or nowhere
    os.utime(folder)
    vars(numba.config)["CACHE_DIR"] = str(folder)
    former = sorted(base.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
    for path in former[1 + _KEPT :]:
        shutil.rmtree(path, ignore_errors=True)


def compiled(function: _F) -> _F:
    """Compile a function of a step at its first call; its machine code is cached."""
    return cast(_F, numba.njit(cache=True)(function))
