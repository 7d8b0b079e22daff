"""Identification, sessions, reset, memory; what becomes of lost sessions and answers."""

from __future__ import annotations

import os

import numpy as np
import pytest
import udsoncan

from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.access import Session
from rrins.host_tools.diag.transport import request_message
from rrins.host_tools.errors import NoAnswerError


def test_identify(computer):
    found = computer.type("identify", "--json").json
    assert found["system_name"]["system_name"] == "RRINS navigation computer"
    assert found["table_is_this_tools"]
    assert found["sensors"]["gyros"] == 4
    shown = computer.type("identify").out
    assert "NAVIGATION_ROTATING" in shown
    assert "0 failed now, 0 confirmed" in shown


def test_another_table_is_noticed(computer, monkeypatch):
    monkeypatch.setattr(table, "crc32", lambda: 7)  # of the tool only: the server has its own
    ended = computer.type("identify")
    assert ended.status == 0
    assert "diagnostic table differs from this tool's" in ended.err


def test_a_session_is_entered_and_kept(computer):
    assert computer.type("session").out == "session DEFAULT\n"
    assert computer.type("session", "programming", "--security").out == (
        "session PROGRAMMING, unlocked\n"
    )
    kept = computer.type("session", "extended", "--for", "12", "--json").json
    assert (kept["session"], kept["unlocked"]) == ("EXTENDED", False)
    computer.bench.advance(6.0)
    assert computer.type("session").out == "session DEFAULT\n"


def test_a_reset_brings_the_memory_in_force(computer):
    computer.type("did", "write", "axis_watch", "axis_silence_s=0.5", "--security")
    refused = computer.type("reset")
    assert refused.status == 22
    assert "the mode is NAVIGATION_ROTATING" in refused.error
    assert "--security" in refused.error
    ended = computer.type("reset", "--security", "--json")
    assert ended.json["uptime"]["uptime_s"] < 1.0
    assert computer.firmware.ram[0]["parameters"]["axis_silence_epochs"] == 100
    assert computer.type("reset", "soft").status == 0


def test_a_wrong_secret(computer, tmp_path):
    secret = tmp_path / "secret"
    secret.write_text("guess\n")
    words = ("did", "write", "bridge", "0.5", "--security", "--secret-file", str(secret))
    refused = computer.type(*words)
    assert refused.status == 22
    assert refused.error.startswith("security access: invalidKey (0x35)")
    assert "--secret-file" in refused.error
    missing = computer.type(*words[:-1], str(tmp_path / "nowhere"))
    assert (missing.status, "cannot be read" in missing.error) == (20, True)


def test_a_session_that_timed_out_is_entered_again(computer):
    bridge = table.identifier("bridge")
    with computer.tester() as tester:
        tester.write(bridge, {"bridge_s": 0.2})
        computer.bench.advance(7.0)
        assert tester.conversation.session == Session.EXTENDED  # as far as it knows
        tester.write(bridge, {"bridge_s": 0.3})
        assert tester.read([bridge]) == {"bridge": {"bridge_s": 0.3}}


def test_a_session_that_is_lost_between_seed_and_key(computer, monkeypatch):
    with computer.tester() as tester:
        ask = tester.conversation.client.request_seed
        lost = []

        def request_seed(*args, **named):
            response = ask._func_no_error_management(tester.conversation.client, *args, **named)
            if not lost:
                lost.append(computer.bench.advance(6.0))
            return response

        request_seed._func_no_error_management = lambda client, *a, **n: request_seed(*a, **n)
        monkeypatch.setattr(tester.conversation.client, "request_seed", request_seed)
        tester.conversation.unlock()
        assert tester.conversation.is_unlocked
        assert lost


def test_a_transfer_that_is_cut_off_begins_anew(computer, monkeypatch):
    with computer.tester() as tester:
        transfer, calls = tester.conversation.client.transfer_data, []

        def transfer_data(*args, **named):
            calls.append(args)
            if len(calls) == 1:
                computer.bench.advance(6.0)
            return transfer(*args, **named)

        monkeypatch.setattr(tester.conversation.client, "transfer_data", transfer_data)
        assert tester.pull().startswith(b"RRCA")
        assert [block for (block,) in calls] == [1, 1, *range(2, len(calls))]


def test_a_block_whose_answer_is_lost_is_transferred_again_alone(computer, monkeypatch):
    with computer.tester() as tester:
        transfer, calls = tester.conversation.client.transfer_data, []

        def transfer_data(block, *data):
            response = transfer(block, *data)
            calls.append(block)
            if calls[-2:-1] != [block]:
                raise udsoncan.exceptions.TimeoutException("its answer is lost")
            return response

        monkeypatch.setattr(tester.conversation.client, "transfer_data", transfer_data)
        file = tester.pull()
        blocks = max(calls)
        assert blocks > 1
        tester.push(file)
        assert calls == 2 * [block for number in range(1, blocks + 1) for block in 2 * [number]]


def test_answers_that_are_lost_are_asked_for_again(computer):
    with computer.tester() as tester:
        dids = [table.identifier("gyro_increments"), table.identifier("position")]
        tester.read(dids)
        computer.bench.inject("drop", message="DIAG_RESPONSE", for_s=1.0)
        assert set(tester.read(dids)) == {"gyro_increments", "position"}


def test_nobody_answers(computer):
    computer.medium.is_dead = True
    ended = computer.type("did", "read", "mode")
    assert ended.status == 21
    assert ended.error == (
        "bus bench: nobody answers diagnostic requests (0x7E0), but there is traffic; is "
        "`rrins firmware` running?"
    )


def test_somebody_who_answers_no_more(computer):
    with computer.tester() as tester:
        did = table.identifier("mode")
        tester.read([did])
        computer.medium.is_dead = True
        with pytest.raises(NoAnswerError, match="no longer answers"):
            tester.read([did])


@pytest.mark.slow
def test_memory_by_name_and_by_address(computer, tmp_path):
    found = computer.type("memory", "read", "sequencer.target_angle_deg.1", "--json").json
    (told,) = found.values()
    assert told["fields"]["sequencer.target_angle_deg.1"] == pytest.approx(
        float(computer.firmware.ram[0]["sequencer"]["target_angle_deg"][1]), abs=1e-9
    )
    by_address = computer.type(
        "memory", "read", hex(told["address"]), "--size", str(told["size"]), "--json"
    ).json
    assert next(iter(by_address.values()))["hex"] == told["hex"]
    dump = computer.type("memory", "read", "modes", "--hex").out
    assert dump.startswith(f"{Ram.dtype.fields['modes'][1]:06x}  05 ")
    file, live = tmp_path / "ram.bin", computer.firmware.ram[0]
    regions = ("ram",) if os.environ.get("RRINS_SOAK") else ("parameters", "dispatch", "antenna")
    for region in regions:  # the whole memory takes half a minute
        assert computer.type("memory", "read", region, "--out", str(file)).status == 0
        assert computer.type("memory", "read", region, "--out", str(file)).status == 20
        whole = np.fromfile(file, dtype=Ram.dtype if region == "ram" else live[region].dtype)
        file.unlink()
        if region == "ram":
            assert whole[0]["parameters"] == live["parameters"]
        elif region == "dispatch":
            assert np.array_equal(whole, live[region])
        else:
            assert whole[0] == live[region]


def test_memory_that_is_not_there(computer):
    ended = computer.type("memory", "read", "sequencer.target_angle_deg.2")
    assert (ended.status, "not an index from 0 to 1" in ended.err) == (2, True)
    assert computer.type("memory", "read", "modes.mood").status == 2
    assert computer.type("memory", "read", "modes", "--size", "8").status == 2
    beyond = computer.type("memory", "read", "99999999", "--size", "8")
    assert (beyond.status, "memory list" in beyond.error) == (22, True)


class Other:
    """Another tool on the bus: it asks whenever this one does."""

    def __init__(self, computer, *requests: str) -> None:
        self._computer = computer
        self._requests = [bytes.fromhex(request) for request in requests]
        self._send = computer.medium.send

    def send(self, data: bytes) -> None:
        if self._requests:
            self._computer.bench.send_frame(request_message(self._requests.pop(0)))
        self._send(data)


@pytest.fixture
def other(computer, monkeypatch):
    def asks(*requests: str) -> None:
        monkeypatch.setattr(computer.medium, "send", Other(computer, *requests).send)

    return asks


STEPS = "0723140000000008"  # eight bytes from the beginning of the RAM image, as nobody here asks


def test_the_answer_to_another_tool_is_not_taken_for_ours(computer, other):
    with computer.tester() as tester:
        expected = tester.read_memory(16, 8)
        other(STEPS)
        assert tester.read_memory(16, 8) == expected  # asked for again


def test_two_tools_that_ask_all_the_time_are_told_so(computer, other):
    other(*[STEPS] * 8)
    ended = computer.type("memory", "read", "0x10", "--size", "8")
    assert ended.status == 20
    assert "another diagnostic tool is active" in ended.error


def test_another_tool_that_only_keeps_its_session_disturbs_nobody(computer, other):
    other(*["023e80"] * 100)
    assert computer.type("dtc", "read").out == "no trouble codes\n"
