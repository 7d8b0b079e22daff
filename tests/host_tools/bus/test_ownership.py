"""A bus belongs to one user: folders, hosts and peers of others are refused, in one line each."""

from __future__ import annotations

import logging
import os
import select
import socket
import stat
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import pytest
from click.testing import CliRunner

from rrins.dbc.frame import frame_array
from rrins.host_tools.bus import admission, ownership
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.channel import connect, detect
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.bus.port import open_bus
from rrins.host_tools.cli.main import rrins
from rrins.host_tools.errors import BusError

STRANGER = 54_321
"""A user that is not ours; it needs no entry in the table of users."""

PYTHONS = (str(Path(sys.executable).resolve()), "/usr/bin/python3")
"""A Python that another user can probably run: ours may be in a closed home."""

needs_root = pytest.mark.skipif(
    os.geteuid() != 0, reason="only root can run a process as another user"
)

HOST = """
    import os, socket, sys
    folder = sys.argv[1]
    os.mkdir(folder)
    os.chmod(folder, 0o777)
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listener.bind(folder + "/rrins0.sock")
    os.chmod(folder + "/rrins0.sock", 0o777)
    listener.listen()
    print("ready", flush=True)
    while True:
        end = listener.accept()[0]
        print(len(end.recv(1000)), flush=True)
        end.close()
"""

PEER = """
    import socket, sys
    end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    end.connect(sys.argv[1])
    print("connected", flush=True)
    try:
        end.send(bytes.fromhex(sys.argv[2]))
    except BrokenPipeError:
        pass
    print(end.recv(1000)[32:].decode(), flush=True)
"""


@pytest.fixture
def temporary(monkeypatch: pytest.MonkeyPatch, runtime_directory: Path) -> Iterator[Path]:
    """A temporary directory as all users share it, and no runtime directory."""
    with tempfile.TemporaryDirectory(prefix="rr-") as name:
        Path(name).chmod(0o1777)
        monkeypatch.delenv("XDG_RUNTIME_DIR")
        monkeypatch.setattr(tempfile, "tempdir", name)
        yield Path(name)


@pytest.fixture
def folder(temporary: Path) -> Path:
    """Where our channels are then."""
    return temporary / f"rrins-{os.geteuid()}"


@pytest.fixture
def as_stranger() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Run a few lines of Python as another user."""
    processes: list[subprocess.Popen[str]] = []

    def run(text: str, *arguments: str) -> subprocess.Popen[str]:
        for python in PYTHONS:
            try:
                process = subprocess.Popen(
                    [python, "-I", "-S", "-c", textwrap.dedent(text), *arguments],
                    stdout=subprocess.PIPE,
                    text=True,
                    cwd="/",
                    user=STRANGER,
                    group=STRANGER,
                    extra_groups=[],
                )
            except (PermissionError, FileNotFoundError):
                continue
            processes.append(process)
            return process
        pytest.skip(f"another user may run neither {' nor '.join(PYTHONS)}")

    yield run
    for process in processes:
        process.kill()
        process.communicate()


def refusal(**arguments: Any) -> str:
    """Return the line with which the bus is refused, the same whoever asks."""
    with pytest.raises(BusError) as error:
        open_bus(Address("rrins", "rrins0"), **arguments)
    assert error.value.exit_status == 4
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("host", ["never", "auto", "here"])
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o755])
def test_a_folder_that_others_can_enter_is_refused(folder: Path, mode: int, host: str) -> None:
    folder.mkdir()
    folder.chmod(mode)
    assert f"{folder} is open to others: run 'chmod 700 {folder}'" in refusal(host=host)
    assert list(folder.iterdir()) == []


@needs_root
@pytest.mark.parametrize("host", ["never", "auto", "here"])
def test_a_folder_of_another_user_is_refused(folder: Path, host: str) -> None:
    folder.mkdir(mode=0o700)
    os.chown(folder, STRANGER, STRANGER)
    assert f"{folder} belongs to another user (uid {STRANGER})" in refusal(host=host)
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("host", ["never", "auto", "here"])
def test_a_folder_of_another_user_is_refused_whoever_we_are(
    folder: Path, host: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder.mkdir(mode=0o700)
    ours = os.geteuid()
    monkeypatch.setattr(ownership.os, "geteuid", lambda: STRANGER)
    folder.rename(folder.with_name(f"rrins-{STRANGER}"))
    assert f"belongs to another user (uid {ours})" in refusal(host=host)


def test_commands_end_with_status_4_and_one_line(folder: Path) -> None:
    folder.mkdir()
    folder.chmod(0o777)
    result = CliRunner().invoke(rrins, ["monitor", "--once"])
    assert result.exit_code == 4
    assert result.stdout == ""
    assert [line.partition(":")[0] for line in result.stderr.splitlines()] == ["rrins"]
    assert "is open to others" in result.stderr


@needs_root
def test_whoever_takes_our_folder_first_is_not_our_host(
    folder: Path, as_stranger: Callable[..., subprocess.Popen[str]]
) -> None:
    stranger = as_stranger(HOST, str(folder))
    assert stranger.stdout is not None
    assert stranger.stdout.readline() == "ready\n"
    assert detect() == []
    for host in ("never", "auto", "here"):
        assert f"belongs to another user (uid {STRANGER})" in refusal(host=host)
    assert not select.select([stranger.stdout], [], [], 0)[0]  # nobody has called


@needs_root
def test_the_host_of_another_user_is_refused_before_a_word_is_said(
    folder: Path, as_stranger: Callable[..., subprocess.Popen[str]]
) -> None:
    stranger = as_stranger(HOST, str(folder))
    assert stranger.stdout is not None
    assert stranger.stdout.readline() == "ready\n"
    folder.chmod(0o700)
    os.chown(folder, os.geteuid(), -1)  # the folder is ours again; what lies in it is not
    assert f"hosted by process {stranger.pid} of another user (uid {STRANGER})" in refusal(
        host="never"
    )
    assert stranger.stdout.readline() == "0\n"


def test_a_host_of_another_user_is_refused(
    runtime_directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with RrinsBus("rrins0", host="here"):
        assert detect() == ["rrins0"]
        somebody = (4711, os.geteuid() + 1)
        monkeypatch.setattr(ownership, "credentials", lambda end: somebody)
        assert "hosted by process 4711 of another user" in refusal(host="never")
        with pytest.raises(BusError, match="of another user"):
            connect(str(runtime_directory / "rrins" / "rrins0.sock"), 1.0)


def test_root_may_host_for_all_and_attach_to_all(monkeypatch: pytest.MonkeyPatch) -> None:
    assert ownership.may_attach(0)
    assert ownership.may_attach(os.geteuid())
    assert not ownership.may_attach(os.geteuid() + 1)


@needs_root
def test_root_may_name_the_socket_of_another_user(
    temporary: Path, as_stranger: Callable[..., subprocess.Popen[str]]
) -> None:
    place = temporary / "theirs"
    stranger = as_stranger(HOST, str(place))
    assert stranger.stdout is not None
    assert stranger.stdout.readline() == "ready\n"
    connect(str(place / "rrins0.sock"), 1.0).close()
    os.chown(place / "rrins0.sock", STRANGER + 1, -1)  # not even the one who is meant
    with pytest.raises(BusError, match=f"of another user \\(uid {STRANGER}\\)"):
        connect(str(place / "rrins0.sock"), 1.0)


@needs_root
def test_a_peer_of_another_user_is_turned_away(
    temporary: Path,
    as_stranger: Callable[..., subprocess.Popen[str]],
    caplog: pytest.LogCaptureFixture,
) -> None:
    path = temporary / "open.sock"
    with RrinsBus(str(path), host="here") as host:
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        path.chmod(0o777)  # the owner has opened the door: the host still looks who comes
        stranger = as_stranger(PEER, str(path), bytes(32).hex())
        assert stranger.stdout is not None
        assert stranger.stdout.readline() == "connected\n"
        with caplog.at_level(logging.WARNING, "rrins.host_tools.bus"):
            while not caplog.records:
                host.recv_batch(frame_array(1), 0.05)
        assert "the bus belongs to another user" in stranger.stdout.readline()
        assert host.peers == ()
    assert [record.message for record in caplog.records] == [
        f"turned away process {stranger.pid}: it belongs to another user (uid {STRANGER})"
    ]


def test_a_caller_of_another_user_is_turned_away(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    with RrinsBus("test", host="here") as host, connect("test", 1.0) as end:
        somebody = (4711, os.geteuid() + 1)
        monkeypatch.setattr(admission, "credentials", lambda end: somebody)
        with caplog.at_level(logging.WARNING, "rrins.host_tools.bus"):
            host.recv_batch(frame_array(1), 0)
        assert b"the bus belongs to another user" in end.recv(1000)
        assert host.peers == ()
    assert [record.message for record in caplog.records] == [
        f"turned away process 4711: it belongs to another user (uid {os.geteuid() + 1})"
    ]


def test_python_can_finds_nothing_in_an_unsafe_place(folder: Path) -> None:
    folder.mkdir()
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with listener:
        listener.bind(str(folder / "rrins0.sock"))
        listener.listen()
        folder.chmod(0o777)
        assert can.detect_available_configs("rrins") == []
