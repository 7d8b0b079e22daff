"""Two senders of one message: told apart from counter faults, named, and nothing wrong is used."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.dbc.frame import Frame
from rrins.firmware_py.core.records.troubles import Status
from rrins.firmware_py.diagnostics import table

EVENTS = 5
HEALING = 403  # epochs from 127 over 0 to -128, a second each
SYNC, FIRST_SENSOR, INNER_AXIS = 0, 1, 5  # in an epoch's frames, no request
FORGED = 4711


def forged(tools, message, counter):
    """Return a frame of a message with right CRC, as a second sender would send it."""
    signals = {
        "SENSOR_2": {"gyro_dtheta": FORGED, "accelerometer_dv": FORGED},
        "AXIS_INNER_STATUS": {"encoder_angle_deg": FORGED, "encoder_rate_dps": 50, "state": 2},
        "SYNC": {"epoch": counter, "time_us": FORGED},
    }
    return tools.frame(message, counter, **signals[message])


MESSAGES = {"SENSOR_2": "sensor_2", "AXIS_INNER_STATUS": "axis_inner", "SYNC": "sync"}


@pytest.mark.parametrize("message", MESSAGES)
@pytest.mark.parametrize("comes", ["first", "last"])
def test_two_senders_with_the_same_counter(at, tools, message, comes):
    bench = at(bridge_s=10.0)

    def beside(frames):
        other = forged(tools, message, bench.epoch)
        return [other, *frames] if comes == "first" else [*frames, other]

    bench.run(EVENTS - 1, beside)
    assert bench.failed() == set()
    bench.run(1, beside)
    assert bench.failed() == {f"{MESSAGES[message]}_two_senders"}
    assert bench.state["faults"]["disagreeing_frames"] == EVENTS
    bench.run(HEALING)
    assert bench.failed() == set()
    assert bench.failed(Status.CONFIRMED) == {f"{MESSAGES[message]}_two_senders"}


@pytest.mark.parametrize("message", MESSAGES)
@pytest.mark.parametrize("offset", [1, 4, 8, 14])
def test_two_interleaved_sequences_of_counters(at, tools, message, offset):
    bench = at(bridge_s=10.0)
    before = bench.ram["faults"].copy()[0]

    def beside(frames):
        # As far behind the count as a counter can be: a SYNC of a later epoch is another matter.
        return [*frames, forged(tools, message, bench.epoch - 15 + offset)]

    bench.run(EVENTS + 14, beside)
    assert bench.failed() == {f"{MESSAGES[message]}_two_senders"}
    assert bench.state["faults"]["missing_frames"] == before["missing_frames"]
    assert bench.state["assembly"]["gyro_valid"] == 0b1111  # the one that counts with SYNC is used
    assert bench.state["faults"]["bridged_epochs"] == before["bridged_epochs"]


@pytest.mark.parametrize("comes", ["first", "last", "twice", "thrice"])
def test_of_frames_that_disagree_none_is_used(at, tools, comes):
    bench = at(bridge_s=10.0)
    right = bench.frames()[FIRST_SENSOR + 1]
    wrong = forged(tools, "SENSOR_2", bench.epoch)
    others = [f for k, f in enumerate(bench.frames()) if k != FIRST_SENSOR + 1]
    orders = {
        "first": [wrong, right],
        "last": [right, wrong],
        "twice": [right, wrong, right],
        "thrice": [wrong, right, wrong, wrong],
    }
    bench.step([*others, *orders[comes]])
    assembly = bench.state["assembly"]
    assert assembly["received"] == assembly["gyro_valid"] == assembly["accelerometer_valid"]
    assert assembly["received"] == 0b1101
    assert bench.state["faults"]["counter_errors"] == len(orders[comes]) - 1
    assert bench.state["faults"]["missing_frames"] == 1
    bench.step()
    assert assembly["received"] == 0b1111


def test_an_axis_that_is_disputed_is_as_silent(at, tools):
    bench, silent = at(bridge_s=10.0), at(bridge_s=10.0)
    for one in (bench, silent):
        one.axes_deg = [10.0, 20.0]
        one.run(3)
    bench.step([*bench.frames(), forged(tools, "AXIS_INNER_STATUS", bench.epoch)])
    frames = silent.frames()
    del frames[INNER_AXIS]
    silent.step(frames)
    for field in ("axis_received", "encoder_angle_deg", "encoder_rate_dps", "axis_state"):
        assert list(bench.state["assembly"][field]) == list(silent.state["assembly"][field])


FAULTS_OF_ONE_SENDER = {
    "counter": lambda tools, bench, frames, before: [*frames, frames[2]],
    "wrong counter": lambda tools, bench, frames, before: [
        *frames[:2],
        *frames[3:],
        forged(tools, "SENSOR_2", bench.epoch + 1),
    ],
    "late": lambda tools, bench, frames, before: [*frames[:2], *frames[3:], before],
    "at times late": lambda tools, bench, frames, before: (
        [*frames[:2], *frames[3:]] if bench.epoch % 2 else [before, *frames]
    ),
}


@pytest.mark.parametrize("fault", FAULTS_OF_ONE_SENDER)
def test_a_fault_of_one_sender_is_none_of_two(at, tools, fault):
    bench = at(bridge_s=10.0)
    before = bench.frames()[2]
    for _ in range(60):
        frames = bench.frames()
        bench.step(FAULTS_OF_ONE_SENDER[fault](tools, bench, frames, before))
        before = frames[2]
    assert bench.failed() & {"sensor_2_counter", "sensor_2_stale"}
    names = {f"sensor_2_{kind}" for kind in ("counter", "stale", "silent")}
    assert bench.failed(Status.TEST_FAILED_SINCE_LAST_CLEAR) <= names
    assert bench.state["heard"]["disputed"] == 0


def sync_of(tools, epoch):
    return tools.frame("SYNC", epoch, epoch=epoch)


@pytest.mark.parametrize("ahead", [2, 50, 200, 201, 5000, 1 << 22, -300, -70_000])
@pytest.mark.parametrize("place", [0, 1, 4])
def test_a_sync_of_the_future_moves_nothing(at, tools, ahead, place):
    bench = at(bridge_s=10.0)
    navigated = bench.firmware.trace.epochs
    for _ in range(40):
        frames = bench.frames()
        frames.insert(place, sync_of(tools, (bench.epoch + ahead) % (1 << 24)))
        inbox = np.array(frames, dtype=Frame.dtype)
        bench.firmware.step_whole(inbox, len(frames), bench.epoch * bench.period_ns)
        bench.epoch += 1
    assert bench.firmware.epoch == bench.epoch - 1
    assert bench.firmware.trace.epochs == navigated + 40
    assert bench.state["clock"]["jumps"] == 0
    assert bench.state["faults"]["missing_frames"] == 0
    assert bench.failed() == {"sync_two_senders"}


@pytest.mark.parametrize("ahead", [2, 50, 200, 201, 5000, -300])
def test_a_sync_of_the_future_costs_nothing_in_real_time(at, tools, ahead):
    bench = at(bridge_s=10.0)
    for _ in range(40):
        frames = bench.frames()
        frames.insert(3, sync_of(tools, (bench.epoch + ahead) % (1 << 24)))
        bench.step(frames)
        assert bench.consumed == len(frames)
    assert bench.firmware.epoch == bench.epoch - 1
    assert bench.state["clock"]["jumps"] == 0
    assert bench.state["faults"]["missing_frames"] == 0
    assert bench.failed() == {"sync_two_senders"}


def test_one_sync_far_away_is_not_enough(at, tools):
    bench = at(bridge_s=10.0)
    epoch = bench.epoch
    bench.step([sync_of(tools, epoch + 5000), *bench.frames()[1:]])
    assert bench.firmware.epoch == epoch
    bench.run(3)
    assert bench.firmware.epoch == epoch + 3
    assert bench.state["clock"]["jumps"] == 0


def test_it_can_be_read_over_uds():
    identifier = next(one for one in table.READINGS if one.name == "fault_counters")
    assert "disagreeing_frames" in [field.name for field in identifier.fields]
    codes = {t.name: t.code for t in table.TROUBLES if t.name.endswith("_two_senders")}
    assert codes["sensor_1_two_senders"] == "U1101-62"
    assert codes["sync_two_senders"] == "U1001-62"
    assert "mode_command_two_senders" not in codes
