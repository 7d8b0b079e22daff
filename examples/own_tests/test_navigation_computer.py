"""Tests of a navigation computer by somebody who uses the project and has not written it.

pip install -e . pytest             # in the project's folder, once
pytest                              # both sides in the test's process
pytest --rrins-way lockstep         # the firmware as a process, on a bus
pytest --rrins-way realtime         # both as processes, by the clock
"""

import pytest

ROTATING = {"mode": "NAVIGATION_ROTATING"}


@pytest.fixture
def bench(rrins_bench):
    """A bench that navigates, its table turning."""
    bench = rrins_bench("brisk.toml")
    bench.expect("FIRMWARE_STATUS", within=5, where=ROTATING)
    return bench


def test_alignment_ends_in_navigation_in_time(rrins_bench):
    """One second of self-test, one of alignment, and the table turns."""
    bench = rrins_bench("brisk.toml")
    bench.expect("FIRMWARE_STATUS", within=1.3, where={"mode": "ALIGNMENT"})
    bench.expect("FIRMWARE_STATUS", within=1.2, where=ROTATING)
    bench.expect("AXIS_INNER_STATUS", within=0.5, where={"state": "MOVING"})


def test_three_groups_are_enough(bench):
    """Without one of its four sensor groups it navigates on, and counts what is missing."""
    bench.inject("drop", message="SENSOR_3", for_s=2)
    bench.expect("FIRMWARE_STATUS", within=0.3, where={"usable_sensors": 3})
    bench.expect("FIRMWARE_FAULTS", within=3, where={"missing_frames": lambda n: n >= 390})
    status = bench.expect("FIRMWARE_STATUS", within=1, where={"usable_sensors": 4})
    assert status["mode"] == "NAVIGATION_ROTATING"
    assert bench.fault_counters["crc_errors"] == 0


def test_silent_hardware_is_a_fault(bench):
    """A tenth of a second without sensors is bridged; then navigation ends and says why."""
    bench.inject("silence", node="hardware")
    lost = {"mode": "FAULT", "fault": "SENSORS_LOST", "sync_lost": 1}
    bench.expect("FIRMWARE_STATUS", within=0.4, where=lost)
    bench.expect_not("NAV_LATITUDE", within=1)


def test_a_silent_axis_stops_the_table(bench):
    """An encoder that says nothing, for a second at most: back to strapdown, both axes held."""
    bench.inject("silence", message="AXIS_INNER_STATUS")
    status = bench.expect("FIRMWARE_STATUS", within=1.2, where={"mode": "NAVIGATION_STRAPDOWN"})
    assert (status["axis_inner_not_following"], status["axis_outer_not_following"]) == (1, 0)
    bench.expect("AXIS_OUTER_COMMAND", within=0.1, where={"command": "HOLD"})


def test_attitude_stays_right_while_the_table_turns(bench):
    """The body stands still, so whatever its attitude does is the table's turning, badly undone."""
    bench.advance(15)
    turned = [m["encoder_angle_deg"] for m in bench.messages("AXIS_INNER_STATUS")]
    assert max(turned) - min(turned) > 90
    for attitude in bench.messages("NAV_ATTITUDE"):
        assert attitude["roll_deg"] == pytest.approx(2, abs=0.01)
        assert attitude["pitch_deg"] == pytest.approx(-3, abs=0.01)
        assert attitude["heading_deg"] == pytest.approx(45, abs=0.01)
