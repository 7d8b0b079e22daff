"""Settings for every test."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
from collections.abc import Callable

import pytest
from hypothesis import settings

# The first example of a property may compile code.
settings.register_profile("rrins", deadline=None)
settings.load_profile("rrins")

# A shell that starts the tests in the background has them ignore Ctrl-C, and what they start, too.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# What tests start writes bytecode: without, each process compiles all modules for half a second.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

_UNEXPLAINED = re.compile(
    r"Traceback|needs to be investigated|Mamma mia|Retries exceeded|: timeout\b", re.IGNORECASE
)


@pytest.fixture(scope="session")
def gallia() -> Callable[..., str]:
    """Return what scans a target with gallia and returns what it said.

    It fails when gallia met something that it cannot explain. RRINS_GALLIA names the program;
    without it, it is looked for in PATH.
    """
    program = os.environ.get("RRINS_GALLIA") or shutil.which("gallia")
    if program is None:
        if "RRINS_REQUIRE_SOCKETCAN" in os.environ:
            pytest.fail("needs gallia")
        pytest.skip("needs gallia")

    def scan(target: str, *words: str) -> str:
        done = subprocess.run(
            [
                *(program, "scan", "uds", *words, "--target", target, "--timeout", "20"),
                *("--no-dumpcap", "--no-volatile-info"),
            ],
            capture_output=True,
            text=True,
            check=False,
            env=os.environ | {"NO_COLOR": "1"},
        )
        said = done.stdout + done.stderr
        assert done.returncode == 0, said[-5000:]
        assert not _UNEXPLAINED.search(said), said[-5000:]
        return said

    return scan
