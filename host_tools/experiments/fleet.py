"""Parallel runs on the fast path; threads suffice because the compiled loop releases the GIL."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor

from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.results import Errors, compare
from rrins.host_tools.runs.samples import keep_every
from rrins.host_tools.runs.settings import firmware_settings, hardware_settings, scenario_wire
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.tables import Redundancy


def run(scenario: Scenario, sample_s: float | None = None) -> Errors:
    """Run a scenario; return its errors, sampled as in a rehearsal or every `sample_s`.

    Its sensors are sound, and sound sensors navigate alike whether they are compared or not.
    """
    scenario = scenario.model_copy(update={"redundancy": Redundancy(enabled=False)})
    assert scenario_wire(scenario) is None, "a wire needs frames"
    if sample_s is None:
        every = keep_every(scenario.epochs, scenario.rate_hz)
    else:
        every = max(1, round(sample_s * scenario.rate_hz))
    both = FastRun.of(firmware_settings(scenario), hardware_settings(scenario), every)
    track = both.run(scenario.epochs)
    return compare(track.navigation, track.truth, scenario.rate_hz)


class Fleet:
    """Runs scenarios in parallel, one per processor.

    Parameters
    ----------
    on_done : callable
        Called after each run, in scenario order.
    """

    def __init__(self, on_done: Callable[[], None] = lambda: None) -> None:
        self._on_done = on_done

    def run_all(self, scenarios: Iterable[Scenario], sample_s: float | None = None) -> list[Errors]:
        """Run the scenarios; return their errors in the same order."""
        pool = ThreadPoolExecutor(len(os.sched_getaffinity(0)))
        try:
            results = []
            for errors in pool.map(lambda scenario: run(scenario, sample_s), scenarios):
                results.append(errors)
                self._on_done()
            return results
        finally:
            pool.shutdown(cancel_futures=True)
