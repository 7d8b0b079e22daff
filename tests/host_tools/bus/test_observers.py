"""Whoever only looks on neither slows a rehearsal nor changes what it navigates."""

from __future__ import annotations

import json
import re
import socket
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import pytest

from rrins.dbc.frame import frame_array
from rrins.host_tools.bus.interface import RrinsBus
from tests.processes import Fork

SCENARIO = ("rimu_rotating", "--duration", "120")
CHANNEL = "test"


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The same scenario without a bus."""
    folder = tmp_path_factory.mktemp("reference")
    words = ["rrins", "simulate", *SCENARIO, "--json"]
    with Fork(words, stdout=subprocess.PIPE, cwd=folder) as simulated:
        return json.load(simulated.stdout)


@pytest.fixture
def rehearse(start: Callable[..., Any]) -> Callable[..., Any]:
    """Start a rehearsal in lockstep, as fast as it goes."""

    def starter(*arguments: Any) -> Any:
        command = start("rehearse", *SCENARIO, "--channel", CHANNEL, "--out", "out", *arguments)
        command.wait_for_line("running")
        return command

    return starter


def summary(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "out" / "summary.json").read_text())


def assert_same_navigation(rehearsed: dict[str, Any], reference: dict[str, Any]) -> None:
    assert rehearsed["navigation_sha256"] == reference["navigation_sha256"]
    assert rehearsed["epochs"] == reference["epochs"]
    assert rehearsed["frames_lost"] == 0


def attach(name: str) -> RrinsBus:
    return RrinsBus(CHANNEL, host="never", role="observer", name=name)


def test_a_monitor_and_a_client_of_socketcand_that_hang(
    rehearse: Callable[..., Any],
    start: Callable[..., Any],
    reference: dict[str, Any],
    tmp_path: Path,
) -> None:
    command = rehearse()
    with attach("monitor") as monitor:
        # It does not receive from now on. What waits for it is more than its queue takes.
        with command.paused():
            server = start("socketcand", "--channel", CHANNEL, "--port", 0)
            server.wait_for_line("Ctrl-C stops")
        found = re.search(r"port (\d+)", server.said[-1])
        assert found is not None
        with socket.create_connection(("127.0.0.1", int(found[1])), 10.0) as client:
            for words in (b"< open test >", b"< rawmode >"):
                assert client.recv(64).endswith(b" >")
                client.sendall(words)
            assert client.recv(64).startswith(b"< ok >")
            # Nor does this one.
            assert command.finish()[0] == 0
        assert server.finish()[0] == 0
        frames, received = frame_array(64), 0

        def receive_all() -> None:
            nonlocal received
            while batch := monitor.recv_batch(frames, 120.0):
                received += batch.count

        with pytest.raises(can.CanOperationError):
            receive_all()
    rehearsed = summary(tmp_path)
    assert_same_navigation(rehearsed, reference)
    assert rehearsed["completed"]
    sent = rehearsed["firmware"]["frames_sent"] + rehearsed["hardware"]["frames_sent"]
    assert 0 < received < sent


@pytest.mark.parametrize("ending", [".log", ".db"])
def test_a_recorder_whose_disk_is_full(
    rehearse: Callable[..., Any], reference: dict[str, Any], tmp_path: Path, ending: str
) -> None:
    record = tmp_path / f"bus{ending}"
    record.symlink_to("/dev/full")
    command = rehearse("--record", record)
    assert command.finish()[0] == 6, command.said
    assert (tmp_path / "out").exists(), command.said
    assert_same_navigation(summary(tmp_path), reference)
    told = [line for line in command.said if line.startswith("rrins: ")]
    assert len(told) == 1
    assert told[0].startswith(f"rrins: recording {record}: stopped after ")
    assert "full" in told[0] or "No space left" in told[0]
    assert not any("Traceback" in line for line in command.said)


def test_many_attach_and_detach(
    rehearse: Callable[..., Any], reference: dict[str, Any], tmp_path: Path
) -> None:
    command = rehearse("--speed", "40")
    frames = frame_array(64)
    for visit in range(30):
        with attach(f"visitor-{visit}") as visitor:
            batch = visitor.recv_batch(frames, 120.0)
            assert batch is not None
            assert batch.count > 0
    assert command.process.poll() is None, "it was over before the last visit"
    assert command.finish()[0] == 0
    rehearsed = summary(tmp_path)
    assert_same_navigation(rehearsed, reference)
    assert rehearsed["completed"]
