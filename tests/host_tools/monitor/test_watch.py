"""A watch's rates, ages, load, losses and values of frames; in virtual time."""

from __future__ import annotations

import can
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.dbc.codec import load
from rrins.dbc.e2e import COUNTER_MODULUS, protect
from rrins.dbc.frame import frame_array
from rrins.host_tools.monitor.tally import BINS, ENTRIES
from rrins.host_tools.wire.bits import INTERMISSION_BITS, frame_bits

PERIOD_S = 0.005


def regular(bus, message, first, last, period_s=PERIOD_S, **values):
    """Send frames number `first` to `last`, one a period, with the right counters."""
    for k in range(first, last + 1):
        bus.send(message, k * period_s, k, **values)


def of(bus, message):
    return bus.watch.state().message(message)


def test_a_bus_without_frames(played):
    state = played.watch.state()
    assert state.messages == ()
    assert state.frames == 0
    assert state.rate_hz is None
    assert state.load is None
    assert state.message("SYNC") is None
    assert state.value("SYNC", "epoch") is None


def test_rates_and_ages_are_those_of_bus_time(played):
    for k in range(1001):
        played.send("SYNC", k * PERIOD_S, k)
        if k % 200 == 0:
            played.send("HEARTBEAT_FIRMWARE", k * PERIOD_S, k // 200)
    played.clock.now_ns = 10**15  # the clock on the wall says nothing about them
    sync, heartbeat = of(played, "SYNC"), of(played, "HEARTBEAT_FIRMWARE")
    assert sync.rate_hz == pytest.approx(200.0)
    assert sync.period_s == pytest.approx(PERIOD_S)
    assert heartbeat.rate_hz == pytest.approx(1.0)
    assert (sync.age_s, heartbeat.age_s) == (0.0, 0.0)
    played.send("MODE_COMMAND", 5.1)
    assert of(played, "SYNC").age_s == pytest.approx(0.1)
    assert of(played, "MODE_COMMAND").rate_hz is None


def test_a_rate_that_changes_is_the_new_one_after_the_window(played):
    regular(played, "SYNC", 0, 400)
    played.watch.state()
    for k in range(1, 301):
        played.send("SYNC", 2.0 + k * 0.01, 400 + k)
        if k % 25 == 0:
            state = played.watch.state()
    assert state.message("SYNC").rate_hz == pytest.approx(100.0)
    assert state.rate_hz == pytest.approx(100.0, rel=0.01)


def test_a_message_that_stays_away_is_silent(played):
    for k in range(450):
        played.send("SYNC", k * PERIOD_S, k)
        if k <= 400:
            played.send("SENSOR_1", k * PERIOD_S, k)
    assert not of(played, "SENSOR_1").is_silent
    regular(played, "SYNC", 450, 460)
    sensor = of(played, "SENSOR_1")
    assert sensor.is_silent
    assert sensor.rate_hz == 0
    assert sensor.age_s == pytest.approx(60 * PERIOD_S)
    assert not of(played, "SYNC").is_silent


def test_on_a_real_bus_time_goes_on_when_all_are_silent(play):
    virtual, real = play(), play(is_wall_time=True)
    for bus in (virtual, real):
        regular(bus, "SYNC", 0, 400)
        bus.clock.now_ns += 3_000_000_000
    assert of(virtual, "SYNC").age_s == 0
    assert not of(virtual, "SYNC").is_silent
    assert of(real, "SYNC").age_s == pytest.approx(3.0)
    assert of(real, "SYNC").is_silent
    assert virtual.watch.state().times.quiet_s == pytest.approx(3.0)


def test_speed_is_bus_time_over_time_on_the_wall(played):
    for k in range(40):
        played.send("SYNC", k * 10.0, k)
        played.clock.now_ns = k * 100_000_000
        state = played.watch.state()
    assert state.times.speed == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("can_id", "is_extended", "data"),
    [(0x123, False, bytes(8)), (0x7FF, False, b"\xff\x00"), (0x1ABCDEF0, True, bytes(range(8)))],
)
def test_load_counts_every_bit(play, can_id, is_extended, data):
    bus = play(bitrate=500_000)
    for k in range(2001):
        bus.put_message(
            can.Message(
                timestamp=k * 0.001, arbitration_id=can_id, is_extended_id=is_extended, data=data
            )
        )
    word = can_id | (0x8000_0000 if is_extended else 0)
    payload = np.uint64(int.from_bytes(data, "little"))
    bits = int(frame_bits(word, len(data), payload)) + INTERMISSION_BITS
    state = bus.watch.state()
    assert state.load == pytest.approx(bits * 1000 / 500_000, rel=1e-3)
    assert state.peak_load == pytest.approx(state.load, rel=1e-2)
    assert state.rate_hz == pytest.approx(1000, rel=1e-3)


def test_the_peak_of_the_load_stays(played):
    regular(played, "SYNC", 0, 2000, period_s=0.001)
    high = played.watch.state().peak_load
    for k in range(100):
        played.send("SYNC", 2 + k * 0.1, 2001 + k)
        state = played.watch.state()
    assert state.peak_load == pytest.approx(high, rel=0.01)
    assert state.load < high / 50


@given(gone=st.sets(st.integers(1, 298), max_size=120), period_ms=st.sampled_from([1, 5, 20]))
@settings(max_examples=40)
def test_every_lost_frame_is_counted(play, gone, period_ms):
    bus = play()
    for k in range(300):
        if k not in gone or k < 3:
            bus.send("SENSOR_2", k * period_ms / 1000, k)
    message = of(bus, "SENSOR_2")
    assert message.lost == len({k for k in gone if k >= 3})
    assert message.out_of_turn == 0


@given(gone=st.sets(st.integers(4, 58), max_size=30), epochs=st.sampled_from([7, 15, 20, 200]))
@settings(max_examples=20, deadline=None)
def test_losses_where_the_counter_is_the_epoch(play, gone, epochs):
    """Aiding comes every few epochs, and its counter is the epoch's."""
    bus = play()
    for k in range(60 * epochs):
        if k % 5 == 0 or k % epochs == 0:
            bus.send("SYNC", k * PERIOD_S, k)
        if k % epochs == 0 and k // epochs not in gone:
            bus.send("ODOMETER", k * PERIOD_S, k)
    message = of(bus, "ODOMETER")
    assert (message.lost, message.out_of_turn) == (len(gone), 0)


def test_commands_of_several_tools_are_not_followed(played):
    for k in range(60):
        played.send("MODE_COMMAND", k * 0.1, k)
        played.send("MODE_COMMAND", k * 0.1 + 0.05, k + 7)
    played.send("MODE_COMMAND", 100.0, 3)
    assert of(played, "MODE_COMMAND").errors == 0


def test_an_event_may_be_rare(played):
    for k, time_s in enumerate([0.0, 0.1, 0.2, 50.0, 50.1, 300.0]):
        played.send("TABLE_STATUS", time_s, k)
    assert of(played, "TABLE_STATUS").errors == 0
    played.send("TABLE_STATUS", 301.0, 7)
    assert of(played, "TABLE_STATUS").lost == 1


def test_diagnostic_frames_have_no_protection_that_could_fail(played):
    for place, identifier in enumerate((0x7DF, 0x7E0, 0x7E8, 0x7E0, 0x7E8)):
        data = bytes([2, 0x3E, place, 0x55, 0xAA])  # some testers do not pad
        played.put_message(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
    found = [of(played, name) for name in ("DIAG_FUNCTIONAL", "DIAG_REQUEST", "DIAG_RESPONSE")]
    assert [one.count for one in found] == [1, 2, 2]
    assert all(one.errors == 0 and one.is_sound for one in found)
    assert played.watch.state().value("DIAG_REQUEST", "byte_2") == 3


@pytest.mark.parametrize("lost", [1, 14, 15, 29, 30, 400, 20_000])
def test_a_loss_longer_than_the_counter_is_told_by_the_time(played, lost):
    regular(played, "SENSOR_1", 0, 100)
    regular(played, "SENSOR_1", 101 + lost, 120 + lost)
    assert of(played, "SENSOR_1").lost == lost


@pytest.mark.parametrize("counters", [(5, 5, 6), (5, 7, 6, 8), (5, 6, 5)])
def test_frames_out_of_turn(played, counters):
    regular(played, "FIRMWARE_STATUS", 0, 4, 0.1)
    for place, counter in enumerate(counters):
        played.send("FIRMWARE_STATUS", 0.5 + 0.1 * place, alive_counter=counter)
    assert of(played, "FIRMWARE_STATUS").out_of_turn == 1


def test_a_sensor_with_the_counter_of_another_epoch(played):
    for k in range(100):
        played.send("SYNC", k * PERIOD_S, k)
        played.send("SENSOR_1", k * PERIOD_S, k)
        played.send("SENSOR_2", k * PERIOD_S, k + 1)
    assert of(played, "SENSOR_1").out_of_turn == 0
    assert of(played, "SENSOR_2").out_of_turn > 90


def test_a_command_may_come_after_the_next_sync(played):
    for k in range(100):
        played.send("SYNC", k * PERIOD_S, k)
        played.send("AXIS_INNER_COMMAND", k * PERIOD_S, k - 1)
    assert of(played, "AXIS_INNER_COMMAND").errors == 0


def test_a_wrong_crc_is_counted_and_its_values_are_not_taken(played):
    played.send("FIRMWARE_FAULTS", 0.0, 0, crc_errors=7)
    played.send("FIRMWARE_FAULTS", 0.1, 1, crc_errors=900, crc=1)
    state = played.watch.state()
    message = state.message("FIRMWARE_FAULTS")
    assert (message.count, message.crc_errors, message.lost) == (2, 1, 0)
    assert not message.is_sound
    assert message.recent_crc_errors == 1
    assert state.value("FIRMWARE_FAULTS", "crc_errors") == 7
    assert state.signal("FIRMWARE_FAULTS", "crc_errors").high == 7


def test_a_wrong_length_counts_as_a_wrong_crc(played):
    played.put_message(can.Message(arbitration_id=0x010, is_extended_id=False, data=bytes(3)))
    assert of(played, "SYNC").crc_errors == 1
    assert of(played, "SYNC").data == bytes(3)


@given(
    word=st.integers(0, 2**64 - 1),
    name=st.sampled_from(sorted(message.name for message in load().facts.messages)),
)
def test_values_are_those_of_cantools(play, word, name):
    codec = load()
    bus = play()
    frames = frame_array(1)
    row = codec.messages[codec.message_index(name)]
    frames[0]["can_id"], frames[0]["length"] = row["can_id"], row["length"]
    frames[0]["data"] = protect(np.uint64(word), row, 3)
    bus.put(frames, 0.0)
    state = bus.watch.state()
    described = codec.database.get_message_by_name(name)
    expected = described.decode(int(frames[0]["data"]).to_bytes(8, "little"))
    for signal in state.signals(name):
        flag = codec.valid_if(name, signal.name)
        if flag is not None and not expected[flag]:
            assert signal.value is None
            continue
        if signal.text is None:
            assert signal.value == pytest.approx(float(expected[signal.name]), rel=1e-9, abs=1e-12)
        else:
            assert signal.text == str(expected[signal.name])
        assert signal.low == signal.high == signal.value


def test_smallest_and_largest_are_kept(played):
    for k, angle in enumerate((10.0, -30.0, 20.0)):
        played.send("AXIS_INNER_STATUS", k * PERIOD_S, k, encoder_angle_deg=angle)
    angle = played.watch.state().signal("AXIS_INNER_STATUS", "encoder_angle_deg")
    assert (angle.value, angle.low, angle.high) == pytest.approx((20, -30, 10 + 10), abs=1e-5)
    assert angle.unit == "deg"


def test_unknown_identifiers_and_kinds_of_frames(played):
    played.put_message(can.Message(arbitration_id=0x7E9, is_extended_id=False, data=b"\x02\x7e"))
    played.put_message(can.Message(arbitration_id=0x10, is_extended_id=True, data=b"\x01"))
    played.put_message(can.Message(arbitration_id=0x10, is_extended_id=False, is_remote_frame=True))
    played.put_message(can.Message(is_error_frame=True))
    state = played.watch.state()
    assert [(m.hexadecimal, m.label, m.data) for m in state.messages] == [
        ("0x010", "remote frame", b""),
        ("0x7E9", "unknown", b"\x02\x7e"),
        ("0x00000010", "unknown", b"\x01"),
    ]
    assert state.error_frames == 1
    assert state.frames == 4


def test_more_identifiers_than_there_is_room_for(played):
    frames = frame_array(2048)
    frames["can_id"] = np.arange(2048)
    frames["length"] = 1
    for _ in range(2):
        played.put(frames, 1.0)
    state = played.watch.state()
    assert state.frames == 4096
    assert len(state.messages) <= ENTRIES
    assert state.unlisted + sum(message.count for message in state.messages) == 4096


def test_histories_cover_a_minute_ten_and_a_hundred(played):
    for k in range(4 * 6000):
        time_s = k * 0.25
        played.send("NAV_HEIGHT", time_s, k, height=time_s)
    state = played.watch.state()
    now_s = 5999.75
    for level, bin_s in enumerate((0.5, 5, 50)):
        bins = state.history("NAV_HEIGHT", "height", level)
        assert len(bins) == BINS
        for back, pair in enumerate(reversed(bins)):
            first_s = (now_s // bin_s - back) * bin_s
            expected = (first_s, min(now_s, first_s + bin_s - 0.25))
            assert pair == pytest.approx(expected), (level, back)


def test_a_history_is_empty_where_nothing_came(played):
    played.send("NAV_HEIGHT", 1.0, 0, height=5)
    for k in range(20):
        played.send("SYNC", 1.0 + k, k)
    bins = played.watch.state().history("NAV_HEIGHT", "height", 0)
    assert [place for place, pair in enumerate(bins) if pair is not None] == [BINS - 1 - 38]
    for k in range(200):
        played.send("SYNC", 21.0 + k, k)
    assert set(played.watch.state().history("NAV_HEIGHT", "height", 0)) == {None}


@pytest.mark.parametrize("first_s", [1.7e9, 100.0])
def test_a_clock_that_is_set_anew(played, first_s):
    regular_s = [first_s + k * PERIOD_S for k in range(200)]
    for k, time_s in enumerate(regular_s):
        played.send("SYNC", time_s, k)
    played.watch.state()
    for k in range(1000):
        played.send("SYNC", 3.0 + k * PERIOD_S, 7 + k)
        if k % 100 == 0:
            state = played.watch.state()
    message = state.message("SYNC")
    assert message.count == 1101
    assert message.lost == message.out_of_turn == 0
    assert message.age_s == 0
    assert message.rate_hz == pytest.approx(200)
    assert state.time_s == pytest.approx(7.5)
    assert 0 < state.load < 0.1


def test_forgetting_begins_anew(played):
    for k in (0, 1, 5):
        played.send("NAV_HEIGHT", k * 0.05, k, height=1000 * k)
    played.watch.state()
    played.watch.reset_counts()
    assert played.watch.state().frames == 0
    for k in (6, 7, 8):
        played.send("NAV_HEIGHT", k * 0.05, k, height=k)
    state = played.watch.state()
    message, height = state.message("NAV_HEIGHT"), state.signal("NAV_HEIGHT", "height")
    assert (message.count, message.lost, state.frames) == (3, 0, 3)
    assert message.rate_hz == pytest.approx(20)
    assert (height.low, height.high) == (6, 8)


def test_a_state_does_not_change_any_more(played):
    regular(played, "SYNC", 0, 10)
    before = played.watch.state()
    regular(played, "SYNC", 11, 500)
    played.send("MODE_COMMAND", 3.0)
    assert before.message("SYNC").count == 11
    assert before.value("SYNC", "alive_counter") == 10 % COUNTER_MODULUS
    assert before.message("MODE_COMMAND") is None


def test_a_value_has_the_time_of_the_frame_that_brought_it(played):
    row = load().signal_index("GYRO_REDUNDANCY", "excluded")
    for k in range(6):
        played.send("GYRO_REDUNDANCY", 1.0 + k, k, excluded=4 if k >= 3 else 0)
    latest = played.watch.latest(np.array([row]))
    assert latest.now_ns == 6_000_000_000
    assert latest.values[0] == 4
    assert latest.changed_ns[0] == 4_000_000_000


def test_growth_is_that_of_the_window(played):
    for k in range(100):
        played.send("FIRMWARE_FAULTS", k * 0.1, k, missing_frames=min(k, 50))
        state = played.watch.state()
        if k == 50:
            assert state.growth("FIRMWARE_FAULTS", "missing_frames") == pytest.approx(25, abs=4)
    assert state.value("FIRMWARE_FAULTS", "missing_frames") == 50
    assert state.growth("FIRMWARE_FAULTS", "missing_frames") == 0


def test_a_snapshot_without_histories_says_the_same_of_all_else(played):
    regular(played, "SYNC", 0, 900)
    whole, light = played.watch.state(), played.watch.state(has_histories=False)
    assert light.messages == whole.messages
    assert light.signals("SYNC") == whole.signals("SYNC")
    assert (light.frames, light.time_s) == (whole.frames, whole.time_s)
    assert any(whole.history("SYNC", "epoch", 0))
