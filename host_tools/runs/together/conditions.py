"""Which runs can share a loop: those that differ in their sensors, and have no more to do."""

from __future__ import annotations

from typing import Any

import numpy as np

from rrins.compiled.compilation import IS_DISABLED
from rrins.firmware_py.core.navigation.strapdown import HEIGHT_HELD
from rrins.host_tools.hardware.fault_kinds import AIDS
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.together import rows

_KINDS = ("gyros", "accelerometers")

_OWN_OF_SENSORS = frozenset(
    {
        *("axis", "mounted_axis", "axis_by_angle", "scale_error", "asymmetric_scale_error"),
        *("bias_increment", "noise_increment", "g_sensitivity", "range_increment"),
        *("constant_bias_increment", "constant_scale_error", "bias_temperature_increment"),
        *("scale_temperature", "flicker_drive", "flicker_state", "walk_drive", "walk_state"),
        *("drifts", "noise_state", "noise_spare", "noise_has_spare"),
    }
)
"""Fields that each run's sensors have of their own."""

_OWN_OF_PLANT = frozenset({"thermal", *AIDS})
"""The same of its plant: temperature, and what is not fitted."""

_LARGEST_ERROR_DEG, _MEMORY_S = 0.05, 20.0
"""By how much gyros may err in the time that the firmware compares them with the encoders over:
with less, they outvote none."""


def can_share(run: FastRun) -> bool:
    """Return whether a run at power-on does nothing that a loop for several leaves out."""
    plant, state = run.plant[0], run.ram[0]
    if IS_DISABLED or state.estimator.enabled or state.size_effect.present:
        return False
    parameters = state.parameters
    if parameters.isolate_heading or parameters.altimeter:
        return False
    if parameters.height_channel != HEIGHT_HELD:
        return False
    if any(plant[each].fitted for each in AIDS) or plant.master.present:
        return False
    if plant.faults.count or plant.readmissions.count or plant.standing.count:
        return False
    return all(_is_plain(plant, state, kind) for kind in _KINDS) and _is_moderate(plant, state)


def _is_plain(plant: Any, state: Any, kind: str) -> bool:
    """Return whether the sensors of a kind have no more than errors that are linear, and noise."""
    sensors, fusion = plant[kind], state[kind]
    if not 3 <= sensors.count <= rows.SENSORS or fusion.count != sensors.count:
        return False
    if sensors.displaced or sensors.resolution > 0.0 or np.any(sensors.dead_zone_increment):
        return False
    if not state.redundancy.enabled:
        return True
    # Four sensors have one parity; of more, the shortest windows have several to test. Without
    # noise these windows are full of what has not been learned yet.
    return sensors.count == 4 and bool(np.all(sensors.noise_increment[: sensors.count] > 0.0))


def _is_moderate(plant: Any, state: Any) -> bool:
    """Return whether the gyros' errors are too small to make anybody doubt an encoder."""
    sensors, fusion = plant.gyros, state.gyros
    own = slice(0, int(sensors.count))
    asymmetric = np.abs(sensors.asymmetric_scale_error[own])
    scale = 1.0 + sensors.scale_error[own]
    measured = scale[:, None] * sensors.axis[own]
    gain = np.linalg.pinv(np.asarray(fusion.H[own]))
    off = np.abs(gain @ measured - np.eye(3)).sum(axis=1) + np.abs(gain) @ asymmetric
    bias = np.abs(gain) @ np.abs(sensors.constant_bias_increment[own])
    bias_dps = np.degrees(bias) / (plant.period_ns * 1e-9)
    return bool(
        np.all(20.0 * (off * state.parameters.turn_rate_dps + bias_dps) < _LARGEST_ERROR_DEG)
    )


def shared_of(run: FastRun) -> bytes:
    """Return what has to be equal for runs to share a loop: all but what is a sensor's own."""
    common = run.plant.copy()
    for name in _OWN_OF_PLANT:
        common[name] = np.zeros(1, common[name].dtype)
    for kind in _KINDS:
        for name in _OWN_OF_SENSORS:
            common[kind][name] = np.zeros(1, common[kind][name].dtype)
    state = run.ram[0]
    own = state.parameters.tobytes(), state.redundancy.enabled, state.sequencer.tobytes()
    return common.tobytes() + run.pieces.tobytes() + repr(own).encode()
