"""Benches: what a test expects, sends, injects and reads, in virtual time."""

from __future__ import annotations

import math

import can
import pytest

from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.testing.errors import BenchError

QUICK = {"duration_s": 60, "firmware": {"alignment_s": 0.5}}
ROTATING = {"mode": "NAVIGATION_ROTATING"}


@pytest.fixture
def bench(rrins_bench):
    return rrins_bench(QUICK, way="direct")


@pytest.fixture
def navigating(bench):
    bench.expect("FIRMWARE_STATUS", within=3, where=ROTATING)
    return bench


def test_time_passes_by_whole_epochs(bench):
    bench.advance(1.0)
    assert bench.time_s == 1.0
    bench.advance(0.0124)
    assert bench.time_s == 1.010
    bench.advance(0.0076)
    assert bench.time_s == pytest.approx(1.020)
    syncs = bench.messages("SYNC")
    assert [m["epoch"] for m in syncs] == list(range(204))
    assert syncs[-1]["time_s"] == pytest.approx(1.015)
    assert len(syncs[10:20]) == 10


def test_an_expectation_ends_with_the_epoch_of_its_frame(bench):
    values = bench.expect("HEARTBEAT_FIRMWARE", within=2, at_least=2)
    assert values["uptime"] == pytest.approx(1.0)
    assert bench.time_s == pytest.approx(values["time_s"] + 0.005)
    assert bench.last("HEARTBEAT_FIRMWARE") == values


@pytest.mark.parametrize(
    "where",
    [
        {"mode": "STANDBY"},
        {"mode": 2},
        {"mode": lambda mode: mode == "STANDBY", "usable_sensors": 4},
        lambda values: values["mode"] == "STANDBY",
    ],
)
def test_the_ways_to_say_which_frame(bench, where):
    assert bench.expect("FIRMWARE_STATUS", within=1, where=where)["time_s"] == 0.5


def test_what_came_before_does_not_count(bench):
    bench.advance(0.55)
    with pytest.raises(AssertionError, match="0 FIRMWARE_STATUS came meanwhile; the last one ever"):
        bench.expect("FIRMWARE_STATUS", within=0.04)


def test_an_expectation_that_fails_tells_what_came_instead(bench):
    with pytest.raises(AssertionError) as failed:
        bench.expect("FIRMWARE_STATUS", within=0.9, where=ROTATING)
    text = str(failed.value)
    assert "no FIRMWARE_STATUS with mode = NAVIGATION_ROTATING within 0.9 s, by 0.900 s" in text
    assert "9 FIRMWARE_STATUS came meanwhile" in text
    assert "at 0.800 s mode STANDBY" in text
    assert "crc_errors 0, counter_errors 0, missing_frames 0" in text


def test_what_never_came_is_said_so(bench):
    with pytest.raises(AssertionError, match="there was none before"):
        bench.expect("NAV_HEIGHT", within=0.1)
    assert bench.last("NAV_HEIGHT") is None
    assert bench.navigation is None


def test_what_must_not_come(bench):
    bench.expect_not("NAV_LATITUDE", within=0.5)
    assert bench.time_s == 0.5
    with pytest.raises(AssertionError, match=r"with mode = STANDBY came 0\.000 s after 0\.5"):
        bench.expect_not("FIRMWARE_STATUS", within=1, where={"mode": "STANDBY"})


@pytest.mark.parametrize(
    ("message", "where", "words"),
    [
        ("FIRMWARE_STATE", None, "did you mean FIRMWARE_STATUS"),
        ("FIRMWARE_STATUS", {"mod": 1}, "did you mean mode"),
        ("FIRMWARE_STATUS", {"mode": "NAVIGATING_ROTATION"}, "did you mean NAVIGATION_ROTATING"),
    ],
)
def test_names_are_checked(bench, message, where, words):
    with pytest.raises(BenchError, match=words):
        bench.expect(message, within=1, where=where)


def test_a_fault_acts_from_the_next_epoch_on_and_for_its_time(navigating):
    start_s = navigating.time_s
    before = len(navigating.messages("SENSOR_2"))
    navigating.inject("drop", message="SENSOR_2", for_s=0.1)
    navigating.advance(0.1)
    assert len(navigating.messages("SENSOR_2")) == before
    navigating.advance(0.005)
    assert navigating.last("SENSOR_2")["time_s"] == pytest.approx(start_s + 0.1)


def test_faults_can_be_cleared(navigating):
    navigating.inject("corrupt", message="SENSOR_1", bit=20)
    wrong = navigating.expect("SENSOR_1", within=0.1, where={"crc_holds": False})
    assert wrong["crc_holds"] is False
    with pytest.raises(AssertionError, match="no SENSOR_1"):
        navigating.expect("SENSOR_1", within=0.1)
    navigating.clear_faults()
    navigating.expect("SENSOR_1", within=0.005)
    navigating.expect("FIRMWARE_FAULTS", within=0.2)
    assert navigating.fault_counters["crc_errors"] == 21


def test_a_fault_that_there_is_not(bench):
    with pytest.raises(ScenarioError, match="did you mean SENSOR_3"):
        bench.inject("drop", message="SENSR_3")


def test_the_test_is_the_operator(rrins_bench):
    bench = rrins_bench(QUICK, way="direct", navigate_at_s=3600)
    bench.expect("FIRMWARE_STATUS", within=1, where={"mode": "STANDBY"})
    for request, mode in (
        ("NAVIGATE_STRAPDOWN", "NAVIGATION_STRAPDOWN"),
        ("NAVIGATE_ROTATING", "NAVIGATION_ROTATING"),
        ("STANDBY", "STANDBY"),
        ("ALIGN", "ALIGNMENT"),
        ("STANDBY", "STANDBY"),
    ):
        bench.send("MODE_COMMAND", mode_request=request)
        bench.expect("FIRMWARE_STATUS", within=1, where={"mode": mode})


def test_a_sound_message_of_the_test_counts_no_error_and_a_wrong_one_does(navigating):
    def counted(name):
        navigating.advance(0.2)
        return navigating.fault_counters[name]

    navigating.send("MODE_COMMAND", mode_request="NAVIGATE_ROTATING")
    assert counted("crc_errors") == 0
    navigating.send("MODE_COMMAND", mode_request=4, crc=0)
    assert counted("crc_errors") == 1
    navigating.send_frame(can.Message(arbitration_id=0x040, is_extended_id=False, data=bytes(8)))
    assert counted("crc_errors") == 2
    navigating.send("SENSOR_1")  # right in all, and the second of its epoch: the hardware's is late
    assert counted("crc_errors") == 2


@pytest.mark.parametrize(
    ("message", "values", "words"),
    [
        ("MODE_COMMAND", {"request": 1}, "did you mean mode_request"),
        ("MODE_COMMAND", {"mode_request": "ALIGNED"}, "never 'ALIGNED', did you mean ALIGN"),
        ("SYNC", {"epoch": -1}, "cannot be sent"),
    ],
)
def test_what_cannot_be_sent(bench, message, values, words):
    with pytest.raises(BenchError, match=words):
        bench.send(message, **values)


def test_an_fd_frame_is_refused(bench):
    with pytest.raises(BenchError, match="classic"):
        bench.send_frame(can.Message(is_fd=True))


def test_truth_and_navigation_are_in_the_same_words(navigating):
    navigating.advance(5)
    truth, navigation = navigating.truth, navigating.navigation
    assert truth.lat_deg == pytest.approx(40.3554)
    assert navigation.lat_deg == pytest.approx(truth.lat_deg, abs=1e-6)
    assert math.remainder(navigation.heading_deg - truth.heading_deg, 360) == pytest.approx(
        0, abs=0.01
    )
    assert truth.inner_deg == pytest.approx(
        navigating.last("AXIS_INNER_STATUS")["encoder_angle_deg"], abs=1e-3
    )
    assert math.hypot(*navigating.errors_m()) < 0.01


def test_errors_need_navigation(bench):
    bench.advance(0.1)
    with pytest.raises(BenchError, match="not navigated"):
        bench.errors_m()


def test_the_end_of_the_scenario_is_told(rrins_bench):
    bench = rrins_bench({"duration_s": 0.5, "firmware": {"alignment_s": 0.1}}, way="direct")
    with pytest.raises(
        BenchError, match=r"over after 1\.6\d\d s; increase its duration_s \(now 0\.5\)"
    ):
        bench.advance(5)
    assert bench.mode == "NAVIGATION_ROTATING"


def test_there_is_no_bus_in_the_direct_way(bench):
    with pytest.raises(BenchError, match="no bus and no process"):
        _ = bench.channel


def test_memory_is_bounded(rrins_bench):
    bench = rrins_bench(QUICK, way="direct", duration_s=200)
    bench.advance(110)
    assert bench.frames > 200_000
    syncs = bench.messages("SYNC")
    assert syncs[0]["epoch"] > 0
    assert [m["epoch"] for m in syncs[-3:]] == [21997, 21998, 21999]


def play(bench):
    """Something of everything that a test can do."""
    bench.expect("FIRMWARE_STATUS", within=3, where=ROTATING)
    bench.inject("drop", message="SENSOR_1", for_s=0.1, probability=0.5)
    bench.inject("delay", message="AXIS_OUTER_COMMAND", for_s=0.1, delay_s=0.02)
    bench.advance(0.5)
    bench.send("MODE_COMMAND", mode_request="NAVIGATE_STRAPDOWN")
    bench.send_frame(can.Message(arbitration_id=0x7A1, is_extended_id=False, data=b"abc"))
    bench.inject("silence", node="hardware", for_s=0.06)
    bench.advance(0.5)
    return bench


def test_time_that_passes_at_once_is_as_epoch_by_epoch(rrins_bench):
    faults = [{"kind": "drop", "probability": 0.2, "at_s": 5.2, "for_s": 1.0}]

    def course(pass_by):
        bench = rrins_bench("drive_aided", way="direct", duration_s=60.0, faults=faults)
        pass_by(bench, 3.0)
        bench.inject("gyro_bias", sensor=2, bias_dph=5000.0, for_s=4.0)
        pass_by(bench, 2.6)
        bench.tester().troubles()
        pass_by(bench, 1.7)
        bench.inject("power_off", for_s=0.3)
        pass_by(bench, 2.0)
        found = bench.truth, bench.navigation, bench.ram.tobytes()
        return bench.time_s, bench.frames, bench.frames_sha256, *map(repr, found)

    at_once = course(lambda bench, seconds: bench.advance(seconds))
    by_epochs = course(lambda bench, seconds: [bench.step() for _ in range(round(200 * seconds))])
    assert at_once == by_epochs


def test_direct_and_lockstep_put_the_same_frames_on_the_bus(rrins_bench):
    scenario = QUICK | {"gyros": {"angle_random_walk_deg_per_sqrt_h": 0.01}}
    direct, lockstep = (play(rrins_bench(scenario, way=way)) for way in ("direct", "lockstep"))
    assert direct.frames == lockstep.frames > 4000
    assert direct.frames_sha256 == lockstep.frames_sha256
    assert direct.errors_m() == lockstep.errors_m()
    assert direct.navigation == lockstep.navigation
