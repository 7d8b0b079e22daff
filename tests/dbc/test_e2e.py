"""Protection against an independent implementation of AUTOSAR E2E profile 1."""

from __future__ import annotations

import e2e
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.dbc import codec
from rrins.dbc.e2e import COUNTER_MODULUS, counter_of, crc_holds, protect
from rrins.dbc.frame import frame_array

CODEC = codec.load()
WORDS = st.integers(0, 2**64 - 1)
PROTECTED = [m.name for m in CODEC.database.messages if CODEC.is_protected(m.name)]
MESSAGES = st.sampled_from(PROTECTED)


def row_of(message: str) -> np.void:
    return CODEC.messages[CODEC.message_index(message)]


def frame_of(message: str, word: int) -> np.void:
    frame = frame_array(1)[0]
    frame["can_id"], frame["length"], frame["data"] = CODEC.frame_id(message), 8, word
    return frame


@given(MESSAGES, WORDS, st.integers(0, 10**9))
def test_equals_autosar_e2e(message, word, counter):
    row = row_of(message)
    ours = int(protect(np.uint64(word), row, counter)).to_bytes(8, "little")
    theirs = bytearray(word.to_bytes(8, "little"))
    theirs[1] = (theirs[1] & 0xF0) | (counter % COUNTER_MODULUS)
    e2e.p01.e2e_p01_protect(theirs, int(row["data_id"]), increment_counter=False)
    assert ours == bytes(theirs)
    assert e2e.p01.e2e_p01_check(bytearray(ours), int(row["data_id"]))


@given(MESSAGES, WORDS, st.integers(0, 63))
def test_every_single_bit_error_is_noticed(message, word, bit):
    row = row_of(message)
    protected = int(protect(np.uint64(word), row, 3))
    assert crc_holds(frame_of(message, protected), row)
    assert not crc_holds(frame_of(message, protected ^ (1 << bit)), row)


@given(WORDS)
def test_a_frame_under_another_identifier_is_noticed(word):
    protected = int(protect(np.uint64(word), row_of("SENSOR_1"), 0))
    assert not crc_holds(frame_of("SENSOR_1", protected), row_of("SENSOR_2"))


def test_a_frame_of_another_length_is_refused():
    row = row_of("SYNC")
    frame = frame_of("SYNC", int(protect(np.uint64(0), row, 0)))
    frame["length"] = 7
    assert not crc_holds(frame, row)


@pytest.mark.parametrize("counter", [0, 14, 15, 10**12])
def test_counter_lies_where_the_dbc_says(counter):
    word = protect(np.uint64(2**64 - 1), row_of("SYNC"), counter)
    row = CODEC.signals[CODEC.signal_index("SYNC", "alive_counter")]
    assert counter_of(word) == codec.unpack(word, row) == counter % COUNTER_MODULUS


def test_data_ids_are_unique():
    ids = [int(row_of(name)["data_id"]) for name in PROTECTED]
    assert len(set(ids)) == len(ids)


def test_only_diagnostics_and_measurement_go_without_protection():
    others = {m.name for m in CODEC.database.messages} - set(PROTECTED)
    assert others == {"DIAG_REQUEST", "DIAG_FUNCTIONAL", "DIAG_RESPONSE"} | {
        "XCP_COMMAND",
        "XCP_RESPONSE",
    }
