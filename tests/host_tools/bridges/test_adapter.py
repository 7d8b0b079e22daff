"""The LAWICEL protocol of an emulated adapter, command by command."""

from __future__ import annotations

import pytest

from rrins.host_tools.bridges.adapter import Adapter


@pytest.fixture
def sent():
    return []


@pytest.fixture
def adapter(sent):
    return Adapter(lambda command: sent.append(command) or True)


def ask(adapter, command):
    """Return the answer to commands."""
    adapter.feed(command + b"\r")
    answer = bytes(adapter.out)
    adapter.out.clear()
    return answer


@pytest.mark.parametrize(
    "command", [b"t12", b"t1239", b"t1232AB", b"t1231GG", b"x", b"S9", b"T123", b"r1230FF", b"Z2"]
)
def test_the_bell_rings_at_what_is_no_command(adapter, sent, command):
    ask(adapter, b"S8\rO")
    assert ask(adapter, command) == b"\a"
    assert sent == []


def test_a_closed_channel_carries_nothing(adapter, sent):
    assert ask(adapter, b"S8\rt1230") == b"\r\a"
    adapter.hear(b"t1230")
    assert adapter.out == b""
    assert ask(adapter, b"O\rt1230") == b"\rz\r"
    assert sent == [b"t1230"]
    adapter.hear(b"t7FF1AA")
    assert adapter.out == b"t7FF1AA\r"


def test_commands_of_common_programs_are_obeyed(adapter):
    """Openings of slcand, of python-can and of SavvyCAN, of a closed channel or an open one."""
    assert ask(adapter, b"C\rS6\rO") == b"\a\r\r"
    assert ask(adapter, b"C\rS8\r\rO\rO") == b"\r\r\r\r\a"
    assert ask(adapter, b"C\rs031C\rO") == b"\r\r\r"
    assert ask(adapter, b"V\rN\rF") == b"V1013\rNEMUL\rF00\r"


def test_a_listener_cannot_send(adapter, sent):
    assert ask(adapter, b"S8\rL\rt1230") == b"\r\r\a"
    assert sent == []


def test_times_are_milliseconds_of_a_minute(adapter):
    ask(adapter, b"Z1\rO")
    adapter.hear(b"T000001232BEEF", 60_000 + 0x1234)
    assert adapter.out == b"T000001232BEEF1234\r"


def test_a_bus_without_room_rings_the_bell():
    assert ask(Adapter(lambda command: False), b"O\rt1230") == b"\r\a"
