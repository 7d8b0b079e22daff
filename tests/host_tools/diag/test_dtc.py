"""Trouble codes, read and cleared."""

from __future__ import annotations

import pytest

from rrins.firmware_py.diagnostics import table


@pytest.fixture
def faulty(computer):
    """A computer that does not hear sensor group 3."""
    computer.bench.inject("silence", message="SENSOR_3")
    computer.bench.advance(0.5)
    return computer


def test_without_a_fault_there_is_none(computer):
    assert computer.type("dtc", "read").out == "no trouble codes\n"
    assert computer.type("dtc", "read", "--json").json == []


def test_a_silent_sensor_is_named(faulty):
    (found,) = faulty.type("dtc", "read", "--json").json
    assert (found["code"], found["name"]) == ("U1103-87", "sensor_3_silent")
    assert {"test_failed", "confirmed"} <= set(found["status_bits"])
    shown = faulty.type("dtc", "read").out
    assert "U1103-87" in shown
    assert "failed now" in shown


@pytest.mark.slow
def test_it_accuses_no_other(faulty):
    faulty.bench.advance(120.0)  # the others stand, and turn about either axis
    names = {one["name"] for one in faulty.type("dtc", "read", "--json").json}
    assert names == {"sensor_3_silent", "gyros_not_redundant", "accelerometers_not_redundant"}


@pytest.mark.parametrize("name", ["sensor_3_silent", "U1103-87", "0xD10387"])
def test_its_freeze_frame(faulty, name):
    (found,) = faulty.type("dtc", "read", name, "--json").json
    assert found["occurrences"] == 1
    first = found["freeze_frames"]["first"]
    assert first["mode"] == {"mode": "NAVIGATION_ROTATING", "fault": "NONE"}
    assert 1200 <= first["epoch"]["epoch"] <= 1225
    shown = faulty.type("dtc", "read", name).out
    assert "NAVIGATION_ROTATING" in shown
    assert "latitude_deg" in shown


def test_what_is_gone_is_confirmed_still_until_it_is_cleared(faulty):
    faulty.bench.clear_faults()
    faulty.bench.advance(3.0)
    (found,) = faulty.type("dtc", "read", "--json").json
    assert "test_failed" not in found["status_bits"]
    assert faulty.type("dtc", "clear", "sensor_3_silent").out == "cleared: sensor_3_silent\n"
    assert faulty.type("dtc", "read", "--json").json == []


def test_what_is_still_faulty_is_found_again(faulty):
    assert faulty.type("dtc", "clear").out == "cleared: all\n"
    faulty.bench.advance(0.5)
    assert [one["name"] for one in faulty.type("dtc", "read", "--json").json] == ["sensor_3_silent"]


def test_all_that_the_computer_can_find(computer):
    names = {one["name"] for one in computer.type("dtc", "read", "--all", "--json").json}
    assert "sensor_4_silent" in names
    assert "sensor_5_silent" not in names
    assert names <= set(table.TROUBLE_BY_NAME)
    assert computer.type("dtc", "read", "sensor_5_silent").status == 2
    assert computer.type("dtc", "read", "sensor_3_silnt").status == 2
