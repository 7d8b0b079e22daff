"""Cost of the fast path per epoch beside its limit, and of a navigation step."""

from __future__ import annotations

import statistics
import time

import numpy as np

from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.navigation.strapdown import HEIGHT_HELD
from rrins.firmware_py.core.records.memory import Ins
from rrins.host_tools.benchmarks.limit import Limit
from rrins.host_tools.benchmarks.timed_epochs import timer_overhead_ns
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.runs.together.group import AT_ONCE, Group
from rrins.host_tools.scenario.scenario import Scenario, load
from rrins.host_tools.scenario.tables import Redundancy

SCENARIO = "experiment_rotating"
"""Four gyros and four accelerometers with all errors and noise of table 2, rotating."""

_REPETITIONS = 9
_SETTLE_EPOCHS = 2_000  # aligned and rotating by then
_SHARED_EPOCHS = 50_000  # room for samples


class _Shared:
    """As many runs as share a loop in a campaign, their sensors compared."""

    def __init__(self, scenario: Scenario) -> None:
        every = scenario.rate_hz // 10
        runs = []
        for seed in range(AT_ONCE):
            own = scenario.model_copy(update={"seed": seed})
            runs.append(FastRun.of(firmware_settings(own), hardware_settings(own), every))
        self._group = Group(runs, _SHARED_EPOCHS, every)
        self._group.begin()

    def run(self, epochs: int) -> None:
        """Go on by some epochs, all runs together."""
        self._group.go_on(epochs // AT_ONCE)


def us_per_epoch(epochs: int) -> dict[str, float]:
    """Return the median µs of truth, eight noisy sensors, fusion, navigation and output.

    Without and with parity, the loop written by hand and the runs that share a loop take turns on
    one core in batches of `epochs` or more: those that share a loop run for whole seconds. They
    keep ten samples a second, as in a campaign, the others the navigation of every epoch.
    """
    scenario = load(SCENARIO)
    whole = AT_ONCE * scenario.rate_hz
    epochs = -(-epochs // whole) * whole
    runs: dict[str, FastRun | Limit | _Shared] = {}
    for key, compares in (("fast_path", False), ("fast_path_comparing", True)):
        changed = scenario.model_copy(update={"redundancy": Redundancy(enabled=compares)})
        run = FastRun.of(firmware_settings(changed), hardware_settings(changed))
        run.run(_SETTLE_EPOCHS)
        runs[key] = run
    runs["fast_path_limit"] = Limit(run)
    runs["fast_path_shared"] = _Shared(scenario)
    took_ns: dict[str, list[int]] = {key: [] for key in runs}
    for _ in range(_REPETITIONS):
        for key, each in runs.items():
            start_ns = time.perf_counter_ns()
            each.run(epochs)
            took_ns[key].append(time.perf_counter_ns() - start_ns)
    return {
        f"{key}_us_per_epoch": statistics.median(times) / 1000 / epochs
        for key, times in took_ns.items()
    }


def navigation_step_us(samples: int) -> float:
    """Return the median µs of one call of `strapdown.update` from Python."""
    array = Ins.zeros()
    ins = array[0]
    strapdown.initialise(ins, np.eye(3), 0.7, 2.0, 40.0)
    dtheta_s, dv_s = np.array([0.0, 2.8e-7, 2.4e-7]), np.array([0.0, 0.0, 0.049])
    update = strapdown.update_array
    update(array, dtheta_s, dv_s, 0.005, HEIGHT_HELD)
    took_ns = np.zeros(samples, dtype=np.int64)
    clock = time.perf_counter_ns
    for k in range(samples):
        start_ns = clock()
        update(array, dtheta_s, dv_s, 0.005, HEIGHT_HELD)
        took_ns[k] = clock() - start_ns
    return float(np.median(took_ns) - timer_overhead_ns()) / 1000
