"""Faults on the wire: each is noticed and counted, and no wrong value is ever used."""

from __future__ import annotations

from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dbc.codec import load
from dbc.frame import frame_array
from dbc.values import FaultAction
from host_tools import fault_table
from host_tools.direct import run_direct
from host_tools.errors import ScenarioError
from host_tools.fault_tables import FaultOnWire
from host_tools.faults import Fault, FaultKind, Faults, Node
from host_tools.injection.errors import InjectionError
from host_tools.injection.messages import fault_commands
from host_tools.scenario import Scenario, fault_of

DOCS = Path(__file__).parents[2] / "docs"
ROTATING = "NAVIGATION_ROTATING"


@pytest.fixture(scope="module")
def table():
    return {row.injected: row for row in fault_table.rows()}


def test_the_page_in_docs_is_current(table):
    assert (DOCS / "faults.md").read_text(encoding="utf-8") == fault_table.page(
        list(table.values())
    ), "run `make docs`"


@pytest.mark.parametrize(
    ("injected", "counter", "mode"),
    [
        ("SENSOR_3 lost for 5 s", "firmware missing_frames", ROTATING),
        ("1 % of all frames lost", "firmware missing_frames", ROTATING),
        ("SENSOR_2 10 ms late for 1 s", "firmware counter_errors", ROTATING),
        ("every frame twice for 5 s", "firmware counter_errors", ROTATING),
        ("a bit wrong past CRC-15, SENSOR_1 for 5 s", "firmware crc_errors", ROTATING),
        ("10 % of all frames with a wrong bit", "hardware crc_errors", ROTATING),
        ("wrong counter, SENSOR_4 for 5 s", "firmware counter_errors", ROTATING),
        ("SYNC lost for 5 s", "firmware missing_frames", ROTATING),
        ("hardware silent for 50 ms", "firmware bridged_epochs", ROTATING),
        ("hardware silent for 1 s", "firmware bridged_epochs", "FAULT (SENSORS_LOST)"),
        (
            "inner encoder silent for 5 s",
            "firmware missing_frames",
            "NAVIGATION_STRAPDOWN (axis not following)",
        ),
        ("firmware silent for 5 s", "hardware missing_commands", ROTATING),
        (
            "a node babbles, 40 frames an epoch for 1 s",
            "firmware bridged_epochs",
            "FAULT (SENSORS_LOST)",
        ),
        ("hardware bus-off", "firmware bridged_epochs", ROTATING),
        ("firmware bus-off", "hardware missing_commands", ROTATING),
        ("bus cut for 50 ms", "firmware bridged_epochs", ROTATING),
        ("bus cut for 1 s", "firmware bridged_epochs", "FAULT (SENSORS_LOST)"),
    ],
)
def test_a_fault_is_counted_at_once_and_the_mode_follows(table, injected, counter, mode):
    row = table[injected]
    assert row.counted[counter] > 0
    assert row.after_epochs is not None
    assert row.after_epochs <= 25  # a probability of 1 % takes its time
    assert row.mode == mode
    assert row.worst_bridged <= 20  # 0.1 s
    assert row.difference_m < 0.01


@pytest.mark.parametrize(
    "injected", ["every epoch in another order for 5 s", "a node babbles, 8 frames an epoch"]
)
def test_what_does_no_harm_changes_nothing(table, injected):
    assert table[injected].counted == {}
    assert table[injected].difference_m == 0


def test_every_kind_of_fault_is_in_the_table():
    kinds = {fault["kind"] for _, fault, _ in fault_table.CASES}
    assert kinds == {kind.name.lower() for kind in FaultKind if kind is not FaultKind.NONE}


@given(st.integers(0, 63), st.sampled_from([f"SENSOR_{k}" for k in (1, 2, 3, 4)]))
def test_no_single_wrong_bit_ever_reaches_navigation(bit, message):
    faults = ({"kind": "corrupt", "message": message, "bit": bit, "at_s": 3.1},)
    lost = ({"kind": "drop", "message": message, "at_s": 3.1},)
    digests = {
        run_direct(Scenario.model_validate({"duration_s": 0.5, "faults": which}))[0][
            "navigation_sha256"
        ]
        for which in (faults, lost)
    }
    assert len(digests) == 1  # a corrupted frame is as good as none


def test_a_seed_repeats_a_fault_and_another_does_not():
    scenario = {"duration_s": 3, "faults": [{"kind": "drop", "probability": 0.05, "at_s": 3.1}]}
    digests = [
        run_direct(Scenario.model_validate(scenario | {"seed": seed}))[0]["navigation_sha256"]
        for seed in (1, 1, 2)
    ]
    assert digests[0] == digests[1] != digests[2]


def test_a_delayed_frame_comes_once_and_not_again():
    faults = Faults((Fault(FaultKind.DELAY, Node.HARDWARE, parameter=2),), seed=1)
    frames, out = frame_array(1), frame_array(8)
    frames["can_id"] = 0x40
    seen = []
    for epoch in range(6):
        frames["data"] = epoch
        count = faults.apply(Node.HARDWARE, frames, 1, epoch, out)
        seen.append(out["data"][:count].tolist())
    assert seen == [[], [], [0], [1], [2], [3]]


def test_faults_act_only_in_their_time_and_on_their_frames():
    fault = Fault(FaultKind.DROP, Node.HARDWARE, 0x40, first_epoch=2, last_epoch=3)
    faults = Faults((fault,), seed=1)
    frames, out = frame_array(2), frame_array(8)
    frames["can_id"] = (0x40, 0x41)
    left = [faults.apply(Node.HARDWARE, frames, 2, epoch, out) for epoch in range(5)]
    assert left == [2, 2, 1, 1, 2]
    assert faults.apply(Node.FIRMWARE, frames, 2, 2, out) == 2


def test_a_command_says_what_a_scenario_would():
    fault = fault_of({"kind": "delay", "message": "SENSOR_3", "for_s": 1.5, "delay_s": 0.02})
    message = fault_commands(FaultAction.INJECT, fault)[-1]
    values = load().database.decode_message(message.arbitration_id, bytes(message.data))
    assert str(values["action"]) == "INJECT"
    assert str(values["kind"]) == "DELAY"
    assert values["identifier"] == 0x42
    assert values["duration_ms"] == 1500
    assert values["parameter"] == 20


def test_what_a_command_cannot_say_is_refused():
    for fault, words in (
        (FaultOnWire(kind="drop", probability=1e-5), "probability 1e-05"),
        (FaultOnWire(kind="drop", for_s=100), "for 100 s: a live fault lasts 65.535 s at most"),
        (FaultOnWire(kind="delay", delay_s=20), "delay of 20 s: a live one is 16.383 s at most"),
    ):
        with pytest.raises(InjectionError, match=words):
            fault_commands(FaultAction.INJECT, fault)
    with pytest.raises(ScenarioError, match="did you mean SENSOR_3"):
        fault_of({"kind": "drop", "message": "SENSR_3"})


def test_a_live_fault_on_the_bus_is_obeyed_and_reported(start, tmp_path):
    channel = "live-fault"
    command = start(
        "rehearse", "ideal", "--channel", channel, "--speed", 20, "--duration", 60, "--out", "out"
    )
    command.wait_for_line("running")
    with can.Bus("live-fault", interface="rrins", host="never") as bus:
        bus.set_filters([{"can_id": load().frame_id("NAV_LATITUDE"), "can_mask": 0x7FF}])
        assert bus.recv(30) is not None
        fault = fault_of({"kind": "silence", "node": "hardware", "for_s": 5})
        bus.send(fault_commands(FaultAction.INJECT, fault)[-1], 5.0)
        status = load().database.get_message_by_name("FAULT_STATUS")
        bus.set_filters([{"can_id": status.frame_id, "can_mask": 0x7FF}])
        seen = bus.recv(20)
        assert seen is not None
        values = status.decode(bytes(seen.data), decode_choices=False)
        assert values["active_kinds"] == 1 << FaultKind.SILENCE
        assert values["active_faults"] == 1
    code, _ = command.finish()
    assert code == 8
    assert command.said[-1] == "rrins: the firmware ended in FAULT: SENSORS_LOST"


def test_the_wire_takes_time_and_a_slow_one_too_much():
    fast, slow = (
        run_direct(Scenario.model_validate({"duration_s": 15, "bus": {"bitrate": bitrate}}))
        for bitrate in (1_000_000, 125_000)
    )
    ideal = run_direct(Scenario.model_validate({"duration_s": 15}))
    assert fast[0]["navigation_sha256"] == ideal[0]["navigation_sha256"]
    assert slow[0]["fault"] == "SELF_TEST_FAILED"
    assert np.sum(list(slow[0]["faults"].values())) > 0
