"""States of the firmware's controller reach the firmware's trouble codes."""

from __future__ import annotations

import pytest

from rrins.dbc.frame import ERR_FLAG, frame_array
from rrins.firmware_py.core.records.troubles import Status
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.runs.exchange import exchange_epoch
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    hardware_settings,
    scenario_wire,
)
from rrins.host_tools.scenario.scenario import load
from rrins.host_tools.wire.controller import ControllerWatch
from rrins.host_tools.wire.timing import WireModel

SCENARIO = """
duration_s = 2
mode = "strapdown"
[bus]
bitrate = 1_000_000
[firmware]
bridge_s = 5
alignment_s = 0.5
[[faults]]
kind = "{kind}"
node = "firmware"
at_s = 1.9
{more}
"""


def run(path):
    """Run a scenario in this process; return the names of confirmed trouble codes."""
    scenario = load(str(path))
    firmware = Firmware(firmware_settings(scenario))
    hardware = Hardware(hardware_settings(scenario), scenario_wire(scenario))
    count = 0
    for epoch in range(scenario.epochs):
        count = exchange_epoch(hardware, firmware, epoch, count)
    faults = firmware.diagnostics.faults
    return {trouble.name for trouble, _ in faults.by_mask(Status.CONFIRMED)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "more", "name"),
    [("bus_off", "for_s = 0.05", "bus_off"), ("corrupt_wire", "for_s = 0.5", "error_passive")],
)
def test_a_controller_in_trouble_sets_its_trouble_code(tmp_path, kind, more, name):
    path = tmp_path / "trouble.toml"
    path.write_text(SCENARIO.format(kind=kind, more=more), encoding="utf-8")
    assert name in run(path)


def test_a_change_of_the_state_is_told_once():
    model = WireModel(1_000_000, ("hardware", "firmware"))
    watch = ControllerWatch(model, 1)
    out = frame_array(8)
    fault = model.mediums["fault"]
    assert watch.tell(out) == 0
    fault["tec"][0, 1] = 130
    assert watch.tell(out) == 1
    assert out[0]["can_id"] == ERR_FLAG | 0x204
    assert int(out[0]["data"]).to_bytes(8, "little").hex() == "0020000000008200"
    assert watch.tell(out) == 0
    fault["tec"][0, 1] = 0
    assert watch.tell(out) == 1
    assert int(out[0]["data"]).to_bytes(8, "little")[1] == 0x40
