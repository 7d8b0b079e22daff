"""Parallel runs on the fast path; threads suffice because the compiled loop releases the GIL.

A campaign's row has errors at 61 instants of a scenario that varies; here are lists of scenarios of
any kind, and all of their errors. How one is run is the campaigns' way.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import repeat

from rrins.firmware_py.core.sensors.calibration import Calibration
from rrins.host_tools.campaigns.engines import processors
from rrins.host_tools.campaigns.row import run_fast
from rrins.host_tools.experiments.calibrated import calibrated
from rrins.host_tools.runs.results.results import Errors
from rrins.host_tools.runs.results.samples import keep_every
from rrins.host_tools.runs.set_up.settings import firmware_settings, scenario_wire
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.tables import Redundancy


def run(
    scenario: Scenario,
    sample_s: float | None = None,
    calibration: Calibration | None = None,
    should_stop: Callable[[], bool] = lambda: False,
) -> Errors:
    """Run a scenario; return its errors, sampled as in a rehearsal or every `sample_s`.

    Its sensors are sound, and sound sensors navigate alike whether they are compared or not.

    Parameters
    ----------
    scenario : Scenario
    sample_s : float, optional
    calibration : Calibration, optional
        Other than the scenario's.
    should_stop : callable
        Looked at now and then.

    Raises
    ------
    RunStoppedError
        When `should_stop` says so before the end.
    """
    scenario = scenario.model_copy(update={"redundancy": Redundancy(enabled=False)})
    assert scenario_wire(scenario) is None, "a wire needs frames"
    if sample_s is None:
        every = keep_every(scenario.epochs, scenario.rate_hz)
    else:
        every = max(1, round(sample_s * scenario.rate_hz))
    settings = firmware_settings(scenario)
    if calibration is not None:
        settings = settings.model_copy(update={"calibration": calibration})
    return run_fast(scenario, settings, every, should_stop)[1]


class Fleet:
    """Runs scenarios in parallel, one per processor.

    Parameters
    ----------
    on_done : callable
        Called after each run, in scenario order.
    """

    def __init__(self, on_done: Callable[[], None] = lambda: None) -> None:
        self._on_done = on_done

    def run_all(
        self,
        scenarios: Iterable[Scenario],
        sample_s: float | None = None,
        calibrations: Sequence[Calibration] | None = None,
    ) -> list[Errors]:
        """Run the scenarios, each with its calibration; return their errors in the same order."""
        stop = threading.Event()
        pool = ThreadPoolExecutor(processors())

        def one(scenario: Scenario, calibration: Calibration | None) -> Errors:
            return run(scenario, sample_s, calibration, stop.is_set)

        try:
            results = []
            for errors in pool.map(one, scenarios, calibrations or repeat(None)):
                results.append(errors)
                self._on_done()
            return results
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)

    def calibrate(self, scenarios: Iterable[Scenario]) -> list[Calibration]:
        """Calibrate the unit of each scenario on its table; return what was found, in order."""
        with ThreadPoolExecutor(processors()) as pool:
            return list(pool.map(calibrated, scenarios))
