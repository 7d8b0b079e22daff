"""Live faults in a rehearsal: each kind, over the bus and direct, as in a scenario."""

from __future__ import annotations

import can
import e2e
import numpy as np
import pytest
from generate.fault_cases import OF_HARDWARE, ON_WIRE

from rrins.dbc.codec import load
from rrins.dbc.frame import frame_array
from rrins.dbc.values import FaultAction
from rrins.firmware_py.loop import Firmware, own_clock_ns
from rrins.host_tools.bus.address import EMBEDDED, Address
from rrins.host_tools.bus.port import frame_of_message
from rrins.host_tools.errors import BusError, ScenarioError
from rrins.host_tools.hardware.fault_kinds import HardwareFault
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.injection.client import FaultClient
from rrins.host_tools.injection.errors import InjectionError
from rrins.host_tools.injection.fault_report import fault_keys
from rrins.host_tools.injection.messages import fault_commands
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    hardware_settings,
    scenario_wire,
)
from rrins.host_tools.scenario.fault_tables import KINDS
from rrins.host_tools.scenario.scenario import Scenario, fault_of
from rrins.host_tools.testing.errors import BenchError
from rrins.host_tools.wire.fault_kinds import FaultKind

NOISY = {
    "duration_s": 3,
    "navigate_at_s": 0,
    "firmware": {"alignment_s": 0.5, "height_channel": "damped"},
    "body": {"roll_deg": 10},
    "gnss": {"rate_hz": 10, "latency_s": 0},
    "odometer": {},
    "altimeter": {},
    "gyros": {"angle_random_walk_deg_per_sqrt_h": 0.01},
    "accelerometers": {"white_noise_ug_per_sqrt_hz": 10},
}
FIRST = 400  # while the inner axis turns
EPOCHS = 700
RATE_HZ = 200


def _of_each_kind():
    """Return a fault of each kind, as the page of faults shows it first, with its parameter."""
    found = {}
    for case in (*ON_WIRE, *OF_HARDWARE):
        kind = case.fault["kind"].upper()
        entry = FaultKind[kind] if kind in FaultKind.__members__ else HardwareFault[kind]
        parameter = entry.parameter
        default = {} if parameter is None else {parameter.key: parameter.default}
        keys = {key: v for key, v in (default | case.fault).items() if key != "for_s"}
        found.setdefault(kind, {key: v for key, v in keys.items() if v is not None})
    return tuple(found.values())


FAULTS = (
    *_of_each_kind(),
    {"kind": "drop", "message": "SENSOR_3", "probability": 0.3},
    {"kind": "corrupt", "message": "SENSOR_1", "bit": 40},
    {"kind": "axis_runaway", "axis": "outer", "rate_dps": -2.5},
    {"kind": "gyro_bias", "bias_dph": 123.45},
    {"kind": "gyro_shift_u", "sensor": 2, "shift_arcsec": 30.5, "period_s": 0.1, "duty": 0.25},
    {"kind": "accelerometer_dead", "period_s": 0.2, "duty": 0.5},
    {"kind": "odometer_lost", "period_s": 0.4, "duty": 0.5},
    {"kind": "gnss_jump", "direction": "up", "jump_m": -123.0},
)
HARMLESS = {"reorder", "corrupt_wire", "babble", "duplicate"}
HARMLESS |= {
    "power_off"
}  # whoever runs the firmware cuts it: tests/host_tools/testing/test_power.py
HARMLESS |= {kind for kind in KINDS if kind.startswith(("odometer_", "gnss_"))}  # not navigated by


def navigation_of(faults=(), commands=()):
    """Return the digest of a direct run's navigation; commands come for epoch `FIRST`."""
    scenario = Scenario.model_validate(NOISY | {"faults": faults})
    firmware = Firmware(firmware_settings(scenario))
    hardware = Hardware(hardware_settings(scenario), scenario_wire(scenario, is_live=True))
    count = 0
    for epoch in range(EPOCHS):
        inbox = firmware.outbox[:count]
        if epoch == FIRST:
            others = frame_array(len(commands))
            for frame, message in zip(others, commands, strict=True):
                frame_of_message(frame, message)
            inbox = np.concatenate([others, inbox])
        frames, sent = hardware.open_epoch(epoch, inbox, len(inbox))
        count = firmware.step_whole(frames, sent, own_clock_ns(epoch * hardware.period_ns, 0.0))
    return firmware.trace.sha256()


@pytest.fixture(scope="module")
def undisturbed():
    return navigation_of()


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault["kind"])
def test_a_live_fault_is_the_same_as_in_the_scenario(undisturbed, fault):
    lasting = fault | {"for_s": 0.5}
    planned = navigation_of(faults=[lasting | {"at_s": FIRST / RATE_HZ}])
    commands = fault_commands(FaultAction.INJECT, fault_of(lasting))
    assert navigation_of(commands=commands) == planned
    assert (planned == undisturbed) == (fault["kind"] in HARMLESS)


def test_each_kind_is_put_in_listed_and_taken_out_over_the_bus(world):
    with world.client() as client:
        assert client.report().faults == ()
        for keys in FAULTS:
            if keys["kind"] == "power_off":
                continue  # the rehearsal of all these tests would begin anew
            fault = fault_of(keys)
            active, report = client.inject(fault)
            assert active.keys == fault_keys(fault) | keys
            assert active.duration_ms == 0
            assert report.epoch >= active.first_epoch
            assert report.faults == (active,)
            again = client.report()
            assert again.faults == report.faults
            assert again.epoch > report.epoch
            assert client.remove(fault).faults == ()
    assert world.bench.messages("HARDWARE_FAULT_STATUS")[-1]["active_faults"] == 0


def test_several_at_once_and_all_taken_out(world):
    with world.client() as client:
        for keys in FAULTS[-8:-4]:
            active, report = client.inject(fault_of(keys | {"for_s": 60}))
        assert active.duration_ms == 60_000
        listed = report.as_dict()
        assert listed["active_faults"] == 4
        assert [fault["of"] for fault in listed["faults"]] == ["hardware"] * 2 + ["wire"] * 2
        for fault in listed["faults"]:
            kept = {k: v for k, v in fault.items() if k not in ("of", "since_epoch")}
            scenario = fault_of(kept)  # as it stands, a table of a scenario
            assert round(scenario.at_s * RATE_HZ) == fault["since_epoch"]
        assert client.clear().faults == ()


def test_what_cannot_be_put_in_is_said_and_nothing_changes(world):
    with world.client() as client:
        for keys, words in (
            ({"kind": "gyro_bias", "sensor": 9}, r"gyro_bias \(sensor 9\): .* has no such axis"),
            ({"kind": "drop", "for_s": 100}, "at most 65.535 s"),
        ):
            with pytest.raises(InjectionError, match=words):
                client.inject(fault_of(keys))
        with pytest.raises(InjectionError, match=r"axis_stall \(axis inner\): .* not active"):
            client.remove(fault_of({"kind": "axis_stall", "axis": "inner"}))
        assert client.report().faults == ()


def test_a_fault_by_its_keys(world):
    with world.client() as client:
        by_words, _ = client.inject("gyro_bias", sensor=3, bias_dph=20)
        by_keys, report = client.inject({"kind": "gyro_bias", "sensor": 2, "bias_dph": 20.0})
        assert [one.keys["sensor"] for one in (by_words, by_keys)] == [3, 2]
        assert len(report.faults) == 2
        assert len(client.remove("gyro_bias", sensor=3).faults) == 1
        for kind, keys, words in (
            ("gyro_bais", {}, "did you mean gyro_bias"),
            ("gyro_bias", {"bias": 2}, "bias: no such key, did you mean bias_dph"),
            ({"kind": "gyro_bias", "at_s": 5}, {}, "at_s: 5, but a live fault begins at once"),
        ):
            with pytest.raises((ScenarioError, InjectionError), match=words):
                client.inject(kind, **keys)


def test_a_fault_ends_by_itself(world):
    with world.client() as client:
        client.inject(fault_of({"kind": "gyro_absent", "sensor": 1, "for_s": 0.05}))
    world.bench.advance(0.1)
    world.bench.expect("SENSOR_1", within=0.01, where={"status": "OK"})


def test_a_frame_made_by_another_tool_is_obeyed(world):
    layout = load().database.get_message_by_name("HARDWARE_FAULT_COMMAND")
    data = bytearray(
        layout.encode(
            {
                "crc": 0,
                "alive_counter": 5,
                "action": "INJECT",
                "kind": "GYRO_ABSENT",
                "target": 3,
                "exponent": 0,
                "value": 0,
                "duration_ms": 0,
            }
        )
    )
    e2e.p01.e2e_p01_protect(data, 0x59F2, increment_counter=False)
    message = can.Message(arbitration_id=0x7F2, is_extended_id=False, data=bytes(data))
    with world.going(), can.Bus(world.address.channel, interface="rrins", host="never") as bus:
        bus.set_filters([{"can_id": 0x7F3, "can_mask": 0x7FF}])
        bus.send(message)
        assert bus.recv(10) is not None
    values = world.bench.last("HARDWARE_FAULT_STATUS")
    assert (values["answers"], values["active_faults"]) == (5, 1)
    world.bench.expect("SENSOR_3", within=0.01, where={"status": "GYRO_ABSENT"})


def test_nobody_answers_on_a_bus_without_hardware(rrins_channel, rrins_bus):
    with (
        FaultClient(Address(EMBEDDED, rrins_channel), patience_s=0.1) as client,
        pytest.raises(InjectionError, match=r"no emulated hardware answered within 0\.1 s"),
    ):
        client.report()


@pytest.mark.slow
def test_a_rehearsal_of_processes(start):
    command = start(
        "rehearse", "ideal", "--channel", "live", "--speed", 20, "--duration", 60, "--out", "out"
    )
    command.wait_for_line("running")
    with command.paused():
        bus = can.Bus("live", interface="rrins", host="never", role="observer")
        injector = FaultClient(Address(EMBEDDED, "live"), patience_s=60)
    with bus, injector as client:
        bus.set_filters([{"can_id": load().frame_id("NAV_LATITUDE"), "can_mask": 0x7FF}])
        assert bus.recv(60) is not None
        fault = fault_of({"kind": "silence", "node": "hardware", "for_s": 1})
        active, _ = client.inject(fault)
        assert active.keys == {"kind": "silence", "node": "hardware"}
    with FaultClient(Address(EMBEDDED, "live"), patience_s=60) as client:
        code, _ = command.finish()
        with pytest.raises(BusError, match="bus rrins:live: channel 'live'"):
            client.report()
    assert code == 8
    assert command.said[-1] == "rrins: the firmware ended in FAULT: SENSORS_LOST"


def test_a_bench_takes_faults_out_one_by_one(rrins_bench):
    bench = rrins_bench(NOISY, way="direct")
    bench.inject("gyro_absent", sensor=2)
    bench.inject("drop", message="SENSOR_4")
    bench.inject("encoder_stuck", axis="inner")
    bench.advance(0.1)
    assert bench.last("HARDWARE_FAULT_STATUS")["active_faults"] == 2
    bench.remove_fault("gyro_absent", sensor=2)
    bench.remove_fault("drop", message="SENSOR_4")
    bench.expect("SENSOR_2", within=0.005, where={"status": "OK"})
    bench.expect("SENSOR_4", within=0.005)
    with pytest.raises(BenchError, match="drop: NOT_ACTIVE"):
        bench.remove_fault("drop", message="SENSOR_4")
    bench.clear_faults()
    bench.advance(0.005)
    assert bench.last("HARDWARE_FAULT_STATUS")["active_faults"] == 0


def test_a_bench_refuses_what_cannot_be(rrins_bench):
    bench = rrins_bench(NOISY, way="direct")
    with pytest.raises(BenchError, match="gyro_bias: NO_SUCH_TARGET"):
        bench.inject("gyro_bias", sensor=5)
    with pytest.raises(ScenarioError, match="begins at once"):
        bench.inject("gyro_bias", at_s=3)
    with pytest.raises(ScenarioError, match="axis: is missing"):
        bench.inject("axis_stall")
