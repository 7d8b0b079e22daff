"""All tests here need vcan0: without it they are skipped, or fail where it was promised."""

from __future__ import annotations

import os
import socket

import pytest


@pytest.fixture(scope="session", autouse=True)
def _vcan0():
    if "vcan0" in [name for _, name in socket.if_nameindex()]:
        return
    if "RRINS_REQUIRE_SOCKETCAN" in os.environ:
        pytest.fail("the kernel has no vcan0")
    pytest.skip("the kernel has no vcan0")
