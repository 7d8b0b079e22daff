"""Faults on the wire: each is noticed and counted, and no wrong value is ever used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from generate import faults_page as fault_table
from generate.fault_cases import OF_HARDWARE, ON_WIRE
from generate.fault_numbers import DBC, with_kinds
from generate.redundancy_faults import section
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.dbc.codec import load as load_codec
from rrins.dbc.contract import load_contract
from rrins.dbc.frame import frame_array
from rrins.dbc.values import FaultAction, FaultRefusal
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.hardware.fault_kinds import HardwareFault
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.injection.errors import InjectionError
from rrins.host_tools.injection.messages import fault_commands
from rrins.host_tools.runs.direct import run_direct
from rrins.host_tools.runs.exchange import exchange_epoch
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    hardware_settings,
    scenario_wire,
)
from rrins.host_tools.scenario.fault_tables import KINDS
from rrins.host_tools.scenario.scenario import Scenario, fault_of, load
from rrins.host_tools.wire import draws
from rrins.host_tools.wire.draws import Draws
from rrins.host_tools.wire.effects import Node
from rrins.host_tools.wire.fault_kinds import FaultKind
from rrins.host_tools.wire.faults import WireFault, WireFaults

DOCS = Path(__file__).parents[3] / "docs"
ROTATING = "NAVIGATION_ROTATING"
RESUMED = f"{ROTATING} (axis not following)"
"""Again, and the axis has not yet followed for long enough to be trusted."""


CASES = {case.injected: case for case in (*ON_WIRE, *OF_HARDWARE)}


def in_soak(*values):
    return pytest.param(*values, marks=pytest.mark.soak)


@pytest.fixture(scope="module")
def observe():
    """Return a function that runs a case of the page, and observes it."""
    sound = fault_table._Run([], modelled=False)
    reference = [sound.navigation() for _ in sound.epochs()]
    return lambda injected: fault_table.observe(CASES[injected], reference)


@pytest.mark.soak
def test_the_page_in_docs_is_current():
    current = fault_table.page(fault_table.rows()) + section()
    assert (DOCS / "faults.md").read_text(encoding="utf-8") == current, "run `make docs`"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("injected", "counter", "mode"),
    [
        ("SENSOR_3 lost for 5 s", "firmware missing_frames", ROTATING),
        in_soak("1 % of all frames lost", "firmware missing_frames", ROTATING),
        in_soak("SENSOR_2 10 ms late for 1 s", "firmware counter_errors", ROTATING),
        ("every frame twice for 5 s", "firmware counter_errors", ROTATING),
        ("SENSOR_1 with a bit error that passes CRC-15, for 5 s", "firmware crc_errors", ROTATING),
        in_soak(
            "10 % of all frames with a bit error that passes CRC-15",
            "hardware crc_errors",
            ROTATING,
        ),
        in_soak("SENSOR_4 with a wrong counter for 5 s", "firmware counter_errors", ROTATING),
        ("SYNC lost for 5 s", "firmware missing_frames", ROTATING),
        in_soak("hardware silent for 50 ms", "firmware bridged_epochs", ROTATING),
        ("hardware silent for 1 s", "firmware bridged_epochs", "FAULT (SENSORS_LOST)"),
        in_soak("inner encoder silent for 5 s", "firmware missing_frames", RESUMED),
        ("firmware silent for 5 s", "hardware missing_commands", ROTATING),
        in_soak(
            "a node babbles, 40 frames per epoch for 1 s",
            "firmware bridged_epochs",
            "FAULT (SENSORS_LOST)",
        ),
        ("hardware bus-off", "firmware bridged_epochs", ROTATING),
        in_soak("firmware bus-off", "hardware missing_commands", ROTATING),
        ("bus cut for 50 ms", "firmware bridged_epochs", ROTATING),
        in_soak("bus cut for 1 s", "firmware bridged_epochs", "FAULT (SENSORS_LOST)"),
    ],
)
def test_a_fault_is_counted_at_once_and_the_mode_follows(observe, injected, counter, mode):
    row = observe(injected)
    assert row.counted[counter] > 0
    assert row.after_epochs is not None
    assert row.after_epochs <= 25  # a probability of 1 % takes its time
    assert row.mode == mode
    assert row.worst_bridged <= 20  # 0.1 s
    assert row.difference_m < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    "injected", ["every epoch's frames reordered for 5 s", "a node babbles, 8 frames per epoch"]
)
def test_what_does_no_harm_changes_nothing(observe, injected):
    row = observe(injected)
    assert (row.counted, row.difference_m) == ({}, 0)


def test_every_kind_of_fault_is_in_the_table():
    kinds = {case.fault["kind"] for case in (*ON_WIRE, *OF_HARDWARE)}
    assert kinds == set(KINDS)


def test_the_dbc_has_the_kinds():
    text = DBC.read_bytes().decode("cp1252")
    assert with_kinds(text) == text, "run `make docs`"
    codec, contract = load_codec(), load_contract()[0]
    for part in ("COMMAND", "ACTIVE"):
        for of, kinds in (("", FaultKind), ("HARDWARE_", HardwareFault)):
            message = f"{of}FAULT_{part}"
            choices = {0: "NONE"} | {int(kind): kind.name for kind in kinds}
            assert codec.choices(message, "kind") == choices
            assert len(kinds) <= contract[message.lower()]["kind"]["raw_maximum"]
    assert 1 << len(FaultKind) <= contract["fault_status"]["active_kinds"]["raw_maximum"]


def test_the_dbc_has_the_actions_and_refusals():
    codec = load_codec()
    actions = {action: action.name for action in FaultAction}
    both = [codec.choices(f"{of}FAULT_COMMAND", "action") for of in ("", "HARDWARE_")]
    assert both[0] | both[1] == actions
    refusals = {refusal: refusal.name for refusal in FaultRefusal}
    for message in ("FAULT_STATUS", "HARDWARE_FAULT_STATUS"):
        assert codec.choices(message, "refusal") == refusals


@pytest.mark.slow
@pytest.mark.parametrize(
    ("injected", "trouble", "mode"),
    [
        in_soak("SENSOR_1 repeats an old frame for 5 s", "sensor_1_stale", ROTATING),
        in_soak(
            "inner axis stalls permanently",
            "axis_inner_not_following",
            "NAVIGATION_STRAPDOWN (axis not following)",
        ),
        ("inner axis stalls for 3 s", "axis_inner_not_following", RESUMED),
        in_soak("outer axis runs away at 5 °/s for 5 s", "axis_outer_not_following", RESUMED),
        ("inner encoder jumps by 10°", "axis_inner_encoder", ROTATING),
        in_soak("inner encoder slips by 1 %", "axis_inner_encoder", ROTATING),
        in_soak("gyro 2 repeats its last increment", "gyro_2_stuck", ROTATING),
        ("gyro 2 absent for 5 s", "gyro_2_absent", ROTATING),
        ("all gyros absent for 1 s", "sensors_lost", "FAULT (SENSORS_LOST)"),
        in_soak("accelerometer 3 absent for 5 s", "accelerometer_3_absent", ROTATING),
    ],
)
def test_a_fault_leaves_its_trouble_code(observe, injected, trouble, mode):
    row = observe(injected)
    assert trouble in row.troubles
    assert row.mode == mode


@pytest.mark.slow
def test_what_a_bad_sensor_says_is_used_while_none_can_be_told_from_the_others(observe):
    bias = observe("gyro 2 biased by 10 °/h")  # before the biases of the others are known
    assert bias.troubles == ["gyros_inconsistent"]
    assert bias.difference_deg == pytest.approx(10 * 40 / 3600, rel=0.5)  # a share of 10 °/h


@pytest.mark.slow
def test_what_a_bad_encoder_says_is_not_used(observe):
    assert observe("inner encoder jumps by 1°").difference_deg < 1e-3


@pytest.mark.slow
@settings(max_examples=25)
@given(st.integers(0, 63), st.sampled_from([f"SENSOR_{k}" for k in (1, 2, 3, 4)]))
def test_no_single_wrong_bit_ever_reaches_navigation(bit, message):
    faults = ({"kind": "corrupt", "message": message, "bit": bit, "at_s": 3.1},)
    lost = ({"kind": "drop", "message": message, "at_s": 3.1},)
    digests = {
        run_direct(Scenario.model_validate({"duration_s": 0.5, "faults": which})).firmware[
            "navigation_sha256"
        ]
        for which in (faults, lost)
    }
    assert len(digests) == 1  # a corrupted frame is as good as none


def test_a_seed_repeats_a_fault_and_another_does_not():
    scenario = {"duration_s": 3, "faults": [{"kind": "drop", "probability": 0.05, "at_s": 3.1}]}
    digests = [
        run_direct(Scenario.model_validate(scenario | {"seed": seed})).firmware["navigation_sha256"]
        for seed in (1, 1, 2)
    ]
    assert digests[0] == digests[1] != digests[2]


def test_a_delayed_frame_comes_once_and_not_again():
    faults = WireFaults((WireFault(FaultKind.DELAY, Node.HARDWARE, parameter=2),), seed=1)
    frames, out = frame_array(1), frame_array(8)
    frames["can_id"] = 0x40
    seen = []
    for epoch in range(6):
        frames["data"] = epoch
        count = faults.apply(Node.HARDWARE, frames, 1, epoch, out)
        seen.append(out["data"][:count].tolist())
    assert seen == [[], [], [0], [1], [2], [3]]


@pytest.mark.parametrize("kinds", [("DUPLICATE",), ("DUPLICATE", "STALE"), ("BABBLE", "DUPLICATE")])
def test_many_faults_that_make_frames_make_few(kinds):
    faults = WireFaults(tuple(WireFault(FaultKind[k], parameter=9) for k in 20 * kinds), seed=1)
    frames, out = frame_array(2), frame_array(4096)
    frames["can_id"] = (0x40, 0x41)
    count = faults.apply(Node.HARDWARE, frames, 2, 0, out)
    babble = int(np.count_nonzero(out["can_id"][:count] == 1))
    assert count - babble == 2 * 21
    assert babble == (0 if "BABBLE" not in kinds else sum(9 * (21 - k) for k in range(20)))


def test_faults_act_only_in_their_time_and_on_their_frames():
    fault = WireFault(FaultKind.DROP, Node.HARDWARE, 0x40, first_epoch=2, last_epoch=3)
    faults = WireFaults((fault,), seed=1)
    frames, out = frame_array(2), frame_array(8)
    frames["can_id"] = (0x40, 0x41)
    left = [faults.apply(Node.HARDWARE, frames, 2, epoch, out) for epoch in range(5)]
    assert left == [2, 2, 1, 1, 2]
    assert faults.apply(Node.FIRMWARE, frames, 2, 2, out) == 2


def test_what_a_command_cannot_say_is_refused():
    for fault, words in (
        ({"kind": "drop", "probability": 1e-5}, "probability 1e-05"),
        ({"kind": "drop", "for_s": 100}, "for 100 s: a live fault lasts at most 65.535 s"),
        ({"kind": "delay", "delay_s": 20}, "delay of 20 s: the maximum of a live fault is 16.383"),
    ):
        with pytest.raises(InjectionError, match=words):
            fault_commands(FaultAction.INJECT, fault_of(fault))
    with pytest.raises(ScenarioError, match="did you mean SENSOR_3"):
        fault_of({"kind": "drop", "message": "SENSR_3"})


def test_a_stale_frame_is_the_one_of_the_beginning():
    faults = WireFaults((WireFault(FaultKind.STALE, Node.HARDWARE, 0x40, 1, 3),), seed=1)
    frames, out = frame_array(2), frame_array(8)
    frames["can_id"] = (0x40, 0x41)
    seen = []
    for epoch in range(6):
        frames["data"] = epoch
        faults.apply(Node.HARDWARE, frames, 2, epoch, out)
        seen.append(out["data"][:2].tolist())
    assert seen == [[0, 0], [1, 1], [1, 2], [1, 3], [4, 4], [5, 5]]


def test_a_key_of_another_kind_is_refused():
    for fault, words in (
        ({"kind": "gyro_bias", "bias_ug": 3}, "bias_ug: does not apply to gyro_bias"),
        ({"kind": "gyro_stuck", "bias_dph": 3}, "bias_dph: does not apply to gyro_stuck"),
        ({"kind": "drop", "bit": 3}, "bit: does not apply to drop, only to corrupt"),
        ({"kind": "gyro_noise", "angle_random_walk_deg_per_sqrt_h": -1}, "greater than or equal"),
        ({"kind": "axis_runaway", "axis": "inner", "rate_dps": 61}, "less than or equal to 60"),
    ):
        with pytest.raises(ScenarioError, match=words):
            fault_of(fault)
    kept = {"kind": "gyro_stuck", "bias_dph": 10.0, "scale_ppm": 10_000.0}  # an older recording
    assert "bias_dph" not in fault_of(kept).model_dump()


@pytest.mark.slow
def test_the_wire_takes_time_and_a_slow_one_too_much():
    fast, slow = (
        run_direct(Scenario.model_validate({"duration_s": 15, "bus": {"bitrate": bitrate}}))
        for bitrate in (1_000_000, 125_000)
    )
    ideal = run_direct(Scenario.model_validate({"duration_s": 15}))
    assert fast.firmware["navigation_sha256"] == ideal.firmware["navigation_sha256"]
    assert slow.firmware["fault"] == "SELF_TEST_FAILED"
    assert np.sum(list(slow.firmware["faults"].values())) > 0


def test_until_when_the_same_faults_act():
    lost = WireFault(FaultKind.DROP, first_epoch=10, last_epoch=19, probability=0.5)
    off = WireFault(FaultKind.POWER_OFF, first_epoch=30, last_epoch=30)
    faults = WireFaults((lost, off), seed=1)
    epochs = (0, 9, 10, 19, 20, 29, 30)
    assert [faults.same_until(epoch) for epoch in epochs] == [10, 10, 20, 20, 30, 30, 30]
    assert faults.same_until(31) > 1_000_000


@given(st.integers(0, 2**32), st.lists(st.booleans(), max_size=200))
def test_the_random_numbers_are_those_of_numpy(seed, which):
    ours, theirs = Draws.zeros()[0], np.random.default_rng([seed, 3])
    draws.begin(ours, [seed, 3])
    for is_bit in which:
        if is_bit:
            assert draws.bit(ours) == theirs.integers(64)
        else:
            assert draws.uniform(ours) == theirs.random()


def test_the_share_of_the_frames_that_is_hit_is_the_probability():
    faults = WireFaults((WireFault(FaultKind.DROP, probability=0.3),), seed=1)
    frames, out = frame_array(4096), frame_array(4096)
    left = sum(faults.apply(Node.HARDWARE, frames, 4096, epoch, out) for epoch in range(10))
    assert left / 40960 == pytest.approx(0.7, abs=0.01)  # 4.4 sigma
    assert faults.affected_frames == 40960 - left


def test_a_delay_has_room_for_whatever_is_sent():
    faults = WireFaults((WireFault(FaultKind.DELAY, parameter=300),), seed=1)
    frames, out = frame_array(100), frame_array(4096)
    for epoch in range(700):
        frames["data"] = epoch
        count = faults.apply(Node.HARDWARE, frames, 100, epoch, out)
        assert out["data"][:count].tolist() == [epoch - 300] * (100 if epoch >= 300 else 0)


AT_ANY_TIME = [
    {"kind": "drop", "probability": 0.05, "at_s": 3},
    {"kind": "drop", "probability": 0.3, "at_s": 6, "for_s": 2.5, "node": "hardware"},
    {"kind": "silence", "at_s": 7, "for_s": 0.4, "message": "SENSOR_2"},
    {"kind": "corrupt", "probability": 0.3, "at_s": 9, "for_s": 0.5},
    {"kind": "wrong_counter", "probability": 0.2, "at_s": 10, "for_s": 0.5},
    {"kind": "stale", "probability": 0.5, "at_s": 10.2, "for_s": 0.5, "message": "SENSOR_3"},
    {"kind": "duplicate", "at_s": 11, "for_s": 1},
    {"kind": "reorder", "at_s": 11.5, "for_s": 1},
    {"kind": "delay", "probability": 0.1, "delay_s": 0.02, "at_s": 12, "for_s": 1},
    {"kind": "babble", "at_s": 13, "for_s": 1},
    {"kind": "power_off", "at_s": 14, "for_s": 0.1},
]


def test_a_run_in_compiled_code_is_the_same_as_epoch_by_epoch():
    scenario = load("rimu_rotating", duration_s=15)
    keys = scenario.model_dump(exclude_unset=True) | {"faults": AT_ANY_TIME}
    scenario = type(scenario).model_validate(keys)
    found = run_direct(scenario)
    hardware = Hardware(hardware_settings(scenario), scenario_wire(scenario))
    firmware, count = Firmware(firmware_settings(scenario)), 0
    for epoch in range(scenario.epochs + 1):
        count = exchange_epoch(hardware, firmware, epoch, count)
    assert found.firmware["navigation_sha256"] == firmware.trace.sha256()
    counters = hardware.plant[0].counters
    assert found.hardware["faults"]["missing_commands"] == int(counters.missing_commands) > 50
    assert found.hardware["faults"]["crc_errors"] == int(counters.crc_errors) > 10
