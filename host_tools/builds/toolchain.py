"""The C compilers that link what is built.

zig has a C library for every target, musl on Linux. The machine's own has the mathematics that
Python uses there, to the last bit.
"""

from __future__ import annotations

import functools
import importlib.util
import platform
import shutil
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
    _run(f"zig {words[0]}", sys.executable, "-m", "ziglang", *words)


def link(system: str, *words: str | Path) -> None:
    """Compile and link a program: by the machine's own compiler for a system that is its own.

    Raises
    ------
    BuildError
        When the compiler refuses.
    """
    if links_own_programs(system):
        _run("gcc", "gcc", "-static", *words, "-Wno-error")  # another version may warn of more
    else:
        zig("cc", "-target", system, *words)


@functools.cache
def links_own_programs(system: str) -> bool:
    """Return whether this machine runs programs of a system, and gcc links static ones for it."""
    gcc = shutil.which("gcc")
    if gcc is None or not system.startswith(f"{platform.machine()}-linux-"):
        return False
    trial = [gcc, "-static", "-x", "c", "-", "-lm", "-o", "/dev/null"]
    text = b"int main(void) { return 0; }"
    return subprocess.run(trial, input=text, capture_output=True, check=False).returncode == 0


def _run(name: str, *words: str | Path) -> None:
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        lines = (done.stderr or done.stdout).strip().splitlines() or ["no reason given"]
        reason = next((line for line in lines if "error" in line), lines[0])
        raise BuildError(f"{name} has failed: {reason}")


def archive(path: Path, objects: Sequence[Path]) -> None:
    """Make a static library."""
    path.unlink(missing_ok=True)
    zig("ar", "rcs", path, *objects)
