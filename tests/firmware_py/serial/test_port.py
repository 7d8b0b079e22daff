"""Ports that never make the loop wait: pseudo-terminals, devices that vanish, files."""

from __future__ import annotations

import os
import tty

import pytest

from rrins.firmware_py.serial.port import SerialPortError, open_port, parse_port

PIECES = [b"$ONE,1*00\r\n", b"$TWO,22*00\r\n", b"$THREE,333*00\r\n"]


@pytest.fixture
def lost():
    return []


@pytest.fixture
def opened(lost):
    """Open ports; close them in the end."""
    ports = []

    def opener(text):
        ports.append(open_port(parse_port(text, 9600), lost.append))
        return ports[-1]

    yield opener
    for port in ports:
        port.close()


@pytest.fixture
def device():
    """A serial device that a test can unplug: the other side's descriptor, and its name."""
    other, own = os.openpty()
    tty.setraw(own)
    os.set_blocking(other, False)
    yield other, os.ttyname(own)
    os.close(own)


def attach(port):
    """Open a pseudo-terminal as a reader would."""
    return os.open(port.name.split()[0], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)


def read(fd):
    try:
        return os.read(fd, 100_000)
    except BlockingIOError:
        return b""


@pytest.mark.parametrize(
    ("text", "kind", "path", "baud"),
    [
        ("/dev/ttyUSB0", "device", "/dev/ttyUSB0", 9600),
        ("/dev/ttyUSB0:115200", "device", "/dev/ttyUSB0", 115200),
        (
            "/dev/serial/by-path/pci-0:14.0-port0",
            "device",
            "/dev/serial/by-path/pci-0:14.0-port0",
            9600,
        ),
        ("pty", "pty", "None", 0),
        ("pty:/run/nmea", "pty", "/run/nmea", 0),
        ("file:out.nmea", "file", "out.nmea", 0),
    ],
)
def test_names_of_ports(text, kind, path, baud):
    port = parse_port(text, 9600)
    assert (port.kind, str(port.path), port.baud, port.text) == (kind, path, baud, text)


def test_a_device_whose_name_ends_in_a_number_is_found(tmp_path):
    path = tmp_path / "pci-0:14"
    path.touch()
    assert parse_port(str(path), 9600).path == path


@pytest.mark.parametrize("text", ["", "file:", "/dev/ttyS0:0"])
def test_misspelt_ports_are_one_line(text):
    with pytest.raises(SerialPortError) as caught:
        parse_port(text, 9600)
    assert "\n" not in str(caught.value)


def test_a_reader_gets_whole_pieces(opened):
    port = opened("pty")
    reader = attach(port)
    port.offer(PIECES)
    assert read(reader) == b"".join(PIECES)
    assert (port.sent, port.dropped, port.unread) == (3, 0, 0)
    os.close(reader)


def test_nobody_reading_stalls_nothing_and_leaves_nothing(opened):
    port = opened("pty")
    for _ in range(20_000):
        port.offer(PIECES)
    assert (port.sent, port.dropped, port.unread) == (0, 0, 60_000)
    reader = attach(port)
    port.offer(PIECES)
    assert read(reader) == b"".join(PIECES)
    os.close(reader)


def test_a_slow_reader_misses_whole_pieces(opened):
    port = opened("pty")
    reader = attach(port)
    numbered = [f"${k:07d}\r\n".encode() for k in range(20_000)]
    got = bytearray()
    for k in range(0, len(numbered), 4):
        port.offer(numbered[k : k + 4])
        if k % 4000 == 3996:
            got += read(reader)
    while data := read(reader):
        got += data
        port.offer([])
    os.close(reader)
    lines = bytes(got).splitlines(keepends=True)
    assert set(lines) <= set(numbered)
    assert lines == sorted(lines)
    assert port.dropped > 0
    assert len(lines) == port.sent
    assert port.sent + port.dropped == len(numbered)


def test_the_next_reader_begins_with_the_present(opened):
    port = opened("pty")
    first = attach(port)
    port.offer([b"old\r\n"])
    os.close(first)
    port.offer([b"unheard\r\n"])
    second = attach(port)
    port.offer([b"new\r\n"])
    assert read(second) == b"new\r\n"
    os.close(second)
    assert (port.sent, port.unread) == (2, 1)


def test_what_a_reader_sends_back_does_not_pile_up(opened):
    port = opened("pty")
    reader = attach(port)
    for _ in range(2000):
        os.write(reader, b"$PASHQ,RID*28\r\n")
        port.offer(PIECES)
        read(reader)
    os.close(reader)
    assert port.sent == 6000


def test_a_link_leads_to_the_pseudo_terminal_while_it_is_open(opened, tmp_path):
    link = tmp_path / "nmea"
    link.symlink_to("/dev/pts/left-by-a-run-that-was-killed")
    port = opened(f"pty:{link}")
    assert port.name == f"{link.readlink()} ({link})"
    reader = os.open(link, os.O_RDWR | os.O_NOCTTY)
    port.offer(PIECES)
    assert read(reader) == b"".join(PIECES)
    os.close(reader)
    port.close()
    port.close()
    assert not link.is_symlink()


def test_a_link_never_replaces_a_file(opened, tmp_path):
    precious = tmp_path / "scenario.toml"
    precious.write_text("seed = 1")
    with pytest.raises(SerialPortError, match="cannot be linked: File exists"):
        opened(f"pty:{precious}")
    assert precious.read_text() == "seed = 1"


def test_a_console_reads_and_writes_a_device(opened, device):
    other, name = device
    port = opened(f"{name}:115200")
    assert port.is_attached()
    assert port.read() == b""
    os.write(other, b"help\r")
    assert port.read(3) == b"hel"
    assert port.read(64) == b"p\r"
    assert port.write(b"answer") == 6
    assert read(other) == b"answer"
    os.close(other)


def test_a_device_that_vanishes_is_reported_once(opened, device, lost):
    other, name = device
    port = opened(name)
    port.offer(PIECES)
    os.close(other)
    for _ in range(3):
        port.offer(PIECES)
        assert port.read() == b""
        assert port.write(b"x") == 0
    assert not port.is_attached()
    assert lost == [f"{name} at 9600 baud is lost: it hung up; continuing without it"]
    assert port.sent == 3
    assert port.unread == 9


def test_a_device_is_ours_alone(opened, device):
    _, name = device
    opened(name)
    with pytest.raises(SerialPortError, match="another program uses it"):
        opened(name)
    os.close(device[0])


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("/dev/no-such-port", "No such file or directory"),
        ("/dev/null", "Inappropriate ioctl for device"),
        ("file:/no/such/folder/out", "cannot be written: No such file or directory"),
        ("pty:/no/such/folder/link", "cannot be linked: No such file or directory"),
    ],
)
def test_ports_that_cannot_be_opened_are_one_line(opened, text, why):
    with pytest.raises(SerialPortError, match=why) as caught:
        opened(text)
    assert "\n" not in str(caught.value)
    assert text.split(":")[0] in str(caught.value)


def test_a_file_is_written_over_only_when_something_comes(opened, tmp_path):
    path = tmp_path / "out.nmea"
    path.write_text("before, and rather long it was, longer than all that is written now" * 3)
    port = opened(f"file:{path}")
    assert path.read_text().startswith("before")
    port.offer(PIECES)
    port.offer(PIECES)
    assert path.read_bytes() == b"".join(PIECES) * 2


def test_a_full_disk_is_reported_once(opened, lost):
    port = opened("file:/dev/full")
    for _ in range(3):
        port.offer(PIECES)
    assert lost == ["/dev/full is lost: No space left on device; continuing without it"]
