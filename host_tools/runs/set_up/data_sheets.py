"""Data sheet of the sensors in the firmware, as a scenario's errors imply it.

Noise, drift and temperature are taken as they are; of the constant errors only the limits, which
are those of the worst sensor, and no less than what the best sensors have.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rrins.firmware_py.core.estimator.settings import EstimatorSettings
from rrins.firmware_py.core.integrity.settings import IntegritySettings
from rrins.firmware_py.core.redundancy.settings import RedundancySettings
from rrins.firmware_py.core.sensors.data_sheet import DataSheet
from rrins.host_tools.hardware.tables import Accelerometers, Gyros, PerSensor, Thermal
from rrins.host_tools.hardware.units import ARCSEC, PPM, SQRT_H, STANDARD_GRAVITY, by_name, in_si
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.tables import each

_LEAST_FORCE_DPH_PER_G = 0.01
_LEAST_SCALE_PPM = 1.0
_LEAST_ASYMMETRY_PPM = 1.0
_LEAST_INSTALLATION_ARCSEC = 0.2
_LEAST_SLOPE_PPM = 3.0
_LEAST_FILTER_SLOPE_PPM = 0.1
_REPEATS_WITHIN = 3.0  # standard deviations
_TEMPERATURES_K = 10.0  # that a scale factor is used over


class _Leasts(NamedTuple):
    """Figures of the best sensors, in the unit of the table's bias."""

    bias: float
    bias_sigma: float


_GYROS = _Leasts(bias=10.0, bias_sigma=0.05)
_ACCELEROMETERS = _Leasts(bias=1000.0, bias_sigma=50.0)


def _largest(*values: PerSensor) -> float:
    return max(float(np.max(np.abs(value))) for value in values)


def _mean_square(*values: PerSensor) -> float:
    return sum(float(np.mean(np.square(value))) for value in values)


def _slope_sigma(table: Gyros | Accelerometers, least_ppm: float = _LEAST_SLOPE_PPM) -> float:
    """Return how much a component is off by scale factors and installation, all in all."""
    scale = _mean_square(table.scale_error_ppm, table.scale_repeatability_ppm)
    installed = _mean_square(table.installation_u_arcsec, table.installation_v_arcsec)
    return max(least_ppm * PPM, math.sqrt(scale * PPM**2 + installed * ARCSEC**2))


def _sigmas(table: Gyros | Accelerometers) -> dict[str, float]:
    """Return the standard deviations of scale factors and installation errors, each by itself."""
    scale = math.sqrt(_mean_square(table.scale_error_ppm, table.scale_repeatability_ppm))
    asymmetry = math.sqrt(_mean_square(table.asymmetric_scale_error_ppm))
    both = _mean_square(table.installation_u_arcsec, table.installation_v_arcsec)
    return {
        "scale_sigma": max(_LEAST_SCALE_PPM, scale) * PPM,
        "asymmetry_sigma": max(_LEAST_ASYMMETRY_PPM, asymmetry) * PPM,
        "installation_sigma": max(_LEAST_INSTALLATION_ARCSEC, math.sqrt(both / 2)) * ARCSEC,
    }


def _limits(table: Gyros | Accelerometers) -> dict[str, float]:
    """Return the limits of the errors that both kinds have."""
    repeat = _REPEATS_WITHIN * _largest(table.scale_repeatability_ppm)
    warm = _largest(table.scale_temperature_ppm_per_k) * _TEMPERATURES_K
    again = math.sqrt(_mean_square(table.scale_repeatability_ppm))
    scale = max(_LEAST_SCALE_PPM, _largest(table.scale_error_ppm) + repeat + warm)
    installation = _largest(table.installation_u_arcsec, table.installation_v_arcsec)
    asymmetry = _largest(table.asymmetric_scale_error_ppm)
    return {
        "scale_limit": scale * PPM,
        "asymmetry_limit": max(_LEAST_ASYMMETRY_PPM, asymmetry) * PPM,
        "installation_limit": max(_LEAST_INSTALLATION_ARCSEC, installation) * ARCSEC,
        "slope_sigma": _slope_sigma(table),
        "scale_stability": math.hypot(again, warm) * PPM,
        **_sigmas(table),
    }


def _bias_sigma(table: Gyros | Accelerometers, leasts: _Leasts, more: float = 0.0) -> float:
    """Return the standard deviation of a bias in SI units, with `more` of another cause."""
    keys = by_name(table)
    parts = (keys[name][0] for name in ("bias", "bias_repeatability", "bias_instability"))
    unit = keys["bias"][1]
    return max(leasts.bias_sigma * unit, math.hypot(math.sqrt(_mean_square(*parts)) * unit, more))


def _data_sheet(
    table: Gyros | Accelerometers, count: int, thermal: Thermal, leasts: _Leasts
) -> DataSheet:
    """Return the data sheet of the sensors of a kind; sums are formed in the table's own units."""
    keys = by_name(table)
    value = {name: value for name, (value, _) in keys.items()}
    unit = keys["bias"][1]

    def each_in_si(name: str) -> tuple[float, ...]:
        value, si = keys[name]
        return tuple(v * si for v in each(value, count))

    repeat = _REPEATS_WITHIN * _largest(value["bias_repeatability"])
    force = value.get("g_sensitivity")
    of_force = (
        {}
        if force is None
        else {
            "force_limit": max(_LEAST_FORCE_DPH_PER_G, _largest(force)) * unit / STANDARD_GRAVITY,
            "force_sigma": math.sqrt(_mean_square(force)) * unit / STANDARD_GRAVITY,
        }
    )
    return DataSheet(
        white_noise=each_in_si("white_noise"),
        resolution=value["resolution"] * keys["resolution"][1],
        bias_instability=each_in_si("bias_instability"),
        rate_random_walk=tuple(v * unit / SQRT_H for v in each(value["rate_random_walk"], count)),
        temperature_drift=tuple(
            abs(v) * abs(thermal.warm_up_k) * unit for v in each(value["bias_temperature"], count)
        ),
        temperature_s=thermal.time_constant_s,
        bias_limit=max(leasts.bias, _largest(value["bias"]) + repeat) * unit,
        bias_sigma=_bias_sigma(table, leasts),
        **of_force,
        **_limits(table),
    )


def _gyros(scenario: Scenario) -> DataSheet:
    count = len(scenario.rimu.gyros)
    return _data_sheet(scenario.gyros, count, scenario.thermal, _GYROS)


def _accelerometers(scenario: Scenario) -> DataSheet:
    count = len(scenario.rimu.accelerometers)
    return _data_sheet(scenario.accelerometers, count, scenario.thermal, _ACCELEROMETERS)


def data_sheets_of(scenario: Scenario) -> tuple[DataSheet, DataSheet]:
    """Return the data sheets of a scenario's gyros and accelerometers."""
    return _gyros(scenario), _accelerometers(scenario)


def _lag_s(table: Gyros) -> float:
    """Return how late gyros are: a first-order bandwidth, and the latency."""
    bandwidth = table.bandwidth_hz
    lag_s = 0.0 if bandwidth is None else 1.0 / (2.0 * math.pi * bandwidth)
    return lag_s + table.latency_ms * 1e-3


def redundancy_settings(scenario: Scenario) -> RedundancySettings | None:
    """Return the set-up of the firmware's redundancy for a scenario; None where it compares none.

    Of a unit without redundant sensors there is nothing to compare.
    """
    rimu = scenario.rimu
    if not scenario.redundancy.enabled or max(len(rimu.gyros), len(rimu.accelerometers)) <= 3:
        return None
    return RedundancySettings(
        false_alarms_per_1000_h=scenario.redundancy.false_alarms_per_1000_h,
        non_orthogonality_limit=abs(scenario.turntable.non_orthogonality_arcsec) * ARCSEC,
        wobble_limit=scenario.turntable.wobble_arcsec * ARCSEC,
        gyro_lag_s=_lag_s(scenario.gyros),
        gyros=_gyros(scenario),
        accelerometers=_accelerometers(scenario),
    )


def attitude_sigmas(scenario: Scenario) -> tuple[float, float]:
    """Return what is told of a given or transferred attitude: sigma of level and heading, rad.

    What the scenario says of them, else what it draws.
    """
    said, drawn = scenario.estimator, scenario.firmware
    level, heading = said.level_sigma_arcsec, said.heading_sigma_arcsec
    level = drawn.level_error_sigma_arcsec if level is None else level
    heading = drawn.heading_error_sigma_arcsec if heading is None else heading
    return level * ARCSEC, heading * ARCSEC


def _filter_sheet(sheet: DataSheet, table: Gyros | Accelerometers, gravity: bool) -> DataSheet:
    """Return the data sheet for the filter; its bias may have what gravity makes of errors, too."""
    is_gyro = isinstance(table, Gyros)
    stated = sheet.model_copy(update={"slope_sigma": _slope_sigma(table, 0.0)})
    made = math.sqrt(stated.turn_variance(is_gyro)) if gravity else 0.0
    changes = {
        "slope_sigma": _slope_sigma(table, _LEAST_FILTER_SLOPE_PPM),
        "bias_sigma": _bias_sigma(table, _GYROS if is_gyro else _ACCELEROMETERS, made),
    }
    return sheet.model_copy(update=changes)


def estimator_settings(scenario: Scenario) -> EstimatorSettings | None:
    """Return the set-up of the firmware's estimator for a scenario; None where it has none."""
    table = scenario.estimator
    if not table.enabled:
        return None
    level_sigma, heading_sigma = attitude_sigmas(scenario)
    return EstimatorSettings(
        gyros=_filter_sheet(_gyros(scenario), scenario.gyros, True),
        accelerometers=_filter_sheet(
            _accelerometers(scenario), scenario.accelerometers, not scenario.estimates_constants
        ),
        constants=scenario.estimates_constants,
        fine_alignment_s=table.fine_alignment_s,
        heading_sigma_enough=table.heading_sigma_enough_arcsec * ARCSEC,
        zero_velocity_sigma=table.zero_velocity_sigma_mps,
        detects_standing=table.detects_standing,
        position_sigma=table.position_sigma_m,
        gate=table.gate,
        level_sigma=level_sigma,
        heading_sigma=heading_sigma,
        **_altimeter(scenario),
        **_receiver(scenario),
    )


def integrity_settings(scenario: Scenario) -> IntegritySettings | None:
    """Return the set-up of the firmware's integrity for a scenario; None where it has none."""
    table = scenario.integrity
    return IntegritySettings(**table.model_dump(exclude={"enabled"})) if table.enabled else None


def _receiver(scenario: Scenario) -> dict[str, float]:
    """Return what the firmware knows of the receiver, beyond what that tells in its frames."""
    if scenario.gnss is None:
        return {}
    return {
        "receiver_sigma": scenario.gnss.position_correlated_noise_m,
        "receiver_s": scenario.gnss.position_correlation_s,
    }


def _altimeter(scenario: Scenario) -> dict[str, float]:
    """Return what the firmware knows of the altimeter: the weather is as usual, or worse."""
    if scenario.altimeter is None:
        return {}
    altimeter, usual = in_si(scenario.altimeter), EstimatorSettings.model_fields
    return {
        "altimeter_sigma": altimeter["noise"],
        "altimeter_bias_sigma": max(usual["altimeter_bias_sigma"].default, abs(altimeter["bias"])),
        "altimeter_walk": max(usual["altimeter_walk"].default, altimeter["random_walk"]),
    }
