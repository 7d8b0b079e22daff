"""The intake accepts sound frames of the present epoch, once, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.dbc.frame import EFF_FLAG, ERR_FLAG, RTR_FLAG, Frame

SYNC, FIRST_SENSOR, INNER_AXIS, OUTER_AXIS = 0, 1, 5, 6  # in an epoch's frames, no request
WRAP = 1 << 24


class Intake:
    """A bench of which the state before the epoch under test is kept."""

    def __init__(self, tools, epochs=3, first=0, **changes):
        self.bench = tools.Bench(**changes)
        self.bench.epoch = first
        for _ in range(epochs):
            self.bench.step()
        self.kept, self.epoch = self.bench.ram.copy(), self.bench.epoch
        self.dtheta, self.dv = (
            tools.scale_of("SENSOR_1", name) for name in ("gyro_dtheta", "accelerometer_dv")
        )

    @property
    def assembly(self):
        return self.bench.state["assembly"]

    def frames(self, epoch=None):
        return self.bench.frames(self.epoch if epoch is None else epoch)

    def take(self, frames):
        """Step on frames from the kept state; return how much each fault counter grew."""
        self.bench.ram[:] = self.kept
        self.bench.epoch = self.epoch
        self.bench.step(frames)
        return {
            name: int(self.bench.state["faults"][name] - self.kept[0]["faults"][name])
            for name in ("crc_errors", "counter_errors", "missing_frames")
        }

    def assert_right_or_none(self):
        """Check that whatever is marked valid has the epoch's own value."""
        gyro, accelerometer = self.bench.counts(self.epoch)
        for k in range(4):
            if self.assembly["gyro_valid"] >> k & 1:
                assert self.assembly["gyro_dtheta"][k] == gyro[k] * self.dtheta
            if self.assembly["accelerometer_valid"] >> k & 1:
                assert self.assembly["accelerometer_dv"][k] == accelerometer[k] * self.dv


@pytest.fixture(scope="module")
def intake(tools):
    return Intake(tools)


NO_FAULTS = {"crc_errors": 0, "counter_errors": 0, "missing_frames": 0}


def test_a_sound_epoch_is_taken_whole(intake):
    assert intake.take(intake.frames()) == NO_FAULTS
    assert intake.assembly["gyro_valid"] == intake.assembly["accelerometer_valid"] == 0b1111
    assert intake.bench.state["clock"]["sync_seen"]
    assert list(intake.assembly["axis_received"]) == [1, 1]
    intake.assert_right_or_none()


@pytest.mark.parametrize("missing", range(FIRST_SENSOR, OUTER_AXIS + 1))
def test_a_missing_frame_is_counted_and_leaves_no_value(intake, missing):
    frames = intake.frames()
    del frames[missing]
    assert intake.take(frames) == NO_FAULTS | {"missing_frames": 1}
    if missing < INNER_AXIS:
        assert intake.assembly["gyro_valid"] == 0b1111 & ~(1 << (missing - FIRST_SENSOR))
    else:
        assert intake.assembly["axis_silent_epochs"][missing - INNER_AXIS] == 1


@pytest.mark.parametrize("away", [-14, -2, -1, 1, 2, 14])
@pytest.mark.parametrize("index", [FIRST_SENSOR, INNER_AXIS, OUTER_AXIS])
def test_a_frame_of_another_epoch_is_refused(intake, index, away):
    frames = intake.frames()
    frames[index] = intake.frames(intake.epoch + away)[index]
    expected = NO_FAULTS | {"counter_errors": 1, "missing_frames": 1}
    assert intake.take(frames) == expected


def _moving(tools, bench):
    """Return a frame of a sensor that measures something else in each epoch."""
    return tools.frame("SENSOR_1", bench.epoch, gyro_dtheta=bench.epoch)


def test_a_group_that_repeats_one_frame_is_useless_until_its_counter_runs(tools):
    bench = tools.Bench()
    for _ in range(3):
        bench.step()
    repeated, used = _moving(tools, bench), []
    for epoch in range(33):
        frames = bench.frames(bench.epoch)
        is_own = epoch in (0, 5, 30, 31, 32)
        frames[FIRST_SENSOR] = _moving(tools, bench) if is_own else repeated
        bench.step(frames)
        if bench.state["assembly"]["gyro_valid"] & 1:
            used.append(epoch)
        is_useless = bool(bench.state["assembly"]["gyro_absent"] & 1)
        assert is_useless == (17 <= epoch < 32)
    assert used == [0, 32]


@pytest.mark.parametrize("is_alike", [False, True])
def test_a_frame_that_is_repeated_now_and_then_counts_once(tools, is_alike):
    """Every 15th time its counter is right again; it may say what all others of its sender say."""
    bench = tools.Bench()
    for _ in range(3):
        bench.step()

    def sensor():
        return tools.frame("SENSOR_1", bench.epoch) if is_alike else _moving(tools, bench)

    repeated, used = sensor(), []
    for epoch in range(70):
        frames = bench.frames(bench.epoch)
        frames[FIRST_SENSOR] = sensor() if epoch % 5 else repeated
        bench.step(frames)
        if bench.state["assembly"]["gyro_valid"] & 1:
            used.append(epoch)
    right = {epoch for epoch in range(70) if epoch % 5}
    assert set(used) - right == ({0, 15, 30, 45, 60} if is_alike else {0})
    assert right <= set(used)


@pytest.mark.parametrize("flag", [EFF_FLAG, RTR_FLAG, ERR_FLAG])
def test_extended_remote_and_error_frames_are_none_of_ours(intake, flag):
    frames = intake.frames()
    for frame in frames:
        frame["can_id"] |= flag
    assert intake.take(frames) == NO_FAULTS | {"missing_frames": 7}
    assert intake.assembly["gyro_valid"] == 0


@pytest.mark.parametrize(
    ("status", "gyro", "accelerometer"),
    [
        (0, True, True),
        (1, False, True),
        (2, True, False),
        (3, False, False),
        (4, False, True),
        (6, False, False),
        (8, True, False),
        (9, False, False),
    ],
)
def test_the_status_says_what_is_usable(intake, tools, status, gyro, accelerometer):
    frames = intake.frames()
    g, a = (counts[0] for counts in intake.bench.counts(intake.epoch))
    frames[FIRST_SENSOR] = tools.frame(
        "SENSOR_1", intake.epoch, status=status, gyro_dtheta=g, accelerometer_dv=a
    )
    assert intake.take(frames) == NO_FAULTS
    assert bool(intake.assembly["gyro_valid"] & 1) == gyro
    assert bool(intake.assembly["accelerometer_valid"] & 1) == accelerometer


def test_axes_report_angle_rate_and_state(intake, tools):
    frames = intake.frames()
    unit = tools.scale_of("AXIS_OUTER_STATUS", "encoder_angle_deg")
    rate_unit = tools.scale_of("AXIS_OUTER_STATUS", "encoder_rate_dps")
    frames[OUTER_AXIS] = tools.frame(
        "AXIS_OUTER_STATUS",
        intake.epoch,
        encoder_angle_deg=round(-123.456 / unit),
        encoder_rate_dps=round(-2.0 / rate_unit),
        state=2,
    )
    intake.take(frames)
    assert intake.assembly["encoder_angle_deg"][1] == pytest.approx(-123.456, abs=unit)
    assert intake.assembly["encoder_rate_dps"][1] == pytest.approx(-2.0, abs=rate_unit)
    assert intake.assembly["axis_state"][1] == 2


def test_frames_of_a_later_epoch_are_left_for_the_next_step(intake):
    first, second = intake.frames(), intake.frames(intake.epoch + 1)
    assert intake.take([*first, *second]) == NO_FAULTS
    assert intake.bench.consumed == len(first)
    assert intake.bench.firmware.epoch == intake.epoch
    inbox = np.array([*first, *second], dtype=Frame.dtype)
    _, consumed = intake.bench.firmware.step(inbox, len(first), len(inbox), 0)
    assert consumed == len(inbox)
    assert intake.bench.firmware.epoch == intake.epoch + 1
    assert intake.assembly["gyro_valid"] == 0b1111
    assert intake.bench.state["faults"]["counter_errors"] == 0


def test_a_lost_sync_does_not_cost_the_epoch(intake):
    assert intake.take(intake.frames()[1:]) == NO_FAULTS | {"missing_frames": 1}
    assert not intake.bench.state["clock"]["sync_seen"]
    assert intake.assembly["gyro_valid"] == 0b1111


def test_a_late_or_repeated_sync_is_counted(intake):
    late = intake.frames(intake.epoch - 1)[SYNC]
    assert intake.take([late, *intake.frames()]) == NO_FAULTS | {"counter_errors": 1}
    again = intake.frames()[SYNC]
    assert intake.take([again, *intake.frames()]) == NO_FAULTS | {"counter_errors": 1}
    assert intake.assembly["gyro_valid"] == 0b1111


def test_a_repeated_sync_changes_nothing_else(intake):
    def clock_after(frames):
        intake.bench.ram[:] = intake.kept
        inbox = np.array(frames, dtype=Frame.dtype)
        arrival_ns = intake.epoch * intake.bench.period_ns + 100_000
        intake.bench.firmware.step(inbox, 0, len(inbox), arrival_ns)
        return intake.bench.state["clock"].tobytes()

    frames = intake.frames()
    assert clock_after([*frames, frames[SYNC]]) == clock_after(frames)


@pytest.mark.parametrize("jump", [201, -201, 100_000, WRAP // 2 - 1])
def test_a_count_far_away_is_taken_over_once_it_goes_on(intake, jump):
    epoch = intake.epoch + jump if jump > 0 else WRAP + intake.epoch + jump
    intake.take(intake.frames(epoch))
    assert intake.bench.firmware.epoch == intake.epoch
    intake.bench.step(intake.frames(epoch + 1))
    assert intake.bench.firmware.epoch % WRAP == (epoch + 1) % WRAP
    assert intake.bench.state["clock"]["jumps"] == 1


@pytest.mark.parametrize("ahead", [1, 200])
def test_a_count_a_little_ahead_is_waited_for(intake, ahead):
    intake.take(intake.frames(intake.epoch + ahead))
    assert intake.bench.consumed == 0
    assert intake.bench.firmware.epoch == intake.epoch


def test_the_count_wraps_without_a_loss(tools):
    intake = Intake(tools, first=WRAP - 4, epochs=12)
    faults = intake.bench.state["faults"]
    assert faults["counter_errors"] == faults["missing_frames"] == 0
    assert intake.assembly["gyro_valid"] == 0b1111
    assert intake.bench.firmware.epoch == WRAP + 7


def test_a_firmware_switched_on_after_the_count_wrapped_hears_the_hardware(tools):
    # The counters of the frames go on with the whole epoch, SYNC has 24 bits of it only.
    intake = Intake(tools, first=WRAP + 5, epochs=5)
    assert intake.bench.state["faults"]["counter_errors"] == 0
    assert intake.assembly["gyro_valid"] == 0b1111


def test_a_hardware_that_starts_anew_after_the_count_wrapped_is_heard(tools):
    intake = Intake(tools, first=WRAP - 4, epochs=300)
    assert intake.take(intake.frames(0))["counter_errors"] == 7  # one epoch to believe it
    for epoch in range(1, 4):
        intake.bench.step(intake.frames(epoch))
    assert intake.bench.state["faults"]["counter_errors"] == 7
    assert intake.assembly["gyro_valid"] == 0b1111


def test_a_request_is_taken_once_for_each_counter(intake, tools):
    def asked(counter, request):
        return tools.frame("MODE_COMMAND", counter, mode_request=request)

    intake.take([*intake.frames(), asked(3, 2)])
    assert intake.bench.state["modes"]["requested"] == 2
    faults = intake.take([*intake.frames(), asked(3, 2), asked(3, 4)])
    assert faults == NO_FAULTS | {"counter_errors": 1}
    assert intake.bench.state["modes"]["requested"] == 2
    broken = asked(4, 5)
    broken["data"] ^= np.uint64(1 << 12)
    assert intake.take([*intake.frames(), broken]) == NO_FAULTS | {"crc_errors": 1}
    assert intake.bench.state["modes"]["requested"] == 0


INDEX = st.integers(0, 6)
MUTATIONS = st.lists(
    st.one_of(
        st.tuples(st.just("drop"), INDEX, st.just(0)),
        st.tuples(st.just("repeat"), INDEX, st.just(0)),
        st.tuples(st.just("flip"), INDEX, st.integers(0, 63)),
        st.tuples(st.just("rename"), INDEX, st.integers(0, 10)),
        st.tuples(st.just("shorten"), INDEX, st.integers(0, 7)),
        st.tuples(st.just("other epoch"), INDEX, st.integers(1, 14)),
        st.tuples(st.just("swap"), INDEX, INDEX),
    ),
    max_size=8,
)


@pytest.mark.slow
@settings(max_examples=200)
@given(MUTATIONS)
def test_whatever_happens_to_an_epoch_no_wrong_value_is_used(intake, mutations):
    original = intake.frames()
    slots = [[frame] for frame in original]
    broken = set()
    for what, index, value in mutations:
        if what == "drop":
            slots[index] = []
        elif what == "repeat":
            slots[index].append(original[index])
        elif what == "swap":
            slots[index], slots[value] = slots[value], slots[index]
        elif what == "other epoch":
            slots[index].insert(0, intake.frames(intake.epoch - value)[index])
        elif slots[index] and index not in broken:  # one error a frame: CRC-8 finds all of these
            broken.add(index)
            frame = slots[index][0].copy()
            if what == "flip":
                frame["data"] ^= np.uint64(1 << value)
            elif what == "rename":
                frame["can_id"] ^= 1 << value
            else:
                frame["length"] = value
            slots[index][0] = frame
    faults = intake.take([frame for slot in slots for frame in slot])
    intake.assert_right_or_none()
    received = bin(intake.assembly["received"] & 0b1111).count("1")
    axes = int(sum(intake.assembly["axis_received"]))
    synced = bool(intake.bench.state["clock"]["sync_seen"])
    assert faults["missing_frames"] == 7 - received - axes - synced
