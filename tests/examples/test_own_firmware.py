"""The firmware in C, and in Rust, navigates as ours does. At length: RRINS_OWN_FIRMWARE=1.

The two are compared by what the bus carries: positions in steps of 1e-9 deg, 0.1 mm.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rrins.host_tools.runs import run
from rrins.host_tools.runs.display import RunDisplay
from rrins.host_tools.runs.programs.program import Program
from rrins.host_tools.scenario.scenario import load
from rrins.host_tools.terminal import new_console

IS_FULL = "RRINS_OWN_FIRMWARE" in os.environ
DURATION_S = 1600.0 if IS_FULL else 20.0
REALTIME_S = 1600.0 if IS_FULL else 3.0
STARTS = int(os.environ.get("RRINS_STARTS", "5"))
FRAMES = 1_000_000 if IS_FULL else 50_000
LIMIT_M = 1e-3


@pytest.mark.timeout(1200)
@pytest.mark.parametrize(
    ("language", "name"),
    [
        ("own", "ideal"),
        ("own", "rimu_rotating"),
        ("own", "drive_strapdown"),
        pytest.param(
            "own",
            "rimu_strapdown_self_aligned",
            marks=pytest.mark.skipif(not IS_FULL, reason="RRINS_OWN_FIRMWARE is not set"),
        ),
        ("rust", "rimu_rotating"),
    ],
)
def test_it_navigates_as_ours_within_a_millimetre(
    language: str,
    name: str,
    request: pytest.FixtureRequest,
    largest_difference_m: Callable[..., float],
) -> None:
    scenario = load(name, duration_s=DURATION_S)
    firmware = request.getfixturevalue(f"{language}_firmware")
    program = Program.parse(str(firmware))
    plan = run.Plan(name, scenario, run.Overrides(DURATION_S), firmware=program)
    with RunDisplay(scenario, new_console(stderr=True), quiet=True) as display:
        theirs = run.rehearse(plan, display)
        ours = run.simulate(name, scenario, display)
    theirs.check()
    assert not any(theirs.summary["firmware"]["faults"].values())
    assert theirs.summary["firmware"]["program"] == firmware.name
    assert largest_difference_m(ours.navigation, theirs.navigation) < LIMIT_M
    assert theirs.summary["hardware"]["faults"]["missing_commands"] == 0


@pytest.fixture
def one_core() -> Iterator[None]:
    """Bind what the test starts to one core: a stall of it stops both sides."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(cores)})
    yield
    os.sched_setaffinity(0, cores)


@pytest.mark.timeout(2000)
@pytest.mark.usefixtures("one_core")
@pytest.mark.parametrize("name", ["rimu_rotating", pytest.param("ideal", marks=pytest.mark.soak)])
def test_in_real_time_it_navigates_as_ours(
    name: str, own_firmware: Path, largest_difference_m: Callable[..., float]
) -> None:
    scenario = load(name, duration_s=REALTIME_S)
    program = Program.parse(str(own_firmware))
    plan = run.Plan(name, scenario, run.Overrides(REALTIME_S), speed=1.0, firmware=program)
    with RunDisplay(scenario, new_console(stderr=True), quiet=True) as display:
        theirs = run.rehearse(plan, display)
        ours = run.simulate(name, scenario, display)
    theirs.check()
    assert theirs.summary["firmware"]["faults"]["bridged_epochs"] == 0
    assert largest_difference_m(ours.navigation, theirs.navigation) < LIMIT_M


@pytest.fixture
def busy_machine() -> Iterator[None]:
    """Let two loops keep the processors busy."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    yield
    for loop in loops:
        loop.kill()
        loop.wait()


@pytest.mark.soak
@pytest.mark.usefixtures("busy_machine")
@pytest.mark.parametrize("language", ["own", "rust"])
def test_on_a_busy_machine_it_loses_its_sensors_only_where_it_counts_overruns(
    language: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    scenario = load("rimu_rotating", duration_s=5.0, firmware={"alignment_s": 0.5})
    file = tmp_path / "scenario.toml"
    file.write_text(scenario.toml(), encoding="utf-8")
    program = Program.parse(str(request.getfixturevalue(f"{language}_firmware")))
    plan = run.Plan(str(file), scenario, run.Overrides(), speed=1.0, firmware=program)
    states = []
    for _ in range(STARTS):
        with RunDisplay(scenario, new_console(stderr=True), quiet=True) as display:
            outcome = run.rehearse(plan, display)
        firmware = outcome.summary["firmware"]
        if "fault" not in firmware:
            outcome.check()
        states.append((firmware["fault"], firmware["faults"]["overruns"] > 0))
    print(f"{language}: {Counter(states)}")
    assert ("SENSORS_LOST", False) not in states


def test_random_frames_do_it_no_harm(own_firmware: Path, make_firmware) -> None:
    said = make_firmware(own_firmware.parent, "fuzz", f"FRAMES={FRAMES}")
    navigated = int(re.findall(r"(\d+) epochs navigated", said)[0])
    assert navigated > FRAMES // 10  # in every mode, not in the self-test alone


def test_a_wrong_set_up_is_one_line(own_firmware: Path, tmp_path: Path) -> None:
    for text, words in (
        ("rrins-setup 2\n", "not a set-up of version 1"),
        ("rrins-setup 1\nlatitude_deg north\n", "line 2: latitude_deg: not as it should be"),
        ("rrins-setup 1\nrate_hz 200\n", "latitude_deg: missing, or not enough"),
    ):
        (tmp_path / "setup.txt").write_text(text)
        done = subprocess.run(
            [own_firmware, "--setup", tmp_path / "setup.txt"],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 1
        assert done.stderr == f"own_firmware: {tmp_path / 'setup.txt'}: {words}\n"


def test_a_strangers_test_runs_with_it(own_firmware: Path, rrins_bench) -> None:
    bench = rrins_bench("rimu_rotating", program=str(own_firmware), firmware={"alignment_s": 1})
    assert bench.way == "lockstep"
    bench.expect("FIRMWARE_STATUS", within=5, where={"mode": "NAVIGATION_ROTATING"})
    bench.inject("drop", message="SENSOR_3")
    bench.expect("FIRMWARE_STATUS", within=0.5, where={"usable_sensors": 3})
    bench.advance(5)
    assert bench.mode == "NAVIGATION_ROTATING"
    assert bench.fault_counters["missing_frames"] > 0
    assert abs(bench.errors_m().east) < 1
