"""Runs of a unit with noise, and the error of their attitude."""

from __future__ import annotations

import numpy as np

from rrins.firmware_py.core.maths.attitude import matrix_of_euler
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings

WHITE_NOISE = {
    "gyros": {
        "angle_random_walk_deg_per_sqrt_h": 0.005,
        "scale_error_ppm": [2, -2, 1, -1],
        "installation_u_arcsec": [1, -1, 0.5, 0],
        "bias_dph": 0.0,
    },
    "accelerometers": {"white_noise_ug_per_sqrt_hz": 10, "bias_ug": 0.0},
}


def fast_run(scenario):
    return FastRun.of(firmware_settings(scenario), hardware_settings(scenario), scenario.rate_hz)


def attitude_error(navigation, truth):
    """Return the turn about the axes of n that would mend the attitude, rad."""
    matrices = np.zeros((2, 3, 3))
    for C_b_n, row in zip(matrices, (navigation, truth), strict=True):
        matrix_of_euler(C_b_n, float(row["roll"]), float(row["pitch"]), float(row["heading"]))
    D = matrices[1] @ matrices[0].T
    return np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]]) / 2
