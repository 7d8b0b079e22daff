"""The C firmware, built once: warnings are errors, the sanitizers end it at the first fault."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

OWN_FIRMWARE = Path(__file__).parents[2] / "examples" / "own_firmware"
SANITIZED = "-O1 -g -fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all"

Make = Callable[..., str]


@pytest.fixture(scope="session")
def make_firmware() -> Make:
    """Return a function that runs make for the C firmware, with its products in a folder."""
    for tool in ("gcc", "make"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")

    def make(folder: Path, *words: str, flags: str = SANITIZED) -> str:
        done = subprocess.run(
            [
                *("make", "-C", str(OWN_FIRMWARE), f"PYTHON={sys.executable}"),
                *(f"BUILD={folder / 'build'}", f"PROGRAM={folder / 'own_firmware'}"),
                *(f"CFLAGS={flags}", *words),
            ],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return make


@pytest.fixture(scope="session")
def own_firmware(make_firmware: Make, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the C firmware, built with the sanitizers."""
    folder = tmp_path_factory.mktemp("own_firmware")
    make_firmware(folder, str(folder / "own_firmware"))
    return folder / "own_firmware"
