"""Where a channel is, who may enter, and who hosts it."""

from __future__ import annotations

import os
import signal
import socket
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import pytest

from rrins.host_tools.bus.channel import Claim, Reservation, detect, socket_path
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.errors import BusError


def test_a_name_is_a_socket_in_the_runtime_directory(runtime_directory: Path) -> None:
    assert socket_path("vehicle-1") == runtime_directory / "rrins" / "vehicle-1.sock"


def test_without_runtime_directory_it_is_in_the_temporary_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for value in ("", "/nonexistent/runtime"):
        monkeypatch.setenv("XDG_RUNTIME_DIR", value)
        assert socket_path("a").parent.name == f"rrins-{os.geteuid()}"


@pytest.mark.parametrize("name", ["", ".hidden", "two words", "a" * 65, "umläut", "new\nline"])
def test_what_is_no_name_is_refused(name: str) -> None:
    with pytest.raises(BusError, match="not a channel name"):
        socket_path(name)
    with pytest.raises(can.CanInitializationError, match="not a channel name"):
        RrinsBus(name)


def test_a_path_too_long_for_a_socket_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BusError, match="107: use a shorter"):
        socket_path(str(tmp_path / ("x" * 100)))


def test_a_slash_makes_it_a_path(runtime_directory: Path) -> None:
    path = runtime_directory / "own.sock"
    with RrinsBus(str(path), host="here"):
        assert path.is_socket()
    assert list(runtime_directory.iterdir()) == []


def test_only_the_owner_may_enter(runtime_directory: Path) -> None:
    with RrinsBus("test", host="here"):
        directory = runtime_directory / "rrins"
        modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in directory.iterdir()}
        assert modes == {"test.sock": 0o600, "test.sock.lock": 0o600}
        assert stat.S_IMODE(directory.stat().st_mode) == 0o700
    assert list(directory.iterdir()) == []


def test_a_directory_open_to_others_is_refused(runtime_directory: Path) -> None:
    (runtime_directory / "rrins").mkdir(mode=0o755)
    with pytest.raises(BusError, match=r"open to others.*chmod 700"):
        Claim("test")
    with pytest.raises(can.CanInitializationError, match=r"open to others.*chmod 700"):
        RrinsBus("test")


def test_a_directory_that_is_a_link_is_refused(runtime_directory: Path) -> None:
    (runtime_directory / "real").mkdir(mode=0o700)
    (runtime_directory / "rrins").symlink_to("real")
    with pytest.raises(BusError, match="rrins is not a folder"):
        Claim("test")


def test_a_file_that_is_no_socket_is_left_alone(runtime_directory: Path) -> None:
    path = runtime_directory / "precious.txt"
    path.write_text("data")
    with pytest.raises(BusError, match="is not a socket"):
        Claim(str(path))
    assert path.read_text() == "data"
    assert list(runtime_directory.iterdir()) == [path]


def test_a_live_host_is_not_replaced(runtime_directory: Path) -> None:
    claim = Claim("test")
    with pytest.raises(BusError, match=f"'test' is already hosted by process {os.getpid()}"):
        Claim("test")
    claim.release()
    Claim("test").release()


def test_who_looks_for_a_free_channel_at_the_same_time_takes_another(
    runtime_directory: Path,
) -> None:
    with RrinsBus("own1", host="here"), Reservation("own") as first:
        with Reservation("own") as second:
            assert (first.channel, second.channel) == ("own0", "own2")
            RrinsBus(first.channel, host="here").shutdown()  # its place is for whoever names it
        with Reservation("own") as third:
            assert third.channel == "own2"
    with Reservation("own") as again:
        assert again.channel == "own0"
    assert list((runtime_directory / "rrins").iterdir()) == []


def test_the_socket_of_a_killed_host_is_replaced(runtime_directory: Path, player: Any) -> None:
    player.ask("open", channel="test", host="here")
    os.kill(player.pid, signal.SIGKILL)
    player.end()
    assert (runtime_directory / "rrins" / "test.sock").is_socket()
    with pytest.raises(can.CanInitializationError, match="nobody hosts it"):
        RrinsBus("test", host="never")
    assert detect() == []
    with RrinsBus("test", host="here"):
        assert detect() == ["test"]


def test_auto_replaces_the_socket_of_a_killed_host(player: Any) -> None:
    player.ask("open", channel="test", host="here")
    os.kill(player.pid, signal.SIGKILL)
    player.end()
    with RrinsBus("test") as bus:
        assert bus.host_pid != player.pid


def test_hosted_channels_are_detected(
    runtime_directory: Path, attach_to: Callable[..., RrinsBus]
) -> None:
    assert detect() == []
    with RrinsBus("b", host="here") as host, RrinsBus("a", host="here"):
        (runtime_directory / "rrins" / "c.sock").touch()
        stale = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        stale.bind(str(runtime_directory / "rrins" / "d.sock"))
        stale.close()
        assert RrinsBus._detect_available_configs() == [
            {"interface": "rrins", "channel": "a"},
            {"interface": "rrins", "channel": "b"},
        ]
        attach_to(host)  # somebody who only looked does no harm


def test_a_host_that_does_not_answer_is_an_error() -> None:
    claim = Claim("test")
    try:
        with pytest.raises(can.CanInitializationError, match=r"has not answered for 0\.05 s"):
            RrinsBus("test", host="never", attach_timeout=0.05)
    finally:
        claim.release()
