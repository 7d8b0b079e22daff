"""A C compiler for the clients, and a bus of their own."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CLIENT = ROOT / "clients" / "c"
STRICT = ("-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror")
SANITIZED = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")


@pytest.fixture(scope="session")
def build(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path], Path]:
    """Compile a program with the client; warnings are errors, faults end it."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    folder = tmp_path_factory.mktemp("clients")

    def compiled(source: Path) -> Path:
        program = folder / source.stem
        subprocess.run(
            [
                *("gcc", *STRICT, *SANITIZED, f"-I{CLIENT}", source, CLIENT / "rrins_bus.c"),
                *("-o", program),
            ],
            check=True,
        )
        return program

    return compiled
