"""Frames that keep being lost, while the table turns."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.navigation.trace import NavigationTrace
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.runs.exchange import answer_epoch
from rrins.host_tools.runs.results.findings import finding_lines
from rrins.host_tools.runs.results.results import compare
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.runs.sides.firmware_job import firmware_summary
from rrins.host_tools.scenario.scenario import Scenario


def fly_with_gaps(scenario, lost=19, of=40, from_epoch=1000):
    """Run without what the hardware sends in the first `lost` of every `of` epochs."""
    rows, truth = [], []
    firmware = Firmware(
        firmware_settings(scenario), NavigationTrace(10, lambda some: rows.append(some.copy()))
    )
    hardware = Hardware(hardware_settings(scenario))
    count = 0
    for epoch in range(scenario.epochs + 1):
        frames, sent = hardware.open_epoch(epoch, firmware.outbox, count)
        if epoch >= from_epoch and epoch % of < lost:
            sent = 0
        count = answer_epoch(firmware, frames, sent, epoch)
        if epoch % 10 == 0:
            truth.append(hardware.truth.copy())
    firmware.trace.flush()
    errors = compare(np.concatenate(rows), np.concatenate(truth), scenario.rate_hz)
    return firmware_summary(firmware), errors


@pytest.mark.parametrize("lost", [1, 19])
def test_frames_that_keep_being_lost_are_told_as_a_degraded_navigation(lost):
    scheme = [{"axis": "inner", "angle_deg": 10}, {"axis": "outer", "angle_deg": -10}]
    firmware = {"scheme": scheme, "stand_s": 1, "turn_rate_dps": 5}
    scenario = Scenario.model_validate({"duration_s": 40, "firmware": firmware})
    summary, errors = fly_with_gaps(scenario, lost)
    assert summary["fault"] == "NONE"
    assert summary["encoders"] == {"inner": None, "outer": None}
    gaps = summary["bridging"]
    assert gaps["bridged_s"] == pytest.approx(errors.time_s[-1] * lost / 40, rel=0.1)
    assert gaps["degraded"] == (lost > 1)
    assert bool(finding_lines(summary)) == (lost > 1)
    worst = max(np.abs(e).max() for e in (errors.roll_deg, errors.pitch_deg, errors.heading_deg))
    assert gaps["attitude_uncertainty_arcsec"] > 0.5 * worst * 3600


def test_a_sound_run_says_nothing():
    summary, _ = fly_with_gaps(Scenario(duration_s=8), lost=0)
    gaps = summary["bridging"]
    assert (gaps["bridged_s"], gaps["degraded"], gaps["attitude_uncertainty_arcsec"]) == (
        0,
        False,
        0,
    )
    assert not finding_lines(summary)
