"""Checks of what a navigation computer does: start-up, modes, commands, axes."""

from __future__ import annotations

import time

from rrins.host_tools.conformance.check import Subject, check, expect_mode
from rrins.host_tools.testing.bench import Bench
from rrins.host_tools.testing.expectation import Where

_COMMANDS = ("AXIS_INNER_COMMAND", "AXIS_OUTER_COMMAND")
_MODULUS = 15
_END_S = 5.0
_ANEW_S = 1.1  # after power-on the first heartbeat has come


@check("firmware.md#modes", "MODE-1 OUT-1 TX-100-3 TX-701-3")
def start_up(subject: Subject) -> None:
    """Heartbeat and status come at their cycle times; STANDBY after a self-test of 0.5 s."""
    bench = subject.bench(navigate_at_s=3600)
    bench.expect("HEARTBEAT_FIRMWARE", within=1.5)
    bench.expect("FIRMWARE_STATUS", within=0.3)
    expect_mode(bench, "STANDBY", 2)
    bench.expect("FIRMWARE_STATUS", within=1.05, at_least=10)
    bench.expect("HEARTBEAT_FIRMWARE", within=2.05, at_least=2)
    bench.expect_not("NAV_LATITUDE", within=0.5)


@check("firmware.md#modes", "MODE-2 MODE-8")
def self_test(subject: Subject) -> None:
    """A sensor that is absent ends the self-test in FAULT (SELF_TEST_FAILED) after 10 s.

    A request for STANDBY begins it anew.
    """
    faults = [{"kind": "gyro_absent", "sensor": 1, "at_s": 0.0}]
    bench = subject.bench(faults=faults, redundancy={"enabled": False})
    where = {"mode": "FAULT", "fault": "SELF_TEST_FAILED"}
    bench.expect("FIRMWARE_STATUS", within=11, where=where)
    assert bench.time_s > 9.5, f"the self-test failed after {bench.time_s:.1f} s, not 10 s"
    bench.clear_faults()
    bench.send("MODE_COMMAND", mode_request="STANDBY")
    expect_mode(bench, "STANDBY", 2)


@check("firmware.md#frames-out", "OUT-2 TX-02?-2 TX-02?-3")
def commands(subject: Subject) -> None:
    """A command for each axis in every epoch, with the epoch as its counter."""
    bench = subject.navigating()
    first = {name: len(bench.messages(name)) for name in _COMMANDS}
    begin = round(bench.time_s * bench.scenario.rate_hz)
    bench.advance(1)
    for name in _COMMANDS:
        came = list(bench.messages(name))[first[name] :]
        assert len(came) == bench.scenario.rate_hz, (
            f"{len(came)} {name} in {bench.scenario.rate_hz} epochs"
        )
        wrong = [k for k, one in enumerate(came) if one["alive_counter"] != (begin + k) % _MODULUS]
        assert not wrong, f"{name} has the counter of another epoch in {len(wrong)} of {len(came)}"
        assert all(one["crc_holds"] for one in came), f"{name} has a wrong CRC"


@check("firmware.md#modes", "MODE-6 MODE-7 AXS-2")
def modes(subject: Subject) -> None:
    """Every mode is reached on request; ALIGN alone waits; no NAV_ frames but in navigation."""
    bench = subject.bench(navigate_at_s=3600)
    expect_mode(bench, "STANDBY", 2)
    _request(bench, "ALIGN", "ALIGNMENT")
    bench.advance(2)
    assert bench.mode == "ALIGNMENT", "ALIGN alone goes on into navigation"
    _request(bench, "NAVIGATE_STRAPDOWN", "NAVIGATION_STRAPDOWN")
    bench.expect("AXIS_INNER_COMMAND", within=0.05, where={"command": "HOLD"})
    _request(bench, "NAVIGATE_ROTATING", "NAVIGATION_ROTATING")
    bench.expect("AXIS_INNER_COMMAND", within=0.05, where={"command": "POSITION"})
    bench.expect("NAV_LATITUDE", within=1.05, at_least=20)
    _request(bench, "NAVIGATE_STRAPDOWN", "NAVIGATION_STRAPDOWN")
    _request(bench, "STANDBY", "STANDBY")
    bench.expect_not("NAV_LATITUDE", within=0.5)


@check("firmware.md#modes", "MODE-9")
def shutdown(subject: Subject) -> None:
    """SHUTDOWN switches both axes OFF, and the program ends with status 0."""
    bench = subject.navigating()
    process = bench.process
    bench.send("MODE_COMMAND", mode_request="SHUTDOWN")
    bench.expect("AXIS_OUTER_COMMAND", within=0.02, where={"command": "OFF"})
    deadline = time.monotonic() + _END_S
    while process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    assert process.poll() is not None, f"the program still runs {_END_S:g} s after SHUTDOWN"
    assert process.poll() == 0, f"the program ends with status {process.poll()} after SHUTDOWN"


@check("firmware.md#power", "PWR-1 PWR-2")
def power_cycles(subject: Subject) -> None:
    """After a loss of power at any instant it navigates again, and says that it began late."""
    bench = subject.navigating()
    for navigated_s, off_s in ((0.3, 0.02), (0.013, 0.2), (1.0, 0.5)):
        bench.advance(navigated_s)
        bench.inject("power_off", for_s=off_s)
        bench.advance(off_s + bench.scenario.period_ns * 1e-9)
        first = bench.expect("HEARTBEAT_FIRMWARE", within=1.05)
        assert first["began_late"] == 1, "HEARTBEAT_FIRMWARE.began_late is 0 after a restart"
        assert first["uptime"] <= _ANEW_S, f"uptime is {first['uptime']} s: it did not begin anew"
        expect_mode(bench, "NAVIGATION_ROTATING", 8)
        counted = {name: count for name, count in bench.fault_counters.items() if count}
        assert not counted, f"after a restart it counts {counted}"


def _request(bench: Bench, request: str, mode: str) -> None:
    bench.send("MODE_COMMAND", mode_request=request)
    expect_mode(bench, mode, 2)


@check("firmware.md#rotation-scheme", "AXS-3 AXS-4")
def axis_fault(subject: Subject) -> None:
    """An axis that does not follow is reported and both hold; the rotation is tried again."""
    bench = subject.navigating()
    bench.inject("axis_stall", axis="inner", for_s=20.0)
    where: Where = {"mode": "NAVIGATION_STRAPDOWN", "axis_inner_not_following": 1}
    bench.expect("FIRMWARE_STATUS", within=8, where=where)
    bench.expect("AXIS_INNER_COMMAND", within=0.05, where={"command": "HOLD"})
    bench.advance(1)
    assert bench.navigation is not None, "navigation has ended"
    expect_mode(bench, "NAVIGATION_ROTATING", 30)


@check("firmware.md#rotation-scheme", "AXS-3")
def axis_silent(subject: Subject) -> None:
    """An axis that is silent for longer than `axis_silence_s` does not follow."""
    bench = subject.navigating()
    bench.inject("drop", message="AXIS_OUTER_STATUS", for_s=1.5)
    where: Where = {"mode": "NAVIGATION_STRAPDOWN", "axis_outer_not_following": 1}
    bench.expect("FIRMWARE_STATUS", within=1.5, where=where)
