"""Every fault sets its trouble code, and no other."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.dbc.frame import ERR_FLAG, frame_array
from rrins.firmware_py.core.modes.modes import FirmwareFault, Mode, ModeRequest
from rrins.firmware_py.core.records.troubles import Status, SystemFault
from rrins.firmware_py.core.settings import OdometerSettings
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.parameter_memory import ParameterMemory

HEALING = 403  # epochs from 127 over 0 to -128, a second each


def without(index):
    return lambda frames: [*frames[:index], *frames[index + 1 :]]


def sensor_frame(tools, bench, group, counter=None, **raws):
    """Return a frame of a sensor group as it would be sent, changed."""
    gyro, accelerometer = bench.counts(bench.epoch)
    values = {"gyro_dtheta": gyro[group - 1], "accelerometer_dv": accelerometer[group - 1]}
    counter = bench.epoch if counter is None else counter
    return tools.frame(f"SENSOR_{group}", counter, **(values | raws))


def replaced(tools, bench, group, **changes):
    def change(frames):
        frames[group] = sensor_frame(tools, bench, group, **changes)
        return frames

    return change


def test_a_sound_computer_has_no_trouble(at):
    bench = at()
    bench.run(2100)
    assert bench.failed(Status.TEST_FAILED_SINCE_LAST_CLEAR) == set()
    incomplete = bench.failed(Status.TEST_NOT_COMPLETED_SINCE_LAST_CLEAR)
    assert incomplete == {  # there was no occasion
        "mode_command_silent",
        "axis_inner_not_following",
        "axis_outer_not_following",
        # a computer whose set-up does not compare its sensors
        "gyros_not_redundant",
        "accelerometers_not_redundant",
        "gyro_calibration_drifted",
        "accelerometer_calibration_drifted",
        *(f"{kind}_{k}_left_out" for kind in ("gyro", "accelerometer") for k in range(1, 5)),
    }


FRAME_FAULTS = {
    "silent": (lambda tools, bench: without(2), 20),
    "stale": (
        lambda tools, bench: (
            lambda frames: replaced(tools, bench, 2, counter=bench.epoch - 1)(frames)
        ),
        10,
    ),
    "crc": (lambda tools, bench: lambda frames: [*frames[:2], harmed(frames[2]), *frames[3:]], 5),
    "counter": (lambda tools, bench: lambda frames: [*frames, frames[2]], 5),
}


def harmed(frame):
    frame = frame.copy()
    frame["data"] ^= np.uint64(1 << 40)
    return frame


@pytest.mark.parametrize("fault", FRAME_FAULTS)
def test_faults_of_a_sensors_frames(at, tools, fault):
    bench = at(bridge_s=10.0)
    make, epochs = FRAME_FAULTS[fault]
    bench.run(epochs - 1, make(tools, bench))
    assert bench.failed() == set()
    bench.run(1, make(tools, bench))
    assert bench.failed() == {f"sensor_2_{fault}"}
    bench.run(HEALING)
    assert bench.failed() == set()
    assert bench.failed(Status.CONFIRMED) == {f"sensor_2_{fault}"}


@pytest.mark.parametrize(
    ("status", "name", "epochs"),
    [
        (1, "gyro_3_saturated", 10),
        (2, "accelerometer_3_saturated", 10),
        (4, "gyro_3_absent", 20),
        (8, "accelerometer_3_absent", 20),
    ],
)
def test_what_a_sensor_says_of_itself(at, tools, status, name, epochs):
    bench = at()
    bench.run(epochs - 1, lambda frames: replaced(tools, bench, 3, status=status)(frames))
    assert bench.failed() == set()
    bench.run(1, lambda frames: replaced(tools, bench, 3, status=status)(frames))
    assert bench.failed() == {name}


class Noise:
    """Counts with noise upon them, one sensor's standing still if wanted."""

    def __init__(self, tools, bench, gyro=0, accelerometer=0, sigma=25.0):
        self.tools, self.bench, self.stuck, self.sigma = tools, bench, (gyro, accelerometer), sigma
        self.random = np.random.default_rng(4)

    def __call__(self, frames):
        gyros, accelerometers = self.bench.counts(self.bench.epoch)
        for k in range(1, 1 + len(gyros)):
            gyro = gyros[k - 1] + round(self.random.normal(0, self.sigma))
            accelerometer = accelerometers[k - 1] + round(self.random.normal(0, self.sigma))
            gyro = 37 if self.stuck[0] == k else gyro
            accelerometer = accelerometers[k - 1] // 10 if self.stuck[1] == k else accelerometer
            frames[k] = sensor_frame(
                self.tools, self.bench, k, gyro_dtheta=gyro, accelerometer_dv=accelerometer
            )
        return frames


@pytest.mark.parametrize(
    ("stuck", "name"),
    [({"gyro": 2}, "gyro_2_stuck"), ({"accelerometer": 4}, "accelerometer_4_stuck")],
)
def test_a_sensor_that_always_says_the_same_while_the_others_vary(at, tools, stuck, name):
    bench = at(Mode.STANDBY)
    bench._accelerometer = np.rint(bench._accelerometer)
    noise = Noise(tools, bench, **stuck)
    bench.run(390, noise)
    assert bench.failed() == set()
    bench.run(150, noise)
    assert bench.failed() == {name}
    noise.stuck = (0, 0)
    bench.run(HEALING, noise)
    assert bench.failed() == set()


def test_sensors_that_stand_in_peace_are_not_stuck(at, tools):
    bench = at(Mode.STANDBY)
    bench._gyro, bench._accelerometer = np.rint(bench._gyro), np.rint(bench._accelerometer)
    bench.run(1000)
    assert bench.failed() == set()


def test_with_three_sensors_the_one_that_stands_is_stuck(at, tools):
    axes = ((90.0, 0.0), (90.0, 90.0), (0.0, 0.0))
    bench = at(Mode.STANDBY, gyro_axes_deg=axes, accelerometer_axes_deg=axes)
    bench.run(600, Noise(tools, bench, gyro=3))
    assert bench.failed() == {"gyro_3_stuck"}


def test_noise_is_not_stuck(at, tools):
    bench = at(Mode.STANDBY)
    bench.run(1000, Noise(tools, bench, sigma=1.0))
    assert bench.failed() == set()


def axis_frames(tools, bench, axis=0, **raws):
    name = ("AXIS_INNER_STATUS", "AXIS_OUTER_STATUS")[axis]

    def change(frames):
        frames[axis - 2] = tools.frame(name, bench.epoch, **({"state": 1} | raws))
        return frames

    return change


def turning(tools, bench, angle_deg):
    """Step with the inner axis turning at 10 °/s."""
    raw = round(angle_deg / tools.scale_of("AXIS_INNER_STATUS", "encoder_angle_deg"))
    change = axis_frames(tools, bench, 0, encoder_angle_deg=raw, encoder_rate_dps=5000)
    bench.step(change(bench.frames()))


@pytest.mark.parametrize(
    ("trouble", "made", "epochs", "change"),
    [
        ("axis_inner_not_following", {"mode": Mode.NAVIGATION_ROTATING}, 60, lambda frames: frames),
        ("axis_inner_silent", {}, 20, without(-2)),
        ("sync_silent", {"bridge_s": 10.0, "axis_silence_s": 10.0}, 30, lambda frames: []),
        ("sync_crc", {}, 9, lambda frames: [harmed(frames[0]), *frames[1:]]),
    ],
)
def test_only_what_is_to_blame_is_told(at, trouble, made, epochs, change):
    bench = at(**made)
    bench.run(epochs, change)
    assert bench.failed() == {trouble}


def test_a_drive_that_reports_a_fault(at, tools):
    bench = at()
    bench.run(10, lambda frames: axis_frames(tools, bench, 1, state=4)(frames))
    assert bench.failed() == {"axis_outer_drive"}


def test_an_encoder_that_jumps(at):
    bench = at()
    bench.state["parameters"]["axis_acceleration_dps2"] = 10.0
    bench.axes_deg[1] = 30.0
    bench.step()
    assert bench.failed() == {"axis_outer_encoder"}


def test_an_encoder_that_begins_anew_after_64_turns_does_not_jump(at, tools):
    bench = at()
    span = 64 * 360.0
    for k in range(40):
        turning(tools, bench, span / 2 + 0.05 * (k - 20))
    assert "axis_inner_encoder" not in bench.failed()


def test_an_axis_that_turns_too_fast(at, tools):
    bench = at()
    bench.state["parameters"]["turn_rate_dps"] = 2.0
    for k in range(30):
        turning(tools, bench, 0.05 * k)
    assert bench.failed() == {"axis_inner_limit"}


def test_the_operator_who_went(at, tools):
    bench = at()
    for k in range(100):
        command = tools.frame("MODE_COMMAND", k, mode_request=ModeRequest.NAVIGATE_STRAPDOWN)
        bench.step([*bench.frames(), command] if k % 20 == 0 else None)
    assert bench.failed() == set()
    bench.run(260)
    assert bench.failed() == {"mode_command_silent"}


def test_overruns(at):
    bench = at()
    for _ in range(3):
        bench.state["faults"]["overruns"] += 1
        bench.run(5)
    assert bench.failed() == {"overrun"}


def test_a_bus_that_is_full(at):
    bench = at()
    strangers = frame_array(30)
    strangers["can_id"], strangers["length"] = 0x555, 8
    bench.run(400, lambda frames: [*frames, *strangers])
    assert bench.failed() == {"bus_load"}
    answer = bench.firmware.diagnostics.server.handle(bytes.fromhex("220104"), False, 0)
    load = table.identifier("load").decode(answer[3:])
    assert load["frames_per_epoch"] == pytest.approx(39.6, abs=1)
    assert load["bus_load_percent"] == pytest.approx(99, abs=3)  # 40 of 125 bits in 5 ms


@pytest.mark.parametrize(
    ("can_id", "byte_1", "name"),
    [(0x004, 0x10, "error_passive"), (0x004, 0x20, "error_passive"), (0x040, 0, "bus_off")],
)
def test_a_controller_in_trouble(at, can_id, byte_1, name):
    bench = at()

    def error(can_id, byte_1):
        frames = frame_array(1)
        frames["can_id"], frames["length"], frames["data"] = ERR_FLAG | can_id, 8, byte_1 << 8
        return list(frames)

    bench.step([*error(can_id, byte_1), *bench.frames()])
    assert bench.failed() == {name}
    bench.step([*error(0x100, 0), *bench.frames()])
    bench.run(HEALING)
    assert name not in bench.failed()


def test_a_self_test_that_fails(tools):
    bench = tools.Bench()
    bench.run(2010, without(3))
    assert bench.mode == Mode.FAULT
    assert bench.failed() == {"self_test_failed", "sensor_3_silent"}


def test_an_alignment_that_fails(tools):
    bench = tools.Bench(initial_attitude="self-aligned")
    bench._accelerometer = bench._accelerometer * 1.1
    bench.run_to(Mode.FAULT, ModeRequest.NAVIGATE_STRAPDOWN)
    assert bench.failed() == {"alignment_failed"}


def test_an_alignment_that_takes_too_long(tools):
    bench = tools.Bench(alignment_s=1.0)
    bench.run_to(Mode.ALIGNMENT, ModeRequest.NAVIGATE_STRAPDOWN)
    for _ in range(450):
        bench.state["alignment"]["epochs"] = 1  # it never gets anywhere
        bench.step()
    assert bench.failed() - {"mode_command_silent"} == {"alignment_not_converged"}


def test_sensors_that_are_lost(at):
    bench = at()
    bench.run(30, lambda frames: [frames[0], *frames[5:]])
    assert bench.state["modes"]["fault"] == FirmwareFault.SENSORS_LOST
    silent = {f"sensor_{k}_silent" for k in range(1, 5)}
    assert bench.failed() == {"sensors_lost"} | silent


def test_a_navigation_that_no_vehicle_can_have(at):
    bench = at()
    bench.state["ins"]["velocity_n"][0] = 4000.0
    bench.step()
    assert bench.failed() == {"navigation_implausible"}


def test_a_clock_that_runs_off(at):
    bench = at()
    period_ns = bench.period_ns
    own_ns = bench.epoch * period_ns
    for _ in range(1400):
        own_ns += round(period_ns * 1.0005)
        frames = np.array(bench.frames())
        bench.firmware.step(frames, 0, len(frames), own_ns)
        bench.epoch += 1
    assert "clock_off_nominal" in bench.failed()


def test_a_sync_that_jumps(at):
    bench = at()
    bench.epoch += 1000
    bench.run(3)
    assert "clock_jump" in bench.failed()


@pytest.mark.parametrize(
    ("fault", "name"),
    [
        (SystemFault.PARAMETER_COPY_DAMAGED, "parameter_copy_damaged"),
        (SystemFault.PARAMETERS_LOST, "parameters_lost"),
        (SystemFault.PARAMETER_OUT_OF_LIMITS, "parameter_out_of_limits"),
    ],
)
def test_a_parameter_memory_in_trouble(at, monkeypatch, fault, name):
    load = ParameterMemory.load

    def damaged(memory):
        load(memory)
        memory.faults = 1 << fault

    monkeypatch.setattr(ParameterMemory, "load", damaged)
    bench = at(Mode.SELF_TEST)
    bench.run(2)
    assert bench.failed() == {name}


GNSS_GROUP = ("GNSS_TIME", "GNSS_LATITUDE", "GNSS_LONGITUDE", "GNSS_HEIGHT", "GNSS_VELOCITY")
AIDS = {  # the computer's settings, and the messages that come every 20 epochs
    "altimeter": ({"altimeter": True}, ("ALTIMETER",)),
    "gnss": ({"gnss_interval_s": 0.1}, GNSS_GROUP),
    "odometer": (
        {"odometer": OdometerSettings(interval_s=0.1, metres_per_pulse=0.01)},
        ("ODOMETER",),
    ),
}


@pytest.fixture
def aided(at, tools):
    """Return what makes a bench with an aid, and steps it with or without the aid's frames."""

    def make(aid):
        settings, names = AIDS[aid]
        bench = at(**settings)

        def step(epochs, comes=True, change=lambda frame: frame, valid=1):
            for k in range(epochs):
                frames = bench.frames()
                values = {
                    "ALTIMETER": {"height": 40_000},
                    "GNSS_TIME": {"quality": 2, "time_us": bench.epoch * 5000},
                    "ODOMETER": {"valid": valid},
                }
                if comes and k % 20 == 0:
                    sent = (tools.frame(n, bench.epoch, **values.get(n, {})) for n in names)
                    frames += map(change, sent)
                bench.step(frames)

        return bench, step

    return make


@pytest.mark.parametrize(
    ("aid", "epochs", "troubles"),
    [
        ("altimeter", 150, {"altimeter_silent"}),
        ("gnss", 150, {"gnss_silent", "gnss_lost"}),
        ("odometer", 101, {"odometer_lost"}),
        ("odometer", 161, {"odometer_lost", "odometer_silent"}),
    ],
)
def test_an_aid_that_is_silent(aided, aid, epochs, troubles):
    bench, step = aided(aid)
    step(600)  # none came while the bench began
    assert bench.failed() == set()
    step(epochs, comes=False)
    assert bench.failed() == troubles
    step(HEALING + 40)
    assert bench.failed() == set()


@pytest.mark.parametrize("aid", AIDS)
def test_an_aid_whose_frames_are_harmed(aided, aid):
    bench, step = aided(aid)
    step(200, change=harmed)
    assert f"{aid}_crc" in bench.failed()


def test_an_odometer_that_does_not_count(aided):
    bench, step = aided("odometer")
    step(100)
    step(120, valid=0)
    assert bench.failed() == {"odometer_lost"}
