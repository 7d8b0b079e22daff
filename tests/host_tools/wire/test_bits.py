"""The length of a frame, to the bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.dbc.frame import EFF_FLAG, RTR_FLAG
from rrins.host_tools.wire.bits import agreed_bits, arbitration_key, frame_bits

ALTERNATING = 0x5555_5555_5555_5555

standard = st.integers(0, 0x7FF)
extended = st.integers(0, 0x1FFF_FFFF).map(lambda identifier: identifier | EFF_FLAG)
can_ids = st.builds(
    lambda identifier, remote: identifier | (RTR_FLAG if remote else 0),
    standard | extended,
    st.booleans(),
)
lengths = st.integers(0, 8)
runs = st.lists(st.sampled_from([0x00, 0xFF, 0x0F, 0xF0, 0x1F, 0x07]), min_size=8, max_size=8)
payloads = st.integers(0, 2**64 - 1) | runs.map(lambda row: int.from_bytes(row, "little"))


def quick_bits(can_id, length, data):
    return int(frame_bits(np.uint32(can_id), np.uint8(length), np.uint64(data)))


def quick_agreed(can_id, length, data, other_length, other_data):
    return int(
        agreed_bits(
            np.uint32(can_id),
            np.uint8(length),
            np.uint64(data),
            np.uint8(other_length),
            np.uint64(other_data),
        )
    )


def divided(message):
    """The remainder of a polynomial division, as on paper."""
    rest = int(message + "0" * 15, 2)
    divisor = 0b1100010110011001
    for place in range(len(message) - 1, -1, -1):
        if rest >> (place + 15) & 1:
            rest ^= divisor << place
    return f"{rest:015b}"


def spelled(can_id, length, data):
    """The bits of a frame as a string, field by field and with no code of the module."""
    remote = "1" if can_id & RTR_FLAG else "0"
    if can_id & EFF_FLAG:
        digits = f"{can_id & 0x1FFF_FFFF:029b}"
        text = "0" + digits[:11] + "11" + digits[11:] + remote + "00"
    else:
        text = "0" + f"{can_id & 0x7FF:011b}" + remote + "00"
    text += f"{length:04b}"
    if remote == "0":
        text += "".join(f"{data >> 8 * k & 0xFF:08b}" for k in range(length))
    text += divided(text)
    wire = ""
    for bit in text:
        wire += bit
        if len(wire) >= 5 and wire[-5:] in ("00000", "11111"):
            wire += "1" if bit == "0" else "0"
    return wire + "1" * 10


# Up to the last bit of the CRC, as printed by K. Tindell's canframe.py
# (github.com/kentindell/canhack); the lengths also are those of canframelen.c of can-utils.
@pytest.mark.parametrize(
    ("can_id", "payload", "wire"),
    [
        # The example of that program, and of the picture in Wikipedia's article on CAN.
        (0x014, "01", "000001001010000010001000001001111011101010011"),
        (
            EFF_FLAG | 0x11 << 18 | 0x2002,
            "deadbeefcafef00d",
            "0000010010001110000100000100000101000010001101111010101101101111"
            "100111011111010010101111101101111000001000110101000001010111110",
        ),
    ],
)
def test_published_frames(can_id, payload, wire):
    length, data = len(payload) // 2, int.from_bytes(bytes.fromhex(payload), "little")
    assert spelled(can_id, length, data) == wire + "1" * 10
    assert quick_bits(can_id, length, data) == len(wire) + 10


def test_a_published_remote_frame():
    wire = "0001001000111000100100001101010010"
    assert spelled(0x123 | RTR_FLAG, 4, 0) == wire + "1" * 10
    assert quick_bits(0x123 | RTR_FLAG, 4, ALTERNATING) == len(wire) + 10


def test_a_frame_of_eight_bytes_without_stuffing():
    # 111 bits with the intermission: Davis et al. (2007), section 2.
    assert quick_bits(0x086, 8, ALTERNATING) + 3 == 111


def test_a_long_run_is_stuffed_after_each_five_bits():
    # 19 bits from SOF to the DLC and 15 of the CRC are all 0; each stuff bit ends a run of five.
    assert quick_bits(0, 0, 0) == 34 + 34 // 5 + 10


@given(can_ids, lengths, payloads)
def test_it_agrees_with_a_frame_spelled_out(can_id, length, data):
    assert quick_bits(can_id, length, data) == len(spelled(can_id, length, data))


@given(can_ids, lengths, payloads)
def test_no_frame_is_longer_than_the_longest(can_id, length, data):
    sent = 0 if can_id & RTR_FLAG else length
    extra = bool(can_id & EFF_FLAG)
    bits = quick_bits(can_id, length, data) + 3
    longest = (80 if extra else 55) + 10 * sent  # Davis et al. (2007), section 2
    assert (67 if extra else 47) + 8 * sent <= bits <= longest


@given(can_ids, lengths, payloads)
def test_what_is_not_sent_does_not_count(can_id, length, data):
    sent = 0 if can_id & RTR_FLAG else length
    kept = data & ((1 << 8 * sent) - 1)
    assert quick_bits(can_id, length, data) == quick_bits(can_id, length, kept)


@given(can_ids, lengths, payloads, lengths, payloads)
def test_two_frames_agree_up_to_the_first_bit_that_differs(can_id, length, data, other, changed):
    one, two = spelled(can_id, length, data), spelled(can_id, other, changed)
    if one == two:
        return
    first = next(k for k, pair in enumerate(zip(one, two, strict=False)) if pair[0] != pair[1])
    assert quick_agreed(can_id, length, data, other, changed) == first + 1


@given(can_ids, can_ids)
def test_the_lower_key_is_dominant_first(one, two):
    if one == two:
        return
    first, second = spelled(one, 0, 0), spelled(two, 0, 0)
    bits = next(pair for pair in zip(first, second, strict=False) if pair[0] != pair[1])
    keys = int(arbitration_key(np.uint32(one))), int(arbitration_key(np.uint32(two)))
    assert (keys[0] < keys[1]) == (bits[0] < bits[1])


def test_equal_base_identifiers_go_standard_data_standard_remote_extended():
    base = 0x123
    extra = base << 18 | EFF_FLAG
    order = [base, base | RTR_FLAG, extra, extra | RTR_FLAG, extra | 1, base + 1]
    keys = [int(arbitration_key(np.uint32(can_id))) for can_id in order]
    assert keys == sorted(set(keys))
