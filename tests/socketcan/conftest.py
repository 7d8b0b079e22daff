"""All tests here need vcan0: without it they are skipped, or fail where it was promised."""

from __future__ import annotations

import multiprocessing
import os
import socket
import sys
from collections.abc import Callable
from multiprocessing.process import BaseProcess
from pathlib import Path

import pytest


@pytest.fixture(scope="session", autouse=True)
def _vcan0():
    if "vcan0" in [name for _, name in socket.if_nameindex()]:
        return
    if "RRINS_REQUIRE_SOCKETCAN" in os.environ:
        pytest.fail("the kernel has no vcan0")
    pytest.skip("the kernel has no vcan0")


def forked(main: Callable[[], object], words: list[str], said: Path) -> BaseProcess:
    """Start a program as a fork of the tests, whose imports take an emulated machine 20 s.

    What it says, on either stream, goes to the file `said`.
    """

    def run() -> None:
        os.setsid()
        with said.open("wb") as file:
            os.dup2(file.fileno(), 1)
            os.dup2(file.fileno(), 2)
        sys.stdout, sys.stderr = sys.__stdout__, sys.__stderr__
        sys.argv = words
        main()

    process = multiprocessing.get_context("fork").Process(target=run)
    process.start()
    return process
