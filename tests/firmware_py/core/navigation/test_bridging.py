"""Lost sensor data: what is bridged adds up."""

from __future__ import annotations

from rrins.firmware_py.core.modes.modes import Mode, ModeRequest
from rrins.firmware_py.core.navigation import bridging


def navigating(tools):
    bench = tools.Bench()
    bench.run_to(Mode.NAVIGATION_STRAPDOWN, ModeRequest.NAVIGATE_STRAPDOWN)
    for _ in range(20):
        bench.step()
    return bench


def test_what_is_bridged_adds_up_to_a_degraded_navigation(tools):
    bench = navigating(tools)
    period_s = bench.period_ns * 1e-9
    lost = 0
    while not bridging.is_degraded(bench.state["bridging"]):
        assert lost * period_s < 1.1
        bench.step([])
        bench.step()
        lost += 1
    assert lost * period_s > 1.0
    assert bench.state["bridging"]["bridged_epochs"] == lost
    for _ in range(round(100 / period_s)):
        bench.step()
    assert not bridging.is_degraded(bench.state["bridging"])
