"""With the estimator on: the same to the bit over the bus, in lockstep, direct, and continued."""

from __future__ import annotations

import pytest

from rrins.firmware_py.core.records.memory import Ram
from rrins.host_tools.hardware import settings as hardware
from rrins.host_tools.hardware.memory import Plant
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import load

CHANGES = {"duration_s": 20, "seed": 5}


def scenario_of():
    return load("drive_aided", **CHANGES).varied(
        estimator__fine_alignment_s=5.0, firmware__turn_rate_dps=8.0
    )


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "aided.toml"
    file.write_text(scenario_of().toml(), encoding="utf-8")
    return file


def test_every_way_is_the_same(run, path):
    ways = {
        "direct": run("simulate", path),
        "frames": run("simulate", path, "--frames"),
        "lockstep": run("rehearse", path),
    }
    assert len({way["navigation_sha256"] for way in ways.values()}) == 1
    found = [way["estimator"] for way in ways.values()]
    assert found[0] == found[1] == found[2]
    assert set(found[0]["aided_by"]) >= {"zero_velocity", "gnss_position", "odometer"}


def test_a_run_that_is_stopped_continues_from_its_records():
    scenario = scenario_of()
    whole, first = (
        FastRun.of(firmware_settings(scenario), hardware_settings(scenario)) for _ in range(2)
    )
    stop = scenario.navigation_epoch + 1234  # in the middle of the filter's second
    left = scenario.epochs - stop
    whole.run(stop + left)
    first.run(stop)
    kept = bytearray(first.ram.tobytes()), bytearray(first.plant.tobytes())
    second = FastRun(
        Ram.from_bytes(kept[0]),
        Plant.from_bytes(kept[1]),
        hardware.pieces_of(hardware_settings(scenario)),
    )
    second.run(left)
    assert second.ram.tobytes() == whole.ram.tobytes()
    assert second.plant.tobytes() == whole.plant.tobytes()
    assert second.ram[0].estimator.history_count > first.ram[0].estimator.history_count
