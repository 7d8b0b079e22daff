"""What the fast path costs for each epoch, and one step of the navigation by itself."""

from __future__ import annotations

import statistics
import time

import numpy as np

from firmware_py import strapdown
from firmware_py.memory import INS
from firmware_py.strapdown import HEIGHT_HELD
from host_tools.bench.compute import timer_overhead_ns
from host_tools.fast import FastRun
from host_tools.outfit import firmware_settings, hardware_settings
from host_tools.scenario import load

SCENARIO = "experiment_rotating"
"""Four gyros and four accelerometers with all errors and noise of table 2, turning."""

_REPETITIONS = 9
_SETTLE_EPOCHS = 2_000  # aligned and turning by then


def us_per_epoch(epochs: int) -> float:
    """Return the median µs of an epoch: truth, eight noisy sensors, fusion, navigation, output.

    On one core, in stretches of `epochs`, the navigation output of every epoch kept.
    """
    scenario = load(SCENARIO)
    run = FastRun.of(firmware_settings(scenario), hardware_settings(scenario))
    run.run(_SETTLE_EPOCHS)
    took_ns = []
    for _ in range(_REPETITIONS):
        start_ns = time.perf_counter_ns()
        run.run(epochs)
        took_ns.append(time.perf_counter_ns() - start_ns)
    return statistics.median(took_ns) / 1000 / epochs


def navigation_step_us(samples: int) -> float:
    """Return the median µs of one call of `firmware_py.strapdown.update` from Python."""
    array = np.zeros(1, dtype=INS)
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
