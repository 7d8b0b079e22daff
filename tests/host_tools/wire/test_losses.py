"""Compiled code loses the frames that `WireFaults.apply` loses."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.dbc.frame import frame_array
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.runs.direct import run_direct
from rrins.host_tools.runs.exchange import exchange_epoch
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    hardware_settings,
    scenario_wire,
)
from rrins.host_tools.scenario.scenario import load
from rrins.host_tools.wire.fault_kinds import FaultKind
from rrins.host_tools.wire.faults import ANY_IDENTIFIER, Node, WireFault, WireFaults
from rrins.host_tools.wire.losses import lose

SIDES = (Node.HARDWARE, Node.FIRMWARE)
IDENTIFIERS = (0x40, 0x41, 0x50)
EPOCHS = 40

losing = st.builds(
    WireFault,
    kind=st.sampled_from([FaultKind.DROP, FaultKind.SILENCE, FaultKind.BUS_OFF, FaultKind.CUT]),
    node=st.sampled_from(Node),
    identifier=st.sampled_from([*IDENTIFIERS, ANY_IDENTIFIER]),
    first_epoch=st.integers(0, EPOCHS),
    last_epoch=st.integers(-1, EPOCHS),
    probability=st.sampled_from([0.01, 0.3, 1.0]),
)


def frames_of(epoch):
    frames = frame_array(6)
    frames["can_id"] = np.resize(IDENTIFIERS, 6)
    frames["data"] = 100 * epoch + np.arange(6)
    return frames


@given(
    st.lists(losing, max_size=8),
    st.lists(st.booleans(), min_size=EPOCHS, max_size=EPOCHS),
)
@settings(max_examples=60, deadline=None)
def test_any_of_the_epochs_may_be_compiled(faults, is_compiled):
    ours, theirs = (WireFaults(tuple(faults), seed=7) for _ in range(2))
    for epoch, compiled in enumerate(is_compiled):
        assert ours.loses_until(epoch) > epoch
        for side in SIDES:
            frames, wanted, found = frames_of(epoch), frame_array(6), frame_array(6)
            count = theirs.apply(side, frames, 6, epoch, wanted)
            if compiled:
                losses = ours.losses(epoch)
                left = lose(losses, int(side), int(Node.ANY), ANY_IDENTIFIER, frames, 6, found)
                ours.settle_losses()
            else:
                left = ours.apply(side, frames, 6, epoch, found)
            assert left == count
            assert (found[:left] == wanted[:count]).all()
        assert ours.affected_frames == theirs.affected_frames


def test_until_when_nothing_but_losses_is_known():
    lost = WireFault(FaultKind.DROP, first_epoch=10, last_epoch=19, probability=0.5)
    wrong = WireFault(FaultKind.CORRUPT, first_epoch=30, last_epoch=30)
    faults = WireFaults((lost, wrong), seed=1)
    assert [faults.loses_until(epoch) for epoch in (0, 9, 10, 19, 20, 29)] == [
        10,
        10,
        20,
        20,
        30,
        30,
    ]
    assert faults.loses_until(30) == 30
    assert faults.loses_until(31) > 1_000_000


def test_a_delayed_frame_is_not_forgotten():
    faults = WireFaults((WireFault(FaultKind.DELAY, last_epoch=0, parameter=5),), seed=1)
    faults.apply(Node.HARDWARE, frames_of(0), 6, 0, frame_array(6))
    assert faults.loses_until(3) == 3


FAULTS = [
    {"kind": "drop", "probability": 0.05, "at_s": 3},
    {"kind": "drop", "probability": 0.3, "at_s": 6, "for_s": 2.5, "node": "hardware"},
    {"kind": "silence", "at_s": 7, "for_s": 0.4, "message": "SENSOR_2"},
    {"kind": "corrupt", "probability": 0.3, "at_s": 9, "for_s": 0.5},
]


def by_epochs(scenario):
    """Run a scenario from Python, epoch by epoch; return both sides."""
    hardware = Hardware(hardware_settings(scenario), scenario_wire(scenario))
    firmware = Firmware(firmware_settings(scenario))
    count = 0
    for epoch in range(scenario.epochs + 1):
        count = exchange_epoch(hardware, firmware, epoch, count)
    return hardware, firmware


def test_a_run_is_the_same_as_epoch_by_epoch():
    scenario = load("rimu_rotating", duration_s=15)
    keys = scenario.model_dump(exclude_unset=True) | {"faults": FAULTS}
    scenario = type(scenario).model_validate(keys)
    found = run_direct(scenario)
    hardware, firmware = by_epochs(scenario)
    assert found.firmware["navigation_sha256"] == firmware.trace.sha256()
    counters = hardware.plant[0].counters
    assert found.hardware["faults"]["missing_commands"] == int(counters.missing_commands) > 50
    assert found.hardware["faults"]["crc_errors"] == int(counters.crc_errors) > 10
    assert found.firmware["faults"]["missing_frames"] > 100
