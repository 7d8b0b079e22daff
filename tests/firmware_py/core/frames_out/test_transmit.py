"""Frames of the firmware: order, cycle times, counters, protection and values."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.dbc.e2e import COUNTER_MODULUS, crc_holds
from rrins.firmware_py.core.frames_out.transmit import OUTBOX_CAPACITY, transmit
from rrins.firmware_py.core.modes.modes import Mode, ModeRequest
from rrins.firmware_py.core.records.calibration_records import DriftSize, DriftState
from rrins.firmware_py.core.redundancy.settings import DataSheet, RedundancySettings

CYCLIC = {"HEARTBEAT_FIRMWARE", "FIRMWARE_STATUS", "FIRMWARE_FAULTS"}
NAVIGATION = ["NAV_LATITUDE", "NAV_LONGITUDE", "NAV_VELOCITY", "NAV_HEIGHT", "NAV_ATTITUDE"]
AXES = ["AXIS_INNER_COMMAND", "AXIS_OUTER_COMMAND"]


@pytest.fixture
def navigating(tools):
    bench = tools.Bench(heading_deg=123.0, pitch_deg=-4.0, roll_deg=5.0, follow_tolerance_deg=180.0)
    bench.run_to(Mode.NAVIGATION_STRAPDOWN, ModeRequest.NAVIGATE_STRAPDOWN)
    return bench


def run(bench, epochs):
    """Return (epoch, frame) of everything that is sent."""
    return [(bench.firmware.epoch, frame) for _ in range(epochs) for frame in bench.step()]


def messages_of(tools, frames):
    return [tools.decode(frame)[0] for frame in frames]


def test_the_command_of_the_outer_axis_is_always_the_last(tools, navigating):
    for _ in range(210):
        sent = navigating.step()
        assert messages_of(tools, sent)[-2:] == AXES
        assert len(sent) <= OUTBOX_CAPACITY


@pytest.mark.parametrize("rate_hz", [50, 200, 1000])
def test_every_message_keeps_the_cycle_of_the_dbc(tools, rate_hz):
    bench = tools.Bench(rate_hz=rate_hz, alignment_s=0.02)
    bench.run_to(Mode.NAVIGATION_STRAPDOWN, ModeRequest.NAVIGATE_STRAPDOWN)
    epochs: dict[str, list[int]] = {}
    for epoch, frame in run(bench, 2 * rate_hz + 1):
        epochs.setdefault(tools.decode(frame)[0], []).append(epoch)
    assert set(epochs) == CYCLIC | set(NAVIGATION) | set(AXES)
    for name, sent in epochs.items():
        cycle_ms = tools.codec.database.get_message_by_name(name).cycle_time
        every = 1 if name in AXES else round(cycle_ms * rate_hz / 1000)
        assert set(np.diff(sent)) == {every}, name
        assert not any(epoch % every for epoch in sent), name


def test_navigation_is_sent_while_navigating_only(tools):
    bench = tools.Bench()
    names = [tools.decode(frame)[0] for _, frame in run(bench, 150)]
    assert bench.mode == Mode.STANDBY
    assert set(names) == CYCLIC | set(AXES)


def test_every_frame_is_protected(tools, contract, navigating):
    for _, frame in run(navigating, 250):
        row = tools.codec.messages[tools.codec.message_index(tools.decode(frame)[0])]
        assert crc_holds(frame, row)
        assert frame["length"] == row["length"]
        assert not frame["flags"] | frame["reserved"] | frame["raw_dlc"]


@pytest.mark.slow
def test_counters_go_on_without_a_gap(tools, navigating):
    counters: dict[str, list[int]] = {}
    for epoch, frame in run(navigating, 3400):
        name, values = tools.decode(frame)
        counters.setdefault(name, []).append(values["alive_counter"])
        if name in AXES:
            assert values["alive_counter"] == epoch % COUNTER_MODULUS
    for name, sent in counters.items():
        assert set(np.diff(sent) % COUNTER_MODULUS) == {1}, name
        assert max(sent) == COUNTER_MODULUS - 1, name


def test_navigation_frames_carry_the_navigation(tools, navigating):
    ins = navigating.state["ins"]
    ins["velocity_n"][:2] = -1.25, 17.5
    ins["latitude"], ins["longitude"] = math.radians(-33.25), math.radians(-151.5)
    while not (sent := dict(map(tools.decode, navigating.step()))).keys() >= set(NAVIGATION):
        pass
    output = navigating.state["navigation"]
    degrees = {name: math.degrees(output[name]) for name in ("roll", "pitch", "heading")}
    assert degrees == pytest.approx({"roll": 5.0, "pitch": -4.0, "heading": 123.0}, abs=1e-3)
    expected = {
        "NAV_LATITUDE": {"latitude_deg": math.degrees(output["latitude"])},
        "NAV_LONGITUDE": {"longitude_deg": math.degrees(output["longitude"])},
        "NAV_VELOCITY": {
            "velocity_east": output["velocity_n"][0],
            "velocity_north": output["velocity_n"][1],
        },
        "NAV_HEIGHT": {"height": output["height"], "velocity_up": output["velocity_n"][2]},
        "NAV_ATTITUDE": {f"{name}_deg": value for name, value in degrees.items()},
    }
    for message, values in expected.items():
        for name, value in values.items():
            unit = tools.scale_of(message, name)
            assert sent[message][name] == pytest.approx(value, abs=0.51 * unit), name
    assert sent["NAV_LATITUDE"]["epoch"] == navigating.firmware.epoch % 4096
    assert sent["NAV_LONGITUDE"]["epoch"] == navigating.firmware.epoch % 4096


@pytest.mark.parametrize(
    ("field", "value", "message", "name"),
    [
        ("heading", math.nextafter(2 * math.pi, 0), "NAV_ATTITUDE", "heading_deg"),
        ("roll", -math.pi, "NAV_ATTITUDE", "roll_deg"),
        ("roll", math.pi, "NAV_ATTITUDE", "roll_deg"),
        ("pitch", math.pi / 2, "NAV_ATTITUDE", "pitch_deg"),
        ("longitude", -math.pi, "NAV_LONGITUDE", "longitude_deg"),
        ("longitude", math.nextafter(math.pi, 0), "NAV_LONGITUDE", "longitude_deg"),
        ("latitude", -math.pi / 2, "NAV_LATITUDE", "latitude_deg"),
    ],
)
def test_the_ends_of_the_ranges_can_be_sent(tools, contract, field, value, message, name):
    bench = tools.Bench()
    bench.state["modes"]["mode"] = Mode.NAVIGATION_STRAPDOWN
    bench.state["epoch"] = 0
    bench.state["navigation"][field] = value
    count = transmit(bench.state, contract[0], bench.firmware.outbox)
    sent = dict(map(tools.decode, bench.firmware.outbox[:count]))
    difference = sent[message][name] - math.degrees(value)
    # A whole turn less half a unit is limited to the largest value: a unit off, not a whole turn.
    assert math.remainder(difference, 360) == pytest.approx(
        0, abs=1.01 * tools.scale_of(message, name)
    )


def status_of(tools, bench, message="FIRMWARE_STATUS"):
    while True:
        sent = dict(map(tools.decode, bench.step()))
        if message in sent:
            return sent[message]


def test_the_status_says_what_is_going_on(tools, navigating):
    state = navigating.state
    state["load_percent"] = 12.5
    status = status_of(tools, navigating)
    assert status["mode"] == Mode.NAVIGATION_STRAPDOWN
    assert status["fault"] == status["sync_lost"] == status["scheme_position"] == 0
    assert status["usable_sensors"] == 4
    assert status["load_percent"] == pytest.approx(12.5, abs=0.5)
    assert status["clock_error_ppm"] == pytest.approx(0, abs=0.1)
    navigating.step(request=ModeRequest.NAVIGATE_ROTATING)
    state["sequencer"]["cycle"] = 4097
    state["sequencer"]["position"] = 15
    state["sequencer"]["not_following"][1] = 1
    status = status_of(tools, navigating)
    assert (status["scheme_position"], status["scheme_cycle"]) == (16, 1)
    assert (status["axis_inner_not_following"], status["axis_outer_not_following"]) == (0, 1)


def test_the_status_counts_the_sensor_groups_used(tools, navigating):
    while True:
        frames = navigating.frames()
        frames[1] = tools.frame("SENSOR_1", navigating.epoch, status=1)
        frames[2] = tools.frame("SENSOR_2", navigating.epoch, status=2)
        sent = dict(map(tools.decode, navigating.step(frames)))
        if "FIRMWARE_STATUS" in sent:
            break
    assert sent["FIRMWARE_STATUS"]["usable_sensors"] == 2


def test_the_status_reports_the_loss_of_sync(tools, navigating):
    lost = []
    for _ in range(60):
        for name, values in map(tools.decode, navigating.step(navigating.frames()[1:])):
            if name == "FIRMWARE_STATUS":
                lost.append(values["sync_lost"])
    assert lost[-1] == 1
    assert navigating.mode == Mode.NAVIGATION_STRAPDOWN
    assert status_of(tools, navigating)["sync_lost"] == 0


def test_fault_counters_stay_at_their_largest(tools, navigating):
    names = ("crc_errors", "counter_errors", "missing_frames", "bridged_epochs", "overruns")
    for k, name in enumerate(names):
        navigating.state["faults"][name] = k + 1
    faults = status_of(tools, navigating, "FIRMWARE_FAULTS")
    assert [faults[name] for name in names] == [1, 2, 3, 4, 5]
    for name in names:
        navigating.state["faults"][name] = 1 << 40
    faults = status_of(tools, navigating, "FIRMWARE_FAULTS")
    for name in names:
        row = tools.codec.signals[tools.codec.signal_index("FIRMWARE_FAULTS", name)]
        assert faults[name] == row["raw_maximum"], name


def test_the_sizes_of_a_drift_are_those_of_the_dbc(tools):
    for message in ("GYRO_REDUNDANCY", "ACCELEROMETER_REDUNDANCY"):
        choices = tools.codec.choices(message, "drift")
        assert {int(size): size.name for size in DriftSize} == choices


def sizes_told(tools, bench):
    """Return the sizes of the drifts that are sent next, of gyros and accelerometers."""
    while True:
        sent = dict(map(tools.decode, bench.step()))
        if "GYRO_REDUNDANCY" in sent:
            names = ("GYRO_REDUNDANCY", "ACCELEROMETER_REDUNDANCY")
            return [DriftSize(int(sent[name]["drift"])).name for name in names]


def test_a_drift_is_told_by_its_size(tools):
    four = (0.0,) * 4
    sheet = DataSheet(
        white_noise=(1e-4,) * 4,
        bias_instability=four,
        rate_random_walk=four,
        temperature_drift=four,
        bias_limit=1.0,
    )
    bench = tools.Bench(redundancy=RedundancySettings(gyros=sheet, accelerometers=sheet))
    gyros, accelerometers = (
        bench.state["calibration"]["gyros"],
        bench.state["calibration"]["accelerometers"],
    )
    for state in DriftState:  # only what is found to have drifted, however much has been learned
        gyros["state"], gyros["change"] = int(state), 50e-6
        size = "FROM_40_TO_80_PPM" if state == DriftState.DRIFTED else "NOT"
        assert sizes_told(tools, bench) == [size, "NOT"]
    accelerometers["state"] = int(DriftState.DRIFTED)
    for name in [size.name for size in DriftSize][1:]:
        bounds = [1e-6 * float(word) for word in name.split("_") if word.isdigit()]
        low, high = bounds[0], bounds[-1]
        inside = {"BELOW": (0.0, 0.999 * low), "ABOVE": (1.001 * high, 1.0)}
        for change in inside.get(name.split("_")[0], (1.001 * low, 0.999 * high)):
            accelerometers["change"] = change
            assert sizes_told(tools, bench) == ["FROM_40_TO_80_PPM", name]


def test_axis_commands_carry_the_scheme(tools, navigating):
    sent = dict(map(tools.decode, navigating.step(request=ModeRequest.NAVIGATE_ROTATING)))
    assert sent["AXIS_INNER_COMMAND"]["command"] == 2
    assert sent["AXIS_INNER_COMMAND"]["target_angle_deg"] == pytest.approx(180.0)
    assert sent["AXIS_INNER_COMMAND"]["rate_limit_dps"] == pytest.approx(60.0)
    assert sent["AXIS_OUTER_COMMAND"]["target_angle_deg"] == 0


def test_the_heartbeat_tells_the_time_since_power_on(tools):
    bench = tools.Bench()
    for _ in range(401):
        sent = dict(map(tools.decode, bench.step()))
    assert sent["HEARTBEAT_FIRMWARE"]["uptime"] == pytest.approx(2.0, abs=1.0)
