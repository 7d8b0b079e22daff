"""Where compiled code is kept between runs.

numba keeps a function's machine code until the function's own file changes; that another file
changed, a constant or a function that was inlined, it does not see. So the code is kept in a folder
named after the content of all sources, under the user's cache folder, and is never stale.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from pathlib import Path

import numba

_ROOMS = ("dbc", "firmware_py", "host_tools/hardware", "host_tools/bus")
_KEPT = 4
"""Folders of former sources that are left for whoever goes back to them."""


def _digest() -> str:
    """Return a digest of the sources of all rooms with compiled code, and of the compiler."""
    digest = hashlib.sha256(numba.__version__.encode())
    root = Path(__file__).parent.parent
    for room in _ROOMS:
        for path in sorted((root / room).rglob("*.py")):
            digest.update(str(path.relative_to(root)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def keep_compiled_code() -> None:
    """Let numba keep compiled code by the content of the sources.

    NUMBA_CACHE_DIR, when the user has set it, is left alone.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rrins"
    folder = base / _digest()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return  # a read-only home: numba finds a place beside the sources, or none
    os.utime(folder)
    vars(numba.config)["CACHE_DIR"] = str(folder)
    former = sorted(base.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
    for path in former[1 + _KEPT :]:
        shutil.rmtree(path, ignore_errors=True)
