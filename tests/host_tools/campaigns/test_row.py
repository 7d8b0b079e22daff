"""How a run of a campaign is set up: quicker than a firmware by itself, the same to the byte."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.sensors.calibration import Calibration
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.campaigns import row as campaign_row
from rrins.host_tools.campaigns.definition import load as load_campaign
from rrins.host_tools.campaigns.row import LEAST_TOGETHER, Work, rows_of, switched_on
from rrins.host_tools.runs.set_up.settings import firmware_settings
from rrins.host_tools.runs.together.group import Group
from rrins.host_tools.scenario.scenario import load


@pytest.mark.parametrize(
    ("name", "keys"),
    [
        ("rimu_rotating", {"sensors": "prototype", "gyros__scale_error_ppm": 40.0}),
        ("rimu_rotating_aligned", {"body__heading_deg": 30.0}),
        ("drive_rotating", {"rate_hz": 50, "gnss": {}}),
        ("imu_strapdown", {"site__latitude_deg": -20.0}),
    ],
)
def test_the_memory_at_power_on_is_that_of_a_firmware(name, keys):
    switched_on(firmware_settings(load(name)))  # what is kept of another run does no harm
    settings = firmware_settings(load(name).varied(**keys))
    count = len(settings.gyro_axes_deg)
    gyros = Calibration().gyros.model_copy(update={"bias_dph": (0.5,) * count})
    settings = settings.model_copy(update={"calibration": Calibration(gyros=gyros)})
    assert switched_on(settings).tobytes() == Firmware(settings).ram.tobytes()


class Unlike(Group):
    """A group of which the first leader differs from its own lane: nothing of the others counts."""

    def _results(self):
        found = super()._results()
        return found[:1] + [None] * LEAST_TOGETHER if len(found) > LEAST_TOGETHER else found


def test_a_chunk_has_the_rows_of_its_runs(monkeypatch):
    """Though its first run may not lead: the second one does."""
    monkeypatch.setattr(campaign_row, "Group", Unlike)
    monkeypatch.setattr(campaign_row, "row_of", None)  # none is run by itself
    keys = {"sensors": "prototype", "duration_s": 130}
    campaign = {"scenario": "rimu_rotating", "runs": 20, "set": keys}
    campaign["vary"] = {"gyros.scale_error_ppm": "normal(0, 50)"}
    work = Work.of(load_campaign(campaign))
    together = rows_of(work, range(LEAST_TOGETHER + 1))
    assert [row["run"] for row in together] == list(range(LEAST_TOGETHER + 1))
    monkeypatch.undo()
    for shared, alone in zip(together[:4], rows_of(work, range(4)), strict=True):
        assert shared.keys() == alone.keys()
        for name in alone.keys() - {"wall_s"}:
            if isinstance(alone[name], float | np.ndarray):
                np.testing.assert_allclose(shared[name], alone[name], rtol=1e-6, atol=1e-7)
            else:
                assert shared[name] == alone[name], name
    assert together[1]["wall_s"] == together[2]["wall_s"]  # for they have shared it
