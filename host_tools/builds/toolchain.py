"""The C cross compiler that links what is built: zig, with a C library for every target."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from rrins.host_tools.errors import BuildError


def is_installed() -> bool:
    """Return whether there is one."""
    return importlib.util.find_spec("ziglang") is not None


def check() -> None:
    """Raise BuildError unless it is installed."""
    if not is_installed():
        raise BuildError("linking needs a C cross compiler: pip install 'rrins[build]'")


def zig(*words: str | Path) -> None:
    """Run zig.

    Raises
    ------
    BuildError
        When it is not installed, or refuses.
    """
    check()
    command = [sys.executable, "-m", "ziglang", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        lines = (done.stderr or done.stdout).strip().splitlines() or ["no reason given"]
        reason = next((line for line in lines if "error" in line), lines[0])
        raise BuildError(f"zig {words[0]} has failed: {reason}")


def archive(path: Path, objects: Sequence[Path]) -> None:
    """Make a static library."""
    path.unlink(missing_ok=True)
    zig("ar", "rcs", path, *objects)
