"""The C firmware on the kernel's vcan0 navigates as ours does without a bus.

Runs where vcan0 is; with RRINS_REQUIRE_SOCKETCAN set, its lack is a failure. At length:
RRINS_OWN_FIRMWARE=1.
"""

from __future__ import annotations

import os
import re
import socket

import pytest

from rrins.host_tools.runs import run
from rrins.host_tools.runs.display import RunDisplay
from rrins.host_tools.runs.program import Program
from rrins.host_tools.scenario.scenario import load, text_of
from rrins.host_tools.terminal import new_console

DURATION_S = 1600.0 if "RRINS_OWN_FIRMWARE" in os.environ else 5.0
LIMIT_M = 1e-3


@pytest.fixture(autouse=True)
def _vcan0():
    if "vcan0" not in [name for _, name in socket.if_nameindex()]:
        if "RRINS_REQUIRE_SOCKETCAN" in os.environ:
            pytest.fail("the kernel has no vcan0")
        pytest.skip("the kernel has no vcan0")


@pytest.fixture(scope="module")
def program(make_firmware, tmp_path_factory):
    folder = tmp_path_factory.mktemp("own_firmware")
    make_firmware(folder, str(folder / "own_firmware"), "CFLAGS=-O2")
    return Program.parse(str(folder / "own_firmware"))


@pytest.fixture
def scenario_file(tmp_path):
    """Return what writes a built-in scenario to a file, at another rate."""

    def write(name, rate_hz):
        text = re.sub(r"(?m)^rate_hz.*$", "", text_of(name))
        path = tmp_path / f"{name}.toml"
        path.write_text(f"rate_hz = {rate_hz}\n{text}")
        return str(path)

    return write


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", ["ideal", "rimu_rotating"])
@pytest.mark.parametrize(
    ("speed", "rate_hz"), [(None, 200), (1.0, 50)], ids=["lockstep", "real time"]
)
def test_it_navigates_as_ours_within_a_millimetre(
    name, speed, rate_hz, program, scenario_file, largest_difference_m
):
    # Slow in real time, for the machine may be an emulated one.
    path = scenario_file(name, rate_hz)
    scenario = load(path, duration_s=DURATION_S)
    plan = run.Plan(
        path,
        scenario,
        run.Overrides(DURATION_S),
        bus=run.BusOptions("socketcan", "vcan0"),
        speed=speed,
        firmware=program,
        patience_s=120.0,
    )
    with RunDisplay(scenario, new_console(stderr=True), quiet=True) as display:
        theirs = run.rehearse(plan, display)
        ours = run.simulate(path, scenario, display)
    theirs.check()
    assert theirs.summary["interface"] == "socketcan"
    assert not any(theirs.summary["firmware"]["faults"].values())
    assert largest_difference_m(ours.navigation, theirs.navigation) < LIMIT_M
