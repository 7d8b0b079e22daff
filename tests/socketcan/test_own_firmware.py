"""The C firmware on the kernel's vcan0 navigates as ours does without a bus.

Runs where vcan0 is; with RRINS_REQUIRE_SOCKETCAN set, its lack is a failure. RRINS_C_FIRMWARE names
the program where it is built already. At length: RRINS_OWN_FIRMWARE=1. In real time: only where it
can be kept, which RRINS_KEEPS_TIME says, and at a low rate if not at length; `.ci/socketcan`
has an emulated machine that keeps it.
"""

from __future__ import annotations

import os

import pytest

from rrins.host_tools.runs import run
from rrins.host_tools.runs.display import RunDisplay
from rrins.host_tools.runs.programs.program import Program
from rrins.host_tools.scenario.scenario import load, text_of
from rrins.host_tools.terminal import new_console

pytestmark = pytest.mark.soak

IS_FULL = "RRINS_OWN_FIRMWARE" in os.environ
KEEPS_TIME = "RRINS_KEEPS_TIME" in os.environ
DURATION_S = 1600.0 if IS_FULL else 3.0
SLOW_RATE_HZ = 80  # the lowest at which logs and navigation frames, each 50 ms, have common epochs
LIMIT_M = 1e-3


@pytest.fixture(scope="module")
def program(request, tmp_path_factory):
    built = os.environ.get("RRINS_C_FIRMWARE")
    if built is not None:
        return Program.parse(built)
    make_firmware = request.getfixturevalue("make_firmware")
    folder = tmp_path_factory.mktemp("own_firmware")
    make_firmware(folder, str(folder / "own_firmware"), "CFLAGS=-O2")
    return Program.parse(str(folder / "own_firmware"))


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", ["ideal", "rimu_rotating"])
@pytest.mark.parametrize(
    "speed",
    [
        pytest.param(None, id="lockstep"),
        pytest.param(
            1.0,
            id="real time",
            marks=pytest.mark.skipif(not KEEPS_TIME, reason="RRINS_KEEPS_TIME is not set"),
        ),
    ],
)
def test_it_navigates_as_ours_within_a_millimetre(
    name, speed, program, largest_difference_m, tmp_path
):
    if speed is not None and not IS_FULL:
        slow = tmp_path / f"{name}.toml"
        slow.write_text(f"rate_hz = {SLOW_RATE_HZ}\n{text_of(name)}", encoding="utf-8")
        name = str(slow)
    scenario = load(name, duration_s=DURATION_S)
    plan = run.Plan(
        name,
        scenario,
        run.Overrides(DURATION_S),
        bus=run.BusOptions("socketcan", "vcan0"),
        speed=speed,
        firmware=program,
        patience_s=120.0,
    )
    with RunDisplay(scenario, new_console(stderr=True), quiet=True) as display:
        theirs = run.rehearse(plan, display)
        ours = run.simulate(name, scenario, display, with_frames=True)  # compiled as in rehearsals
    theirs.check()
    assert theirs.summary["interface"] == "socketcan"
    assert not any(theirs.summary["firmware"]["faults"].values())
    assert theirs.summary["hardware"]["faults"]["missing_commands"] == 0
    assert largest_difference_m(ours.navigation, theirs.navigation) < LIMIT_M
