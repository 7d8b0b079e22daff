"""The bus by the socketcand protocol: with python-can's own client, and word by word."""

from __future__ import annotations

import json
import os
import re
import select
import signal
import socket
import time
from collections.abc import Callable, Iterator
from typing import Any

import can
import pytest

from rrins.dbc.frame import frame_array
from rrins.host_tools.bridges.socketcand import (
    MOST_CLIENTS,
    QUEUE_LIMIT,
    serve,
)
from rrins.host_tools.bridges.socketcand_words import CommandError, identifier_of, number_of
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.errors import BusError

Connect = Callable[..., Any]


class Talk:
    """A client that says and hears single words of the protocol."""

    def __init__(self, port: int) -> None:
        self._end = socket.create_connection(("127.0.0.1", port), 10.0)
        self._heard = b""

    def say(self, text: str | bytes) -> None:
        self._end.sendall(text if isinstance(text, bytes) else text.encode())

    def hear(self) -> str:
        """Return the next answer; empty when the connection is over."""
        while b">" not in self._heard:
            try:
                data = self._end.recv(65536)
            except ConnectionResetError:
                return ""
            if not data:
                return ""
            self._heard += data
        answer, self._heard = self._heard.split(b">", 1)
        return answer.decode() + ">"

    def ask(self, text: str) -> str:
        self.say(text)
        return self.hear()

    def close(self) -> None:
        self._end.close()


@pytest.fixture
def bus() -> Iterator[RrinsBus]:
    """A node on a bus that a process of its own hosts."""
    with RrinsBus("test", name="node") as node:
        yield node


@pytest.fixture
def server(bus: RrinsBus, start: Callable[..., Any]) -> Iterator[Any]:
    command = start("socketcand", "--channel", "test", "--port", 0)
    command.wait_for_line("Ctrl-C stops")
    command.port = int(re.search(r"port (\d+)", command.said[-1])[1])
    yield command
    if command.process.poll() is None:
        command.process.send_signal(signal.SIGINT)
        assert command.finish()[0] == 130


@pytest.fixture
def talk(server: Any) -> Iterator[Connect]:
    clients = []

    def connect(*words: str) -> Talk:
        clients.append(Talk(server.port))
        assert clients[-1].hear() == "< hi >"
        for word in words:
            assert clients[-1].ask(word) == "< ok >"
        return clients[-1]

    yield connect
    for client in clients:
        client.close()


@pytest.fixture
def client(server: Any) -> Iterator[Connect]:
    """python-can's own client."""
    buses = []

    def connect() -> can.BusABC:
        buses.append(
            can.Bus(interface="socketcand", host="127.0.0.1", port=server.port, channel="test")
        )
        return buses[-1]

    yield connect
    for one in buses:
        one.shutdown()


def receive(bus: can.BusABC) -> can.Message:
    """Receive a message; python-can's client may come back early without one."""
    for _ in range(100):
        message = bus.recv(1.0)
        if message is not None:
            return message
    raise AssertionError("nothing was received")


MESSAGES = [
    can.Message(arbitration_id=0x123, is_extended_id=False, data=[0x11, 0x02, 0xFF]),
    can.Message(arbitration_id=0x123, is_extended_id=True, data=range(8)),
    can.Message(arbitration_id=0x1FFFFFFF, is_extended_id=True, data=[0xA5]),
    can.Message(arbitration_id=0x7FF, is_extended_id=False),
    can.Message(arbitration_id=0, is_extended_id=False, data=[0]),
]


def test_python_can_receives_and_sends(bus: RrinsBus, client: Connect) -> None:
    other = client()
    for message in MESSAGES:
        bus.send(message)
        heard = receive(other)
        assert heard.equals(message, timestamp_delta=None, check_channel=False)
        assert heard.timestamp > 0
        other.send(message)
        heard = receive(bus)
        heard.is_rx = True
        assert heard.equals(message, timestamp_delta=None, check_channel=False)


def test_several_clients_hear_each_other_and_not_themselves(bus: RrinsBus, client: Connect) -> None:
    clients = [client() for _ in range(3)]
    for number, one in enumerate(clients):
        one.send(can.Message(arbitration_id=number, is_extended_id=False))
        assert receive(bus).arbitration_id == number
    for number, one in enumerate(clients):
        heard = [receive(one).arbitration_id for _ in range(2)]
        assert heard == [other for other in range(3) if other != number]


def test_an_error_frame_is_told(bus: RrinsBus, talk: Connect) -> None:
    one = talk("< open test >", "< rawmode >")
    error = can.Message(arbitration_id=0x4, is_error_frame=True, data=bytes(8))
    bus.send(error)
    assert re.fullmatch(r"< error 004 \d+\.\d{6} >", one.hear())


def test_what_has_no_word_is_passed_over(bus: RrinsBus, talk: Connect) -> None:
    one = talk("< open test >", "< rawmode >")
    with RrinsBus("test", host="never", fd=True, name="modern") as modern:
        modern.send(can.Message(is_fd=True, data=bytes(64)))
        modern.send(can.Message(is_remote_frame=True, dlc=4))
        modern.send(can.Message(arbitration_id=0x1AB, is_extended_id=False, data=b"\x1a"))
    assert re.fullmatch(r"< frame 1AB \d+\.\d{6} 1A >", one.hear())


def test_frames_carry_the_time_of_the_bus(bus: RrinsBus, talk: Connect) -> None:
    one = talk("< open test >", "< rawmode >")
    frames = frame_array(2)
    frames["can_id"] = [0x12, 0x8000_0012]
    frames["length"] = [2, 0]
    frames["data"] = 0xBEEF
    bus.send_batch(frames, 2, epoch=5, time_ns=23_424_242_999)
    assert one.hear() == "< frame 012 23.424242 EFBE >"
    assert one.hear() == "< frame 00000012 23.424242  >"


def test_frames_carry_unix_time_on_request(bus: RrinsBus, start: Callable[..., Any]) -> None:
    server = start("socketcand", "--channel", "test", "--port", 0, "--timestamps", "unix")
    server.wait_for_line("Ctrl-C stops")
    one = Talk(int(re.search(r"port (\d+)", server.said[-1])[1]))
    assert [one.hear(), one.ask("< open test >"), one.ask("< rawmode >")] == [
        "< hi >",
        "< ok >",
        "< ok >",
    ]
    before_s = time.time()
    bus.send_batch(frame_array(1), 1, time_ns=5_000_000)
    bus.send_batch(frame_array(1), 1, time_ns=2_005_000_000)
    first_s, second_s = (float(one.hear().split()[3]) for _ in range(2))
    one.close()
    assert before_s - 1e-5 <= first_s <= time.time()
    assert second_s - first_s == pytest.approx(2, abs=1e-5)
    server.process.send_signal(signal.SIGINT)
    assert server.finish()[0] == 130


def test_bcm_mode_tells_what_was_subscribed_to(bus: RrinsBus, talk: Connect) -> None:
    one = talk("< open test >")
    one.say("< subscribe 0 0 123 >< subscribe 0 0 00000124 >< subscribe 0 0 125 >")
    one.say("< unsubscribe 125 >")
    assert one.ask("< echo >") == "< echo >"
    for identifier in (0x123, 0x124, 0x125):
        for is_extended in (False, True):
            bus.send(can.Message(arbitration_id=identifier, is_extended_id=is_extended))
    assert one.hear().startswith("< frame 123 ")
    assert one.hear().startswith("< frame 00000124 ")
    assert one.ask("< rawmode >< bcmmode >") == "< ok >"
    assert one.hear() == "< ok >"
    bus.send(can.Message(arbitration_id=0x123, is_extended_id=False))
    assert one.ask("< echo >") == "< echo >"


def test_what_cannot_be_done_is_answered(talk: Connect) -> None:
    one = talk("< open test >")
    for words, answer in {
        "< add 1 0 123 1 11 >": "unknown command",
        "< isotpmode >": "unknown command",
        "< open test >": "unknown command",
        "< >": "unknown command",
        "< echo 1 >": "unknown command",
        "< send >": "a frame has an identifier and a length",
        "< send 123 9 1 2 3 4 5 6 7 8 9 >": "a frame of length 9 with 9 bytes",
        "< send 123 2 1 >": "a frame of length 2 with 1 bytes",
        "< send 800 0 >": "no identifier: 800",
        "< send 20000000 0 >": "no identifier: 20000000",
        "< send 0x1 0 >": "no number: 0x1",
        "< send 123 1 100 >": "number too large: 100",
        "< subscribe 1 0 123 >": "frames are not held back: the interval must be 0 0",
        "< subscribe 0 0 >": "no number: ",
        "< unsubscribe 1 2 >": "too many words: 2",
    }.items():
        assert one.ask(words) == f"< error {answer} >"
        assert one.ask("< echo >") == "< echo >"


@pytest.mark.parametrize(
    ("word", "bits", "value"),
    [
        ("7f", 8, 0x7F),
        ("-1", 8, 0xFF),  # as SavvyCAN writes bytes above 7F, with Qt 6
        ("ffffffffffffff85", 8, 0x85),  # and with Qt 5
        ("ffffffff80000123", 32, 0x8000_0123),
        ("80000123", 32, 0x8000_0123),
    ],
)
def test_a_number_is_read_as_c_does(word: str, bits: int, value: int) -> None:
    assert number_of(word, bits) == value


def test_an_extended_identifier_has_eight_digits_or_the_flag() -> None:
    assert identifier_of("123") == 0x123
    assert identifier_of("00000123") == identifier_of("80000123") == 0x8000_0123
    assert identifier_of("ffffffff80000123") == 0x8000_0123
    with pytest.raises(CommandError):
        identifier_of("A0000123")


def test_commands_come_in_pieces_and_together(bus: RrinsBus, talk: Connect) -> None:
    one = talk()
    for letter in "\r\n< open  test >\0< send 12 1 ":
        one.say(letter)
    assert one.hear() == "< ok >"
    one.say("7 >< send 13 0 >" + "< echo >" * 1000)
    assert [receive(bus).arbitration_id for _ in range(2)] == [0x12, 0x13]
    assert {one.hear() for _ in range(1000)} == {"< echo >"}


def test_another_bus_cannot_be_opened(talk: Connect) -> None:
    one = talk()
    assert one.ask("< send 1 0 >") == "< error unknown command >"
    assert one.ask("< open can0 >") == "< error could not open bus >"
    assert one.hear() == ""


def test_what_is_no_command_ends_in_one_line(bus: RrinsBus, server: Any, talk: Connect) -> None:
    good = talk("< open test >", "< rawmode >")
    wrong = (
        b"GET / HTTP/1.1\r\n\r\n",
        b"< echo < >",
        b"< " + b"a" * 600,
        "< öpen >".encode(),
        b" " * 600,
    )
    for count, said in enumerate(wrong, 1):
        bad = talk()
        bad.say(said)
        assert bad.hear() == ""
        server.wait_for_line("cut off: it sent an invalid command")
        bus.send(can.Message(arbitration_id=0x123, is_extended_id=False))
        assert good.hear().startswith("< frame 123 ")
        assert sum("cut off" in line for line in server.said) == count


def test_a_client_that_does_not_receive_is_cut_off_and_slows_nobody(
    bus: RrinsBus, server: Any, talk: Connect
) -> None:
    talk("< open test >", "< rawmode >")  # and hangs from now on
    good = talk("< open test >", "< rawmode >")
    frames = frame_array(64)
    frames["length"] = 8
    line = len("< frame 000 0.000000 0000000000000000 >")
    for number in range(4 * QUEUE_LIMIT // line // 64):  # the kernel has a queue as well
        frames["can_id"] = number % 0x800
        bus.send_batch(frames, 64, timeout=1.0)
        assert all(int(good.hear().split()[2], 16) == number % 0x800 for _ in range(64))
    server.wait_for_line("bytes waited for it to receive")
    assert sum("cut off" in line for line in server.said) == 1


def test_sending_waits_while_the_bus_is_held_up(
    bus: RrinsBus, server: Any, talk: Connect, start_player: Callable[[], Any]
) -> None:
    slow = start_player()
    slow.ask("open", channel="test", host="never", name="slow")
    one = talk("< open test >")
    count = 60_000
    one.say("".join(f"< send {k % 0x800:X} 0 >" for k in range(count)) + "< echo >")
    # The node `slow` does not receive, so that the bus stands still after some thousand frames.
    readable = select.select([one._end], [], [], 0.5)[0]
    assert not readable
    slow.tell("close")
    assert [receive(bus).arbitration_id for _ in range(count)] == [k % 0x800 for k in range(count)]
    assert one.hear() == "< echo >"


def test_only_so_many_clients_are_let_in(server: Any, talk: Connect) -> None:
    clients = [talk() for _ in range(MOST_CLIENTS)]
    late = Talk(server.port)
    assert late.hear() == ""
    late.close()
    server.wait_for_line(f"there are {MOST_CLIENTS} already")
    assert clients[0].ask("< open test >") == "< ok >"


def test_it_ends_with_a_killed_host_in_one_line(start: Callable[..., Any], player: Any) -> None:
    player.ask("open", channel="test", host="here")
    player.tell("serve")
    server = start("socketcand", "--channel", "test", "--port", 0)
    server.wait_for_line("Ctrl-C stops")
    port = int(re.search(r"port (\d+)", server.said[-1])[1])
    clients = [Talk(port), Talk(port)]
    assert [client.hear() for client in clients] == ["< hi >"] * 2
    assert clients[0].ask("< open test >") == "< ok >"
    os.kill(player.pid, signal.SIGKILL)
    assert server.finish()[0] == 0
    assert len(server.said) == 2
    assert f"process {player.pid}, has disappeared" in server.said[1]
    for client in clients:
        assert client.hear() == ""
        client.close()


@pytest.mark.parametrize(
    ("channel", "host", "words"),
    [
        ("nowhere", "127.0.0.1", "nobody hosts channel 'nowhere'"),
        ("test", "0.0.0.0", "use a loopback address"),
        ("test", "192.0.2.1", "use a loopback address"),
        ("test", "::", "use a loopback address"),
        ("test", "no such host", "not an address"),
    ],
)
def test_a_wrong_call_is_refused(bus: RrinsBus, channel: str, host: str, words: str) -> None:
    with pytest.raises(BusError, match=words):
        serve(channel, host, 0, on_ready=lambda port: pytest.fail(f"listens on {port}"))


def test_a_taken_port_is_named(bus: RrinsBus, start: Callable[..., Any]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        command = start("socketcand", "--channel", "test", "--port", port)
        assert command.finish(30)[0] == 4
    assert command.said == [f"rrins: port {port} of 127.0.0.1 is taken: name another with --port"]


def test_a_running_rehearsal_is_seen(start: Callable[..., Any], tmp_path: Any) -> None:
    rehearsal = start(
        "rehearse", "ideal", "--duration", 30, "--channel", "test", "--speed", 10, "--out", "out"
    )
    rehearsal.wait_for_line("10 %")
    with rehearsal.paused():
        server = start("socketcand", "--channel", "test", "--port", 0)
        server.wait_for_line("Ctrl-C stops")
        port = int(re.search(r"port (\d+)", server.said[-1])[1])
        bus = can.Bus(interface="socketcand", host="127.0.0.1", port=port, channel="test")
    with bus:
        heard = [receive(bus) for _ in range(2000)]
        bus.send(can.Message(arbitration_id=0x7F0, is_extended_id=False, data=[1]))
    assert {0x10, 0x20, 0x40, 0x120} <= {message.arbitration_id for message in heard}
    times = [message.timestamp for message in heard]
    assert times == sorted(times)
    assert 0 < times[0] < times[-1] < 35
    assert rehearsal.finish()[0] == 0
    status, _ = server.finish()
    assert status == 0
    assert re.fullmatch(r"rrins: channel 'test': process \d+ has closed it", server.said[-1]), (
        server.said
    )
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["completed"]
