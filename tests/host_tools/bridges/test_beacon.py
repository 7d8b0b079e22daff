"""The discovery beacon, with python-can's own listener and as SavvyCAN reads it."""

from __future__ import annotations

import asyncio
import socket
from concurrent.futures import ThreadPoolExecutor
from xml.etree import ElementTree

import can
import pytest
from can.interfaces.socketcand import socketcand as client

from rrins.host_tools.bridges.beacon import send_beacons, text_of


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        port: int = probe.getsockname()[1]
        return port


def test_python_can_finds_the_channel(monkeypatch: pytest.MonkeyPatch) -> None:
    port = free_port()
    monkeypatch.setattr(client, "DEFAULT_SOCKETCAND_DISCOVERY_PORT", port)

    async def listen() -> list[can.typechecking.AutoDetectedConfig]:
        sending = asyncio.create_task(send_beacons("rrins0", "127.0.0.1", 29536, port))
        try:
            with ThreadPoolExecutor(1) as pool:
                return await asyncio.get_running_loop().run_in_executor(pool, client.detect_beacon)
        finally:
            sending.cancel()

    assert asyncio.run(listen()) == [
        {"interface": "socketcand", "host": "127.0.0.1", "port": 29536, "channel": "rrins0"}
    ]


def test_it_reads_as_the_beacon_of_socketcand_does() -> None:
    root = ElementTree.fromstring(text_of("rrins0", "127.0.0.1", 29536))
    assert (root.tag, root.get("name")) == ("CANBeacon", "rrins")
    assert [(child.tag, child.text or child.get("name")) for child in root] == [
        ("URL", "can://127.0.0.1:29536"),
        ("Bus", "rrins0"),
    ]
