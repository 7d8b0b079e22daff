"""The compiled codec against cantools, for every message of the DBC and for foreign layouts."""

from __future__ import annotations

import cantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.compiled.code_folder import CodeFolder
from rrins.dbc import codec, facts

CODEC = codec.load()
MESSAGES = CODEC.database.messages

MOTOROLA = codec.codec_of(
    cantools.database.load_string(
        """VERSION ""
BS_:
BU_: A
BO_ 5 MIXED: 8 A
 SG_ crc : 0|8@1+ (1,0) [0|255] "" A
 SG_ swapped : 15|12@0- (0.5,3) [-1021|1026.5] "" A
 SG_ deep : 29|17@0+ (1,0) [0|131071] "" A
 SG_ plain : 48|11@1- (2,-7) [-2055|2039] "" A
BA_DEF_ BO_ "E2EProfile" ENUM "None","P01A";
BA_DEF_ BO_ "E2EDataID" INT 0 65535;
BA_DEF_DEF_ "E2EProfile" "P01A";
BA_DEF_DEF_ "E2EDataID" 77;
BA_ "E2EProfile" BO_ 5 1;
BA_ "E2EDataID" BO_ 5 77;
""",
        database_format="dbc",
    )
)


def as_word(payload: bytes) -> np.uint64:
    return np.uint64(int.from_bytes(payload.ljust(8, b"\0"), "little"))


def rows(of: codec.Codec, message: str) -> dict[str, np.void]:
    names = [s.name for s in of.database.get_message_by_name(message).signals]
    return {name: of.signals[of.signal_index(message, name)] for name in names}


@given(st.sampled_from(MESSAGES), st.binary(min_size=8, max_size=8))
def test_decodes_any_payload_as_cantools_does(message, payload):
    expected = message.decode(payload, decode_choices=False)
    word = as_word(payload)
    for name, row in rows(CODEC, message.name).items():
        assert codec.decode(word, row) == pytest.approx(expected[name], rel=1e-15, abs=1e-300)


@given(st.sampled_from(MESSAGES), st.data())
def test_encodes_any_values_as_cantools_does(message, data):
    raws = {
        s.name: data.draw(st.integers(*facts._raw_limits(s)), label=s.name) for s in message.signals
    }
    word = np.uint64(0)
    for name, row in rows(CODEC, message.name).items():
        word = codec.encode(word, row, codec.to_physical(raws[name], row))
    expected = message.encode(raws, scaling=False)
    assert int(word).to_bytes(8, "little")[: message.length] == expected


@given(st.binary(min_size=8, max_size=8))
def test_motorola_byte_order(payload):
    message = MOTOROLA.database.get_message_by_name("MIXED")
    expected = message.decode(payload)
    word = as_word(payload)
    again = np.uint64(0)
    for name, row in rows(MOTOROLA, "MIXED").items():
        assert codec.decode(word, row) == expected[name]
        again = codec.pack(again, row, codec.unpack(word, row))
    assert int(again).to_bytes(8, "little") == message.encode(expected)


@pytest.mark.parametrize("value", [1e9, -1e9, np.inf, -np.inf, np.nan])
def test_a_value_out_of_range_is_limited_not_wrapped(value):
    row = CODEC.signals[CODEC.signal_index("SENSOR_1", "gyro_dtheta")]
    raw = codec.to_raw(value, row)
    assert raw == (row["raw_maximum"] if value > 0 else row["raw_minimum"])


def test_every_signal_states_what_a_reader_needs():
    for message in MESSAGES:
        assert message.comment
        assert message.senders
        # What a tool asks, and the answer to it, has no cycle.
        assert bool(message.cycle_time) == CODEC.is_protected(message.name)
        assert not message.is_extended_frame
        for signal in message.signals:
            assert signal.comment, signal.name
            assert signal.receivers, signal.name
            assert signal.minimum is not None, signal.name
            assert signal.maximum is not None, signal.name


def test_what_a_counter_counts_is_stated_once_for_reader_and_tool():
    """Of the attribute, the comment, and what the cycle time means."""
    for message in MESSAGES:
        if not CODEC.is_protected(message.name):
            assert "No end-to-end protection" in message.comment
            continue
        comment = message.get_signal_by_name("alive_counter").comment
        assert message.dbc.attributes["E2ECounter"].value > 0
        assert CODEC.counts_epochs(message.name) == comment.startswith("Epoch counter")
        is_cyclic = CODEC.send_type(message.name) != "Event"
        assert is_cyclic or not CODEC.counts_epochs(message.name)


def test_an_unknown_name_is_a_contract_error():
    with pytest.raises(facts.ContractError, match=r"SYNC\.epok"):
        CODEC.signal_index("SYNC", "epok")
    with pytest.raises(facts.ContractError, match="NO_MESSAGE"):
        CODEC.message_index("NO_MESSAGE")
    with pytest.raises(facts.ContractError, match="NO_MODE"):
        CODEC.value("FIRMWARE_STATUS", "mode", "NO_MODE")


def test_a_broken_file_is_a_contract_error(tmp_path):
    broken = tmp_path / "broken.dbc"
    broken.write_text("BO_ nonsense")
    with pytest.raises(facts.ContractError, match=r"broken\.dbc"):
        codec.load(broken)


def test_facts_that_are_kept_are_those_of_the_dbc():
    own = facts.Facts.of(CODEC.database)
    assert facts.Facts.of_json(own.to_json()) == own == CODEC.facts


def test_a_second_start_reads_no_dbc(tmp_path, monkeypatch):
    monkeypatch.setattr(codec, "code_folder", lambda: CodeFolder(tmp_path / "code"))
    first = codec.load.__wrapped__()
    monkeypatch.setattr(codec, "read_dbc", lambda *_: pytest.fail("it was kept"))
    again = codec.load.__wrapped__()
    assert again.facts == first.facts
