"""Sources and libraries that a row depends on, besides its numbers."""

from __future__ import annotations

import functools
import hashlib
import platform
import sys
from importlib import metadata
from pathlib import Path
from typing import Final

_ROOMS: Final = (
    "dbc",
    "rrins/compiled",
    "firmware_py",
    "host_tools/campaigns",
    "host_tools/hardware",
    "host_tools/motion",
    "host_tools/runs",
    "host_tools/scenario",
    "host_tools/wire",
)
_KINDS: Final = (".py", ".dbc", ".toml")


@functools.cache
def sources_digest() -> str:
    """Return a digest of all sources that a row depends on."""
    digest = hashlib.sha256()
    root = Path(__file__).parents[2]
    for room in _ROOMS:
        for path in sorted((root / room).rglob("*")):
            if path.suffix in _KINDS and path.is_file():
                digest.update(path.relative_to(root).as_posix().encode() + b"\0")
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@functools.cache
def versions() -> dict[str, str]:
    """Return the versions of what the sources run on, and the kind of processor."""
    return {
        "rrins": metadata.version("rrins"),
        "python": f"{sys.version_info.major}.{sys.version_info.minor}",
        **{name: metadata.version(name) for name in ("numpy", "scipy", "numba", "llvmlite")},
        "machine": platform.machine(),
    }
