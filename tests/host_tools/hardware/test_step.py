"""The hardware's step: what it sends, what it obeys, and that it does so every time alike."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.dbc.e2e import COUNTER_MODULUS, crc_holds
from rrins.dbc.values import AxisState
from rrins.host_tools.hardware import earth
from rrins.host_tools.hardware.fault_kinds import EVERY, HardwareFault
from rrins.host_tools.hardware.settings import PlannedFault
from rrins.host_tools.hardware.step import OUTBOX_CAPACITY
from rrins.host_tools.hardware.tables import Accelerometers, Altimeter, Gyros

DELAY = 2  # epochs from a command's own to the one it takes effect in: the DBC's comment
GYRO, ACCELEROMETER = "gyro_dtheta", "accelerometer_dv"
EPOCH_BOUND = ("SYNC", "SENSOR", "AXIS")


def names_of(tools, frames):
    return [tools.decode(frame)[0] for frame in frames]


def fan(count):
    """Return so many directions that span the space."""
    return tuple((17.0 + 8.6 * k, 137.5 * k) for k in range(count))


def test_sync_opens_an_epoch_and_the_outer_axis_closes_it(tools):
    bench = tools.Bench(requests=((3, 4),))
    for _ in range(250):
        names = names_of(tools, bench.raw_step())
        assert names[0] == "SYNC"
        assert names[-2:] == ["AXIS_INNER_STATUS", "AXIS_OUTER_STATUS"]
        assert [n for n in names if "SENSOR" in n] == [f"SENSOR_{k}" for k in (1, 2, 3, 4)]


def test_every_frame_is_protected_and_counts_its_epoch(tools):
    bench = tools.Bench()
    for epoch in range(3 * COUNTER_MODULUS):
        for frame in bench.raw_step():
            name, values = tools.decode(frame)
            assert crc_holds(frame, tools.codec.messages[tools.codec.message_index(name)])
            if name.startswith(EPOCH_BOUND):
                assert values["alive_counter"] == epoch % COUNTER_MODULUS


def test_the_weather_moves_the_bias_of_an_altimeter(tools):
    """6 m/√h: by 0.1 √0.1 m from one height to the next, 100 ms later (1 σ)."""
    bench = tools.Bench(altimeter=Altimeter(bias_m=2.0, random_walk_m_per_sqrt_h=6.0))
    biases, heights = [2.0], []
    for _ in range(20 * 500):
        sent = bench.step()
        if "ALTIMETER" in sent:
            biases.append(float(bench.plant["altimeter"]["bias"]))
            heights.append(sent["ALTIMETER"]["height"])
    assert np.std(np.diff(biases)) == pytest.approx(0.1 * math.sqrt(0.1), rel=0.15)
    assert np.allclose(heights, 40.0 + np.array(biases[:-1]), atol=0.001)


def test_an_altimeter_that_fails_is_off_or_drifts_away(tools):
    planned = (
        PlannedFault(HardwareFault.ALTIMETER_JUMP, EVERY, 40, 79, -7.0),
        PlannedFault(HardwareFault.ALTIMETER_PULL, EVERY, 60, 119, 2.0),
    )
    bench = tools.Bench(altimeter=Altimeter(), faults=planned)
    sent = [bench.step().get("ALTIMETER") for _ in range(141)]
    heights = {k: one["height"] - 40.0 for k, one in enumerate(sent) if one is not None}
    expected = {0: 0, 20: 0, 40: -7, 60: -7 + 0.01, 80: 0.21, 100: 0.41, 120: 0, 140: 0}
    assert heights == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("epoch", [0, 1, 2**24 - 1, 2**24, 2**24 + 5, 10**9])
def test_sync_tells_epoch_and_time(tools, epoch):
    bench = tools.Bench()
    bench.plant["epoch"] = epoch
    sync = bench.step()["SYNC"]
    assert sync["epoch"] == epoch % 2**24
    assert sync["time_us"] == epoch * 5000 % 2**28
    assert sync["alive_counter"] == epoch % COUNTER_MODULUS


@pytest.mark.parametrize(
    ("roll_deg", "pitch_deg", "heading_deg", "force"),
    [(0, 0, 0, [0, 0, 1]), (90, 0, 30, [-1, 0, 0]), (0, 90, 200, [0, 1, 0])],
)
def test_a_standing_vehicle_feels_gravity_upwards_and_the_earth_turning(
    tools, roll_deg, pitch_deg, heading_deg, force
):
    bench = tools.Bench(roll_deg=roll_deg, pitch_deg=pitch_deg, heading_deg=heading_deg)
    gravity = earth.normal_gravity(math.radians(40), 40)
    assert bench.plant["specific_force_b"] == pytest.approx(gravity * np.array(force), abs=1e-14)
    assert np.linalg.norm(bench.plant["omega_ib_b"]) == pytest.approx(earth.ROTATION_RATE)


def test_the_counts_add_up_to_the_true_increments(tools):
    bench, epochs = tools.Bench(roll_deg=10, heading_deg=50), 500
    total = np.zeros((2, 4))
    for _ in range(epochs):
        sent = bench.step()
        for k in range(4):
            total[:, k] += [sent[f"SENSOR_{k + 1}"][name] for name in (GYRO, ACCELEROMETER)]
    H = bench.plant["gyros"]["axis"][:4]
    for got, rate, name in (
        (total[0], "omega_ib_b", GYRO),
        (total[1], "specific_force_b", ACCELEROMETER),
    ):
        unit = tools.codec.signals[tools.codec.signal_index("SENSOR_1", name)]["scale"]
        expected = H @ bench.plant[rate] * epochs * 0.005
        assert got == pytest.approx(expected, abs=0.501 * unit)


@pytest.mark.parametrize(
    ("gyros", "accelerometers", "statuses"),
    [(3, 6, [0, 0, 0, 4, 4, 4]), (6, 3, [0, 0, 0, 8, 8, 8]), (16, 16, [0] * 16)],
)
def test_any_number_of_sensors_and_those_that_are_absent_say_so(
    tools, gyros, accelerometers, statuses
):
    bench = tools.Bench(gyro_axes_deg=fan(gyros), accelerometer_axes_deg=fan(accelerometers))
    frames = bench.raw_step()
    assert len(frames) <= OUTBOX_CAPACITY
    sent = dict(map(tools.decode, frames))
    assert [sent[f"SENSOR_{k + 1}"]["status"] for k in range(len(statuses))] == statuses
    assert f"SENSOR_{len(statuses) + 1}" not in sent
    for k, status in enumerate(statuses):
        assert (sent[f"SENSOR_{k + 1}"][GYRO] == 0) == (status == 4)
        assert (sent[f"SENSOR_{k + 1}"][ACCELEROMETER] == 0) == (status == 8)


@pytest.mark.parametrize(
    ("gyro_range", "accelerometer_range", "status"),
    [(1e-4, 1e2, 1), (1e4, 1e-4, 2), (1e-4, 1e-4, 3)],
)
def test_saturated_sensors_say_so(tools, gyro_range, accelerometer_range, status):
    bench = tools.Bench(
        gyros=Gyros(range_dps=gyro_range),
        accelerometers=Accelerometers(range_g=accelerometer_range),
    )
    assert bench.step()["SENSOR_1"]["status"] == status


def moving_since(tools, own_epoch, arrives):
    """Return the epoch from which the inner axis moves, told in the frame of `own_epoch`."""
    bench = tools.Bench()
    for epoch in range(own_epoch + 10):
        frames = [tools.command("INNER", own_epoch, 90.0)] if epoch == arrives else []
        if bench.step(frames)["AXIS_INNER_STATUS"]["state"] == AxisState.MOVING:
            return epoch
    return None


@pytest.mark.parametrize("own_epoch", [0, 1, 13, 14, 15, 40])
@pytest.mark.parametrize("late", [1, 2])
def test_a_command_takes_effect_two_epochs_after_its_own_however_late(tools, own_epoch, late):
    assert moving_since(tools, own_epoch, own_epoch + late) == own_epoch + DELAY


@pytest.mark.parametrize("late", [0, 3, 4, 14])
def test_a_command_of_another_epoch_is_refused(tools, late):
    assert moving_since(tools, 20, 20 + late) is None


def growth(tools, frames, epoch=20):
    """Return what frames, taken in an epoch, add to crc and counter errors, and the axis state."""
    bench = tools.Bench()
    for _ in range(epoch):
        bench.step()
    bench.step(frames)
    for _ in range(3):
        state = bench.step()["AXIS_INNER_STATUS"]["state"]
    return int(bench.counters["crc_errors"]), int(bench.counters["counter_errors"]), state


def test_a_corrupted_command_is_counted_and_ignored(tools):
    for bit in range(64):
        frame = tools.command("INNER", 19, 90.0)
        frame["data"] ^= np.uint64(1 << bit)
        assert growth(tools, [frame]) == (1, 0, AxisState.OFF), bit


@pytest.mark.parametrize("counter", [5, 16, 17, 20, 21])
def test_a_command_with_a_wrong_counter_is_counted_and_ignored(tools, counter):
    frames = [tools.command("INNER", counter, 90.0)]
    assert growth(tools, frames) == (0, 1, AxisState.OFF)


@pytest.mark.parametrize("epoch", [0, 1])
@pytest.mark.parametrize("counter", range(15))
def test_what_was_sent_before_the_first_sync_is_neither_used_nor_counted(tools, counter, epoch):
    is_of_epoch_0 = (epoch, counter) == (1, 0)
    found = growth(tools, [tools.command("INNER", counter, 90.0)], epoch)
    assert found == (0, 0, AxisState.MOVING if is_of_epoch_0 else AxisState.OFF)


def test_the_first_of_two_commands_counts(tools):
    frames = [tools.command("INNER", 19, 90.0), tools.command("INNER", 19, what=0)]
    assert growth(tools, frames) == (0, 1, AxisState.MOVING)


def test_commands_that_fail_to_come_are_counted(tools):
    bench = tools.Bench()
    for _ in range(DELAY):
        bench.step()
    assert bench.counters["missing_commands"] == 0
    for _ in range(10):
        bench.step()
    assert bench.counters["missing_commands"] == 2 * 10
    for _ in range(10):
        bench.commanded_step()
    assert bench.counters["missing_commands"] == 2 * 11  # the first was for the epoch after
    assert bench.counters["counter_errors"] == 0


def test_a_turn_goes_on_when_commands_fail_to_come(tools):
    bench = tools.Bench()
    bench.step()
    bench.commanded_step(inner={"target_deg": 1.0})
    for _ in range(400):
        status = bench.step()["AXIS_INNER_STATUS"]
    assert status["encoder_angle_deg"] == pytest.approx(1.0, abs=2e-5)
    assert status["state"] == AxisState.HOLDING


def test_each_axis_obeys_its_own_command(tools):
    bench = tools.Bench()
    bench.step()
    for _ in range(300):
        sent = bench.commanded_step({"target_deg": -10.0}, {"target_deg": 30.0, "rate_dps": 4.0})
    inner, outer = sent["AXIS_INNER_STATUS"], sent["AXIS_OUTER_STATUS"]
    assert inner["encoder_angle_deg"] < -5
    assert outer["encoder_rate_dps"] == pytest.approx(4.0, abs=0.01)
    assert inner["encoder_angle_deg"] == pytest.approx(
        math.degrees(bench.plant["truth"]["axis_angle"][0]), abs=2e-5
    )
    assert bench.plant["truth"]["axis_angle"][1] == bench.plant["axis"][1]["angle"]


def test_the_operator_asks_at_once_and_then_every_cycle(tools):
    bench = tools.Bench(requests=((7, 4), (33, 1), (33, 3)))
    asked = {}
    for epoch in range(100):
        sent = bench.step()
        if "MODE_COMMAND" in sent:
            command = sent["MODE_COMMAND"]
            asked[epoch] = (command["mode_request"], command["alive_counter"])
    cycle = 20  # 100 ms at 200 Hz
    epochs = sorted({*range(0, 100, cycle), 7, 33})
    assert list(asked) == epochs
    assert [request for request, _ in asked.values()] == [0, 4, 4, 3, 3, 3, 3]
    assert [counter for _, counter in asked.values()] == list(range(7))


def test_the_heartbeat_comes_once_a_second(tools):
    bench, beats = tools.Bench(), {}
    for epoch in range(601):
        sent = bench.step()
        if "HEARTBEAT_HARDWARE" in sent:
            beats[epoch] = sent["HEARTBEAT_HARDWARE"]
    assert list(beats) == [0, 200, 400, 600]
    assert [beat["alive_counter"] for beat in beats.values()] == [0, 1, 2, 3]
    assert beats[600]["uptime"] == pytest.approx(3.0, abs=0.5)


def noisy(tools, seed=1):
    bench = tools.Bench(
        seed=seed,
        gyros=Gyros(angle_random_walk_deg_per_sqrt_h=0.03, bias_dph=0.2),
        accelerometers=Accelerometers(white_noise_ug_per_sqrt_hz=100, scale_error_ppm=100),
    )
    sent = b""
    for _ in range(50):
        commands = {"target_deg": 5.0}
        bench.commanded_step(commands, commands)
        sent += bench.hardware.outbox.tobytes()
    return bench.hardware.plant.tobytes(), sent


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(tools):
    assert noisy(tools) == noisy(tools)
    assert noisy(tools)[1] != noisy(tools, seed=2)[1]
