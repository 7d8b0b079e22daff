"""Each command with its exact bytes, answered and refused."""

from __future__ import annotations

import math
import struct
import zlib

import pytest

from rrins.firmware_py.version import VERSION
from rrins.firmware_py.xcp import protocol
from rrins.firmware_py.xcp.layout import by_path, epk
from rrins.firmware_py.xcp.protocol import Command

OK = "ff" + "00" * 7


def error(code: int, details: str = "") -> str:
    return f"fe{code:02x}{details}".ljust(16, "0")


SYNTAX, RANGE, PROTECTED, DENIED, LOCKED = (error(code) for code in range(0x21, 0x26))
PAGE, MODE, SEGMENT, SEQUENCE, CONFIG = (error(code) for code in range(0x26, 0x2B))
LATITUDE = by_path()["parameters.latitude"].address
BRIDGE = by_path()["parameters.bridge_epochs"].address
STEPS = by_path()["steps"].address


def dword(value: int) -> str:
    return value.to_bytes(4, "little").hex()


def double(value: float) -> str:
    return struct.pack("<d", value).hex()


def text_of(packets: str) -> str:
    return b"".join(bytes.fromhex(one)[1:] for one in packets.split()).rstrip(b"\0").decode()


def test_nothing_is_answered_before_connect(master):
    for command in Command:
        if command != Command.CONNECT:
            assert master.ask(f"{command:02x}" + "00" * 7) == ""


CONNECT = "ff0dc00808000101"

ANSWERS = (
    ("ff00", CONNECT),
    ("ff", SYNTAX),
    ("fd", "ff00090000000000"),
    ("fc", error(0)),
    ("fb", "ff0001002b000010"),
    ("c0", error(0x20)),
    ("f1", error(0x20)),
    ("fa01", "ff00000005000000"),
    ("fa02", "ff00000009000000"),
    ("fa07", OK),
    ("fa", SYNTAX),
    ("f90800", SYNTAX),
    ("f9010000", RANGE),
    ("f9020000", RANGE),
    ("f6000000" + dword(STEPS), OK),
    ("f6000001" + dword(STEPS), RANGE),
    ("f500", RANGE),
    ("f400" + "0000" + dword(STEPS), RANGE),
    ("f408" + "0000" + dword(STEPS), RANGE),
    ("f404" + "0000" + dword(0x0FFF_FFFF), DENIED),
    ("f404" + "0000" + dword(0xFFFF_FFFF), DENIED),
    ("f3000000" + dword(0), error(0x22, "0000" + dword(1 << 22))),
    ("f3000000" + dword((1 << 22) + 1), error(0x22, "0000" + dword(1 << 22))),
    ("f80003", RANGE),
    ("f80004", OK),
    ("f80100", SEQUENCE),
    ("f708000000000000", OK.replace("ff00", "ff09")),
    ("f707", SEQUENCE),
    ("f001aa", LOCKED),
    ("ef01aa", LOCKED),
    ("ee" + "00" * 7, LOCKED),
    ("ed010000" + dword(LATITUDE), LOCKED),
    ("ec00000000ff", LOCKED),
    ("eb830000", LOCKED),
    ("e6000000", LOCKED),
    ("e400010000", LOCKED),
    ("ea0100", OK),
    ("ea0200", OK),
    ("ea0103", SEGMENT),
    ("ea0300", MODE),
    ("e9", "ff03000000000000"),
    ("e8000000", "ff000000" + dword(0)),
    ("e8000001", "ff000000" + dword(1754)),
    ("e8010000", "ff02000000000000"),
    ("e8020000", RANGE),
    ("e8000002", RANGE),
    ("e8000300", SEGMENT),
    ("e7000000", "ff3f000000000000"),
    ("e7000101", "ff0f010000000000"),
    ("e7000002", PAGE),
    ("e50000", OK),
    ("e50003", SEGMENT),
    ("da", "ff93000002000000"),
    ("d9", "ff01070107340100"),
    ("d7000000", "ff8cff0532050000"),
    ("d7000100", "ff84ff0601090000"),
    ("d7000200", RANGE),
    ("d8000000", RANGE),
    ("df000000", RANGE),
    ("dc", "ff000000" + dword(2 * 5000)),
    ("e000000000000100", RANGE),
    ("de010000", RANGE),
    ("dd03", MODE),
    ("dd01", OK),
    ("dd00", OK),
    ("e3000000", RANGE),
    ("e200000000", SYNTAX),
    ("e20000000000", RANGE),
    ("e1ff0400" + dword(STEPS), SEQUENCE),
    ("db", SEQUENCE),
    ("d6", OK),
    ("d5004100", error(0x30)),
    ("d400000001", RANGE),
    ("d30000000001", RANGE),
    ("f2fe0000", RANGE),
    ("f2ff58", SYNTAX),
    ("f2ff5843", error(0x20)),
    ("fe", OK),
)  # fmt: skip


@pytest.mark.parametrize(("command", "answer"), ANSWERS)
def test_answer_of_a_locked_slave(connected, command, answer):
    assert connected.ask(command) == answer


def test_every_command_is_refused_when_it_is_too_short(unlocked):
    rows = unlocked.xcp.slave._rows.values()
    for row in rows:
        if row.size:
            packet = bytes([row.command]) + bytes(row.size - 1)
            assert unlocked.ask(packet.hex()) == SYNTAX, row.command.name


def test_disconnect_ends_lists_and_access(unlocked):
    unlocked.measure((STEPS, 4))
    unlocked.step([bytes.fromhex("de010000")])
    assert unlocked.step()
    unlocked.ask("fe")
    assert unlocked.step() == []
    assert unlocked.ask("fd") == ""
    unlocked.connect()
    assert unlocked.ask("fd") == "ff00090000000000"


@pytest.mark.parametrize(
    ("kind", "text"), [(0, f"RRINS {VERSION}"), (1, "rrins"), (2, "rrins.a2l")]
)
def test_identification_can_be_uploaded(connected, kind, text):
    assert connected.ask(f"fa{kind:02x}") == "ff000000" + dword(len(text))
    assert text_of(connected.ask(f"f5{len(text):02x}")) == text
    assert connected.ask("f501") == DENIED


def test_a2l_can_be_uploaded_and_names_this_layout(connected):
    size = int.from_bytes(bytes.fromhex(connected.ask("fa04"))[4:8], "little")
    text = b""
    while len(text) < size:
        block = min(255, size - len(text))
        packets = connected.ask(f"f5{block:02x}").split()
        text += b"".join(bytes.fromhex(one)[1:] for one in packets)[:block]
    assert text.startswith(b"ASAP2_VERSION")
    assert f'EPK "{epk()}"'.encode() in text


def test_epk_can_be_read_where_the_a2l_says(connected):
    assert connected.ask("f6000000" + dword(0x2000_0000)) == OK
    assert text_of(connected.ask(f"f5{len(epk()):02x}")) == epk()


def test_name_of_an_event_channel_can_be_uploaded(connected):
    connected.ask("d7000100")
    assert text_of(connected.ask("f506")) == "second"


def test_upload_gives_the_memory_and_moves_on(connected):
    image = connected.bench.ram.tobytes()
    assert connected.ask("f407" + "0000" + dword(LATITUDE)) == "ff" + image[8:15].hex()
    assert connected.ask("f501") == "ff" + image[15:16].hex() + "00" * 6


def test_a_block_is_of_one_epoch(connected):
    steps = int.from_bytes(connected.read("steps"), "little")
    assert steps == connected.bench.state["steps"]


def test_checksum_is_crc_32(connected):
    connected.ask("f6000000" + dword(0))
    checksum = zlib.crc32(connected.bench.ram.tobytes()[:1754])
    assert connected.ask("f3000000" + dword(1754)) == "ff090000" + dword(checksum)


def test_key_unlocks_what_was_asked_for(connected):
    assert connected.unlock(0x01) == "ff08000000000000"
    assert connected.ask("fd") == "ff00080000000000"
    assert connected.ask("f80001") == OK
    assert connected.unlock(0x08) == OK


def test_wrong_key_disconnects_and_three_close_for_ten_seconds(master):
    for _ in range(3):
        master.connect()
        assert master.ask("f80001")[:4] == "ff08"
        master.ask("f708" + "00" * 6)
        assert master.ask("f7020000") == LOCKED
        assert master.ask("fd") == ""
    master.connect()
    assert master.ask("f80001") == LOCKED
    master.bench.run(2000)
    assert master.ask("f80001")[:4] == "ff08"


def test_download_changes_a_parameter_at_once(unlocked):
    unlocked.point_to("parameters.bridge_epochs")
    data = (7).to_bytes(8, "little")
    assert unlocked.ask("f008" + data[:6].hex(), "ef02" + data[6:].hex()) == OK
    assert unlocked.bench.state["parameters"]["bridge_epochs"] == 7
    assert unlocked.read("parameters.bridge_epochs") == data


def test_a_number_takes_effect_when_all_its_bytes_have_come(unlocked):
    live = unlocked.bench.state["parameters"]
    before, value = float(live["latitude"]), struct.pack("<d", 0.5)
    unlocked.point_to("parameters.latitude")
    assert unlocked.ask("f006" + value[:6].hex()) == OK
    assert live["latitude"] == before
    assert unlocked.ask("f002" + value[6:].hex()) == OK
    assert live["latitude"] == 0.5


def test_download_max_writes_seven_bytes(unlocked):
    unlocked.point_to("parameters.height")
    value = struct.pack("<d", 123.0)
    assert unlocked.ask("ee" + value[:7].hex()) == OK
    assert unlocked.ask("f001" + value[7:].hex()) == OK
    assert unlocked.bench.state["parameters"]["height"] == 123.0


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e9, -1e9])
def test_a_value_out_of_its_limits_changes_nothing(unlocked, value):
    before = unlocked.bench.ram["parameters"].tobytes()
    unlocked.point_to("parameters.height")
    data = struct.pack("<d", value)
    assert unlocked.ask("f008" + data[:6].hex(), "ef02" + data[6:].hex()) == RANGE
    assert unlocked.bench.ram["parameters"].tobytes() == before


@pytest.mark.parametrize("path", ["parameters.period_ns", "steps", "ins.latitude", "gyros.gain"])
def test_the_rest_of_the_memory_cannot_be_written(unlocked, path):
    unlocked.point_to(path)
    assert unlocked.ask("f00101") == PROTECTED


def test_a_block_out_of_order_is_refused(unlocked):
    unlocked.point_to("parameters.height")
    assert unlocked.ask("ef02aabb") == error(0x29, "00")
    assert unlocked.ask("f008aabbccddeeff", "ef03aabbcc") == error(0x29, "02")
    assert unlocked.ask("f000") == RANGE
    assert unlocked.ask("f003aa") == SYNTAX
    assert unlocked.ask("f008aabbccddeeff", "fd", "ef02aabb").endswith(error(0x29, "00"))


def test_bits_can_be_modified(unlocked):
    live = unlocked.bench.state["parameters"]
    live["bridge_epochs"] = 4
    unlocked.xcp.memory.pages.power_on()
    unlocked.point_to("parameters.bridge_epochs")
    assert unlocked.ask("ec00" + "fbff" + "0300") == OK
    assert live["bridge_epochs"] == 3
    assert unlocked.ask("ec04" + "ffff" + "0100") == OK
    assert live["bridge_epochs"] == 19
    assert unlocked.ask("ec20" + "ffff" + "0000") == RANGE


def test_pages_switch_and_are_copied(unlocked):
    live = unlocked.bench.state["gyros"]
    unlocked.point_to("gyros.calibrated")
    assert unlocked.ask("f00101") == OK
    assert live["calibrated"]
    assert unlocked.ask("eb010101") == OK
    assert not live["calibrated"]
    assert unlocked.ask("ea0101") == "ff00000100000000"
    assert unlocked.read("gyros.calibrated", 1) == b"\1"
    assert unlocked.ask("eb820001") == OK
    assert unlocked.read("gyros.calibrated", 1) == b"\0"
    unlocked.point_to("gyros.calibrated")
    assert unlocked.ask("f00101") == PROTECTED
    assert unlocked.ask("eb830000") == OK
    assert live["calibrated"]
    assert unlocked.ask("e401010100") == OK
    assert not live["calibrated"]


SESSION = (
    ("fd", "ff" + "00" * 7),
    ("f6000000" + dword(BRIDGE), OK),
    ("f008070000000000", ""),  # a block: answered at its end
    ("ef020000", OK),
    ("f407" + "0000" + dword(BRIDGE), "ff07000000000000"),
    ("f501", OK),
    ("f6000000" + dword(BRIDGE), OK),
    ("f3000000" + dword(8), "ff090000" + dword(zlib.crc32((7).to_bytes(8, "little")))),
    ("ed010000" + dword(BRIDGE), RANGE),  # its head fills the packet
    ("ed000000" + dword(BRIDGE), OK),  # so all it does is to set the address
    ("ee09000000000000", OK),
    ("f00100", OK),
    ("ed000000" + dword(BRIDGE), OK),
    ("ec00feff0400", OK),
    ("f404" + "0000" + dword(BRIDGE), "ff0c000000000000"),
    ("eb010001", OK),
    ("ea0100", "ff00000100000000"),
    ("eb830000", OK),
    ("eb010002", PAGE),
    ("eb000000", MODE),
    ("eb010300", SEGMENT),
    ("e400010000", OK),
    ("f404" + "0000" + dword(BRIDGE), "ff04000000000000"),  # as at power-on
    ("e400010001", PROTECTED),
    ("e400010100", SEGMENT),
    ("e400000000", SEGMENT),
    ("e400030000", PAGE),
    ("e60000", OK),
    ("e60100", MODE),
    ("e60003", SEGMENT),
    ("d6", OK),
    ("d5000100", OK),
    ("d400000002", OK),
    ("d30000000001", OK),
    ("d30000000101", OK),
    ("d8000000", "ff0c020100000000"),
    ("e20000000000", OK),
    ("e1ff0100" + dword(STEPS), OK),
    ("e20000000100", OK),
    ("e1ff0700" + dword(STEPS), OK),
    ("e20000000100", OK),
    ("db", "ffff0700" + dword(STEPS)),
    ("db", SEQUENCE),
    ("e010000000000209", OK),
    ("df000000", "ff10000000000209"),
    ("de020000", OK),
    ("df000000", "ff11000000000209"),
    ("f2fe0000", "ff010000d8070000"),
    ("e3000000", OK),
    ("de020000", CONFIG),
    ("fe", OK),
)  # fmt: skip
"""Commands one after the other to a slave that is unlocked."""


def test_answers_of_an_unlocked_slave(unlocked):
    for command, answer in SESSION:
        assert unlocked.ask(command) == answer, command
    assert protocol.RESOURCES == 0x0D


def test_each_command_is_answered_and_refused():
    rows = [
        (Command(code), answer)
        for command, answer in (*ANSWERS, *SESSION)
        if (code := int(command[:2], 16)) in set(Command)
    ]
    answered = {command for command, answer in rows if answer.startswith("ff")}
    refused = {command for command, answer in rows if answer.startswith("fe")}
    never = {Command.SYNCH, Command.SET_REQUEST}  # by the standard; nothing outlasts power-off
    assert set(Command) - answered == never
    without_arguments = {
        Command.DISCONNECT, Command.GET_STATUS, Command.GET_COMM_MODE_INFO, Command.FREE_DAQ,
        Command.GET_PAG_PROCESSOR_INFO, Command.GET_DAQ_CLOCK, Command.GET_DAQ_PROCESSOR_INFO,
        Command.GET_DAQ_RESOLUTION_INFO,
    }  # fmt: skip
    assert set(Command) - refused == without_arguments


def test_reset_brings_the_set_up_back(unlocked):
    unlocked.point_to("gyros.calibrated")
    unlocked.ask("f00101")
    unlocked.bench.firmware.diagnostics.server.reset_wanted = 3
    unlocked.bench.firmware.diagnostics.reset_due = True
    unlocked.step()
    assert not unlocked.bench.state["gyros"]["calibrated"]
    assert unlocked.ask("fd") == ""


def test_power_that_fails_while_a_page_is_written_leaves_no_torn_number(master):
    """Cut at every packet: each number is old or new; after power-on the old page is back."""
    wanted = {"height": 123.0, "bridge_epochs": 7, "follow_tolerance_deg": 2.5}
    packets = []
    for name, value in wanted.items():
        field = by_path()[f"parameters.{name}"]
        data = field.dtype.type(value).tobytes()
        packets += [
            "f6000000" + dword(field.address),
            "f008" + data[:6].hex(),
            "ef02" + data[6:].hex(),
        ]
    live = master.bench.state["parameters"]
    old = {name: live[name].item() for name in wanted}
    checksums = set()
    for cut in range(len(packets) + 1):
        master.connect()
        master.ask("f6000000" + dword(0))
        checksums.add(master.ask("f3000000" + dword(1754)))
        master.unlock(0x01)
        for packet in packets[:cut]:
            master.ask(packet)
        done = cut // 3
        expected = [*wanted.values()][:done] + [*old.values()][done:]
        assert [live[name].item() for name in wanted] == expected
        master.bench.firmware.diagnostics.server.reset_wanted = 1
        master.bench.firmware.diagnostics.reset_due = True
        master.step()
        assert {name: live[name].item() for name in wanted} == old
    assert len(checksums) == 1
