"""The C firmware on the kernel's vcan0 navigates as ours does without a bus.

Runs where vcan0 is; with RRINS_REQUIRE_SOCKETCAN set, its lack is a failure. RRINS_C_FIRMWARE names
the program where it is built already. At length, and in real time, which an emulated machine does
not keep: RRINS_OWN_FIRMWARE=1.
"""

from __future__ import annotations

import os
import socket

import pytest

from rrins.host_tools.runs import run
from rrins.host_tools.runs.display import RunDisplay
from rrins.host_tools.runs.program import Program
from rrins.host_tools.scenario.scenario import load
from rrins.host_tools.terminal import new_console

IS_FULL = "RRINS_OWN_FIRMWARE" in os.environ
DURATION_S = 1600.0 if IS_FULL else 3.0
LIMIT_M = 1e-3


@pytest.fixture(autouse=True)
def _vcan0():
    if "vcan0" not in [name for _, name in socket.if_nameindex()]:
        if "RRINS_REQUIRE_SOCKETCAN" in os.environ:
            pytest.fail("the kernel has no vcan0")
        pytest.skip("the kernel has no vcan0")


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
            1.0, id="real time", marks=pytest.mark.skipif(not IS_FULL, reason="at length")
        ),
    ],
)
def test_it_navigates_as_ours_within_a_millimetre(name, speed, program, largest_difference_m):
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
    assert largest_difference_m(ours.navigation, theirs.navigation) < LIMIT_M
