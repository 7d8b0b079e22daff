"""The firmware's power: cut at any instant, the hardware goes on and the firmware comes again."""

from __future__ import annotations

import os
import random
from contextlib import suppress
from pathlib import Path

import pytest

import rrins
from rrins.firmware_py.diagnostics import table
from rrins.host_tools.runs import run
from rrins.host_tools.runs.direct import run_direct
from rrins.host_tools.runs.display import RunDisplay
from rrins.host_tools.runs.programs.keeper import descendants
from rrins.host_tools.scenario.scenario import load
from rrins.host_tools.terminal import new_console
from rrins.host_tools.testing.errors import BenchError

QUICK = {"duration_s": 120, "firmware": {"alignment_s": 0.5}}
WAYS = ("direct", "lockstep")
SIDES = {"direct": [], "lockstep": ["firmware"], "realtime": ["firmware", "hardware"]}
"""The sides that are processes of their own, while the firmware has power."""
CYCLES = int(os.environ.get("RRINS_CYCLES", "5"))


def navigating(bench):
    return bench.expect("FIRMWARE_STATUS", within=5, where={"mode": "NAVIGATION_ROTATING"})


@pytest.fixture
def sides():
    """Return which sides are processes that this test began, each as often as there is one."""
    others = set(descendants(os.getpid()))  # of tests before, that may still be ending

    def of_this_test():
        began = set(descendants(os.getpid())) - others
        names = []
        for pid in began:
            with suppress(FileNotFoundError, ProcessLookupError):  # it has ended meanwhile
                names.append(Path(f"/proc/{pid}/comm").read_text().strip())
        return sorted(name.removeprefix("rrins ") for name in names if name.startswith("rrins "))

    return of_this_test


def cycled(bench, sides):
    """Let a bench navigate, lose its power while it does, and navigate again."""
    navigating(bench)
    bench.advance(0.5)
    turned = bench.last("AXIS_OUTER_STATUS")
    assert bench.last("HEARTBEAT_FIRMWARE")["began_late"] == 0
    bench.inject("power_off", for_s=0.3)
    before = bench.frames
    bench.advance(0.3)
    assert not bench.is_on
    assert sides() == SIDES[bench.way][1:]
    assert bench.frames > before  # those of the hardware
    assert bench.last("AXIS_OUTER_STATUS")["time_s"] > turned["time_s"]
    navigating(bench)
    assert sides() == SIDES[bench.way]
    assert bench.fault_counters["missing_frames"] == 0
    assert bench.expect("HEARTBEAT_FIRMWARE", within=1.1)["began_late"] == 1
    with bench.tester() as tester:
        failed = [one.trouble.name for one in tester.troubles(0x01)]
    assert failed == ["restarted"]
    return bench.frames_sha256


def test_the_hardware_goes_on_and_all_ways_agree(rrins_bench, sides):
    direct, lockstep = (cycled(rrins_bench(QUICK, way=way), sides) for way in WAYS)
    assert direct == lockstep


FAULT = {"kind": "power_off", "at_s": 2.0, "for_s": 0.3}
CUT = load("ideal", duration_s=5, firmware={"alignment_s": 0.5}, faults=[FAULT])


def test_a_direct_run_has_the_fault_too():
    outcome = run_direct(CUT)
    assert not any(outcome.firmware["faults"].values())
    assert outcome.hardware["faults"]["missing_commands"] == 2 * 60  # of two axes for 60 epochs
    begun = 2.3 + 0.5 + 0.5  # self-test and alignment
    assert outcome.firmware["epochs_navigated"] > 200 * (5 - begun)


@pytest.mark.slow
def test_a_rehearsal_starts_the_firmware_again(tmp_path):
    file = tmp_path / "cut.toml"
    file.write_text(CUT.toml(), encoding="utf-8")
    with RunDisplay(CUT, new_console(stderr=True), quiet=True) as display:
        result = run.rehearse(run.Plan(str(file), CUT), display, tmp_path)
    result.check()
    summary = result.summary
    assert summary["hardware"]["faults"]["missing_commands"] == 2 * 60
    assert summary["firmware"]["mode"] == "NAVIGATION_ROTATING"
    assert not any(summary["firmware"]["faults"].values())
    assert result.errors.epoch[-1] > 200 * 5


@pytest.mark.parametrize("way", WAYS)
def test_the_memory_outlives_the_power(rrins_bench, tmp_path, way):
    bench = rrins_bench(QUICK, way=way, memory=tmp_path / "memory")
    bench.advance(1)
    did = table.identifier("axis_watch")
    values = {"follow_tolerance_deg": 2.5, "axis_silence_s": 0.5}
    with bench.tester(is_securing=True) as tester:
        tester.write(did, values)
        bench.power_cycle(0.1)
        bench.advance(1)
        assert tester.read([did])["axis_watch"]["axis_silence_s"] == 0.5


def test_a_program_drives_it_epoch_by_epoch():
    with rrins.bench("ideal", duration_s=5) as bench:
        period_s = bench.scenario.period_ns / 1e9
        bench.step()
        assert bench.time_s == pytest.approx(period_s)
        bench.step(9)
        assert bench.time_s == pytest.approx(10 * period_s)
        navigating(bench)
        assert bench.ram["epoch"] == round(bench.time_s / period_s) - 1
        assert bench.ram["navigation"]["latitude"] == pytest.approx(
            bench.truth.lat_deg * 0.017453292519943295, abs=1e-9
        )
    with rrins.bench("ideal", way="lockstep", duration_s=5) as bench:
        bench.step()
        with pytest.raises(BenchError, match="way='direct'"):
            assert bench.ram


@pytest.mark.soak
@pytest.mark.parametrize("way", ["direct", "lockstep", "realtime"])
def test_power_cuts_at_random_instants_lose_nothing(rrins_bench, sides, tmp_path, way):
    rng = random.Random(7)
    scenario = QUICK | {"duration_s": 60 + 12 * CYCLES}
    bench = rrins_bench(scenario, way=way, memory=tmp_path / "memory")
    did = table.identifier("axis_watch")
    for k in range(CYCLES):
        tolerance = 1.0 + k / 1000
        with bench.tester(is_securing=True) as tester:
            bench.advance(1 + rng.random() * 3)
            tester.write(did, {"follow_tolerance_deg": tolerance, "axis_silence_s": 1.0})
        bench.advance(rng.random() * 0.05)
        bench.power_cycle(rng.random() * 0.5)
        bench.expect("FIRMWARE_STATUS", within=8, where={"mode": "NAVIGATION_ROTATING"})
        assert sides() == SIDES[way]  # no orphan
        with bench.tester() as tester:
            kept = tester.read([did])["axis_watch"]["follow_tolerance_deg"]
        assert kept == pytest.approx(tolerance)
    bench.close()
    assert sides() == []
