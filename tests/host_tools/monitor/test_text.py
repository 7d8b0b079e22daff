"""Filter, order, and what stands in 80 columns without colour."""

from __future__ import annotations

import re

import can
import pytest

from rrins.dbc.codec import load
from rrins.host_tools.monitor import banner as banners
from rrins.host_tools.monitor.estimates import Estimates
from rrins.host_tools.monitor.listing import message_rows
from rrins.host_tools.monitor.once import as_dict, table_of
from rrins.host_tools.monitor.plot import HEIGHT, LEVELS, ROWS, columns_of, curve, plot
from rrins.host_tools.monitor.table import (
    detail_head,
    signal_head,
    signal_lines,
    table_head,
    table_lines,
)
from rrins.host_tools.monitor.troubles import troubles_of
from rrins.host_tools.monitor.vitals import vitals_of
from rrins.host_tools.monitor.wording import age_words, clipped, rate_words
from rrins.host_tools.monitor.words import parity_words


@pytest.fixture
def state(played):
    """A bus with a bit of everything."""
    for k in range(400):
        time_s = k * 0.005
        played.send("SYNC", time_s, k, epoch=k)
        played.send("AXIS_INNER_STATUS", time_s, k, state="MOVING", encoder_angle_deg=k / 10)
        if k < 100:
            played.send("SENSOR_10", time_s, k, gyro_dtheta=1e-3)
        played.send("SENSOR_9", time_s, k, gyro_dtheta=-1e-3)
        if k % 20 == 0:
            played.send("FIRMWARE_STATUS", time_s, k // 20, mode="STANDBY", usable_sensors=2)
    played.put_message(can.Message(arbitration_id=0x18DAF110, data=b"\x02\x10\x03"), 2.0)
    return played.watch.state()


def names(rows):
    return [row.message.label for row in rows]


def test_a_filter_by_name_or_identifier(state):
    assert names(message_rows(state, "sensor_")) == ["SENSOR_9", "SENSOR_10"]
    assert names(message_rows(state, "0x060")) == ["AXIS_INNER_STATUS"]
    assert names(message_rows(state, "unknown")) == ["unknown"]
    assert names(message_rows(state, "18daf")) == ["unknown"]
    assert message_rows(state, "nothing like it") == []
    (row,) = message_rows(state, "Sensor_9")
    assert row.signals == ("status", "gyro_dtheta", "accelerometer_dv")


def test_a_filter_by_signal_shows_that_signal(state):
    rows = message_rows(state, "gyro")
    assert [(row.message.label, row.signals) for row in rows] == [
        ("SENSOR_9", ("gyro_dtheta",)),
        ("SENSOR_10", ("gyro_dtheta",)),
    ]
    rows = message_rows(state, "axis.ANGLE")
    assert [(row.message.label, row.signals) for row in rows] == [
        ("AXIS_INNER_STATUS", ("encoder_angle_deg",))
    ]
    assert message_rows(state, "crc")[0].signals == ("crc",)


def test_orders(state):
    by_id = ["SYNC", "SENSOR_9", "SENSOR_10", "AXIS_INNER_STATUS", "FIRMWARE_STATUS", "unknown"]
    assert names(message_rows(state, order="id")) == by_id
    by_name = [*sorted(by_id[:5], key=lambda n: (n[:6], len(n), n)), "unknown"]
    assert names(message_rows(state, order="name")) == by_name
    by_rate = ["SYNC", "SENSOR_9", "AXIS_INNER_STATUS", "FIRMWARE_STATUS", "SENSOR_10", "unknown"]
    assert names(message_rows(state, order="rate")) == by_rate
    assert len(message_rows(state, order="errors")) == 6


@pytest.mark.parametrize("width", [40, 80, 100, 120, 200])
def test_no_line_is_longer_than_the_screen(state, width):
    vitals = vitals_of(state)
    troubles = [*troubles_of(state, vitals), "x" * 300]
    head = banners.banner("rrins:rrins0", state, vitals, troubles, width).plain.splitlines()
    assert len(head) == banners.HEIGHT
    rows = message_rows(state)
    lines = [table_head(rows, width, "id"), *table_lines(state, rows, range(6), 2, width)]
    signals = state.signals("FIRMWARE_STATUS")
    message = state.message("FIRMWARE_STATUS")
    lines += [*detail_head(state, message, width), signal_head(width)]
    lines += signal_lines(signals, range(len(signals)), 1, ["mode"], width)
    for line in [*head, *(line.plain for line in lines)]:
        assert len(line) <= width, line
    picture = plot(state, "AXIS_INNER_STATUS", "encoder_angle_deg", 0, width).plain
    assert max(len(line) for line in picture.splitlines()) <= width


def test_all_is_said_in_words(state):
    """Nothing is told by colour alone: cursor, silence and errors have their own signs."""
    rows = message_rows(state)
    lines = [line.plain for line in table_lines(state, rows, range(6), 0, 80)]
    assert lines[0].startswith("> 0x010")
    silent = next(line for line in lines if "SENSOR_10" in line)
    assert silent.startswith(" !")
    assert "silent" in silent
    vitals = vitals_of(state)
    head = banners.banner("bus", state, vitals, troubles_of(state, vitals), 80).plain
    assert "mode STANDBY" in head
    assert "TROUBLES 2: SENSOR_10 has been silent for 1.5 s; unknown identifier" in head
    assert "*" in table_head(rows, 80, "name").plain


def test_notices(played):
    def said(is_frozen=False):
        return " ".join(banners.notices(played.watch.state(), is_frozen))

    assert said() == "WAITING FOR FRAMES"
    played.send("SYNC", 0.0)
    assert said() == ""
    played.clock.now_ns += 3_000_000_000
    assert said() == "NO FRAMES for 3.0 s (wall clock)"
    assert said(is_frozen=True).startswith("FROZEN")
    played.watch.count_gap()
    played.watch.end("its host has gone")
    assert "THE BUS HAS ENDED: its host has gone" in said()
    assert "MISSED FRAMES" in said()


def test_time_of_a_real_bus_is_that_of_the_day():
    assert banners.time_words(12.5) == "12.500 s"
    assert banners.time_words(1_700_000_000.25) == "22:13:20 UTC"


def test_numbers():
    ages = [age_words(s) for s in (0, 0.0046, 0.9996, 12.34, 99.96, 5000, 36000)]
    assert ages == ["0 ms", "5 ms", "1.0 s", "12.3 s", "100 s", "5000 s", "10.0 h"]
    rates = [rate_words(r) for r in (None, 0, 0.1, 9.99, 10, 99.999, 200, 999.96, 8000)]
    assert rates == ["-", "0", "0.100", "9.990", "10.00", "100.0", "200.0", "1000", "8000"]
    assert clipped("abcdef", 4) == "abc…"
    assert clipped("abc", 0) == ""


def heights(lines):
    """Return the heights that have a dot in each column of a curve, read off the dots."""
    bits = {0x01: (0, 3), 0x02: (0, 2), 0x04: (0, 1), 0x40: (0, 0)}
    bits |= {0x08: (1, 3), 0x10: (1, 2), 0x20: (1, 1), 0x80: (1, 0)}
    found = [set() for _ in range(2 * len(lines[0]))]
    for row, line in enumerate(reversed(lines)):
        for place, character in enumerate(line.replace(" ", "\u2800")):
            for bit, (column, height) in bits.items():
                if (ord(character) - 0x2800) & bit:
                    found[2 * place + column].add(4 * row + height)
    return found


def test_a_curve_rises_from_the_lowest_to_the_highest_value():
    steps = [(float(k), float(k)) for k in range(LEVELS)]
    lines = curve([None, *steps, None], 0.0, LEVELS - 1.0)
    assert len(lines) == ROWS
    assert heights(lines) == [set(), *({k} for k in range(LEVELS)), set()]
    assert heights(curve([(5.0, 5.0)], 5.0, 5.0)) == [{LEVELS // 2}, set()]


def test_a_curve_shows_the_smallest_and_the_largest_value_of_each_column():
    shown = heights(curve([(0.0, 11.0), (3.0, 4.0)], 0.0, 11.0))
    assert shown == [set(range(LEVELS)), {3, 4}]


def test_columns_of_a_history():
    bins = [None, (1.0, 3.0), (5.0, 5.0), None]
    assert columns_of(bins, 4) == bins
    assert columns_of(bins, 2) == [(1.0, 3.0), (5.0, 5.0)]
    assert columns_of(bins, 1) == [(1.0, 5.0)]
    assert columns_of(bins, 8) == [bin for bin in bins for _ in range(2)]


def test_a_peak_of_one_frame_is_seen(played):
    for k in range(4000):
        angle_deg = 90.0 if k == 2000 else 10.0
        played.send("AXIS_INNER_STATUS", k * 0.005, k, state="MOVING", encoder_angle_deg=angle_deg)
    _, *lines = plot(
        played.watch.state(), "AXIS_INNER_STATUS", "encoder_angle_deg", 2, 40
    ).plain.splitlines()
    assert lines[0].startswith("     90.000000|")
    assert any(top > LEVELS - 2 for column in heights([x[15:] for x in lines]) for top in column)


def test_a_plot_says_what_it_shows(state):
    lines = plot(state, "AXIS_INNER_STATUS", "encoder_angle_deg", 0, 80).plain.splitlines()
    assert len(lines) == HEIGHT
    assert lines[0] == "AXIS_INNER_STATUS.encoder_angle_deg  now 39.899999°  last 1 min"
    assert lines[1].startswith("     39.899999|")
    assert lines[3].startswith("      0.000000|")
    shown = [column for column in heights([line[15:].ljust(65) for line in lines[1:]]) if column]
    assert min(shown[0]) == 0
    assert max(shown[-1]) == LEVELS - 1


def test_json_has_what_the_estimator_reports(played):
    estimates = Estimates()
    for k in range(2):  # another source and sensor each time
        at = 2.0 + k
        played.send("ESTIMATOR_STATUS", at, k, aided_by=0b1100, rejecting=0b10000)
        played.send("ESTIMATOR_SOURCE", at, k, source=2 + k, used=10 + k, rejected=k, nis=1.25)
        played.send("ESTIMATOR_ATTITUDE", at, k, east_sigma=12.5, north_sigma=12.1, up_sigma=455)
        played.send("ESTIMATOR_GYRO", at, k, sensor=1 + k, bias=0.5 - k, bias_sigma=0.01)
        played.send("AIDING_STATUS", at, k, gnss="LOST", gnss_age=7.5, detected=1, gate_openings=2)
        estimates.note(played.watch.state())
    found = as_dict("bus", played.watch.state(), estimates=estimates)["estimator"]
    assert found["aided_by"] == ["gnss_position", "gnss_velocity"]
    assert found["rejecting"] == ["odometer"]
    assert found["sigma"] == {"attitude_arcsec": pytest.approx([12.5, 12.1, 455])}
    assert found["sources"]["gnss_position"] == {"used": 10, "rejected": 0, "nis": 1.25}
    assert found["sources"]["gnss_velocity"]["used"] == 11
    assert found["sensors"]["gyros"][1] == {"bias_dph": 0.5, "sigma_dph": pytest.approx(0.01)}
    assert found["aiding"]["gnss"] == {"state": "LOST", "age_s": 7.5, "losses": 0}
    assert found["aiding"]["detected"]
    assert found["aiding"]["gate_openings"] == 2


def test_the_table_for_pipes(state):
    lines = table_of("rrins:rrins0", state, "sensor_")
    text = "\n".join(lines)
    assert "TROUBLES 2\n  SENSOR_10 has been silent for 1.5 s\n" in text
    assert sum(line.lstrip(" !").startswith("0x04") for line in lines) == 2
    assert not any(line.endswith(" ") for line in lines)
    assert "…" not in text
    assert "gyro_dtheta=" in text
    assert re.search(r"gyro_dtheta=\S+ rad  ", text)


def test_json_for_scripts(state):
    found = as_dict("rrins:rrins0", state, order="rate")
    assert found["bus"] == "rrins:rrins0"
    assert found["frames"] == state.frames
    assert found["firmware"]["mode"] == "STANDBY"
    assert found["estimator"] is None
    axis = next(m for m in found["messages"] if m["name"] == "AXIS_INNER_STATUS")
    assert axis["rate_hz"] == pytest.approx(200)
    assert axis["signals"]["state"]["text"] == "MOVING"
    assert axis["signals"]["encoder_angle_deg"] == {
        "value": pytest.approx(39.9, abs=1e-5),
        "text": None,
        "unit": "deg",
        "min": 0.0,
        "max": pytest.approx(39.9, abs=1e-5),
    }
    unknown = next(m for m in found["messages"] if m["name"] is None)
    assert (unknown["id"], unknown["is_extended"], unknown["data"]) == (0x18DAF110, True, "021003")


def test_a_parity_at_the_end_of_its_range_may_have_been_larger():
    for message in ("GYRO_REDUNDANCY", "ACCELEROMETER_REDUNDANCY"):
        most = load().database.get_message_by_name(message).get_signal_by_name("parity_ratio")
        assert parity_words(most.maximum) == "40.95 or more"
    assert parity_words(40.94) == "40.94"
