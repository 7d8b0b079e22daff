"""What a run's summary says of the estimator: sigmas, biases beside the truth, what aided it."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from rrins.firmware_py.core.records.estimator_records import (
    ESTIMATOR_HISTORY_S,
    PITCH,
    SCALE,
    SENSOR_CONSTANTS,
    YAW,
    Aid,
    EstimatorSecond,
)
from rrins.firmware_py.core.records.memory import Fusion, Ram
from rrins.firmware_py.core.sensors.calibration import ARCSEC, DPH, PPM, UG
from rrins.host_tools.files import JsonObject, write_whole

_UNITS = {"gyros": ("dph", DPH), "accelerometers": ("ug", UG)}
_AXES = ("x", "y", "z")
CONSTANTS = {
    "scale_error_ppm": PPM,
    "asymmetric_scale_error_ppm": PPM,
    "installation_u_arcsec": ARCSEC,
    "installation_v_arcsec": ARCSEC,
}
"""What may be estimated of a sensor besides its bias, by a scenario's keys, in the order of
`rrins.firmware_py.core.records.estimator_records.SCALE_FACTOR` and those after it."""


def _numbers(values: NDArray[np.float64]) -> list[float]:
    return [float(f"{value:.7g}") for value in np.asarray(values).tolist()]


def _number(value: float) -> float:
    return float(f"{float(value):.7g}")


def _sensors(state: Ram, second: EstimatorSecond, kind: int, fusion: Fusion) -> JsonObject:
    """Return the biases of a kind; the fused ones are those of the vector that is navigated."""
    suffix, unit = tuple(_UNITS.values())[kind]
    count, dt = int(fusion.count), int(state.parameters.period_ns) * 1e-9
    bias = second["bias"][kind, :count] / unit
    gain = fusion["gain"][:, :count]
    return {
        f"bias_{suffix}": _numbers(bias),
        f"sigma_{suffix}": _numbers(second["bias_sigma"][kind, :count] / unit),
        f"fused_bias_{suffix}": _numbers(gain @ bias),
        f"calibrated_{suffix}": _numbers(fusion["bias_increment"][:count] / dt / unit),
        "gain": gain.tolist(),
        "constants": _constants(state, second, kind, count),
        "calibrated": {
            "scale_error_ppm": _numbers(fusion["scale_error"][:count] / PPM),
            "asymmetric_scale_error_ppm": _numbers(fusion["asymmetric_scale_error"][:count] / PPM),
            "installation_u_arcsec": _numbers(_installed(state, fusion, kind, 1)),
            "installation_v_arcsec": _numbers(_installed(state, fusion, kind, 0)),
        },
    }


def _installed(state: Ram, fusion: Fusion, kind: int, across: int) -> NDArray[np.float64]:
    """Return the calibrated installation angles: the axes are h - δu v - δv u. Paper, (13)."""
    axes = state.estimator["transverse"][kind, : int(fusion.count), across]
    return -np.einsum("ki,ki->k", fusion["H"][: int(fusion.count)], axes) / ARCSEC


def _constants(
    state: Ram, second: EstimatorSecond, kind: int, count: int
) -> dict[str, JsonObject] | None:
    """Return scale factors and installation errors of a kind; None where they are no states."""
    if not state.estimator.constants:
        return None
    found = {}
    for error, (name, unit) in enumerate(CONSTANTS.items()):
        row = SENSOR_CONSTANTS * kind + error
        found[name] = {
            "estimated": _numbers(second["constant"][row, :count] / unit),
            "sigma": _numbers(second["constant_sigma"][row, :count] / unit),
        }
    return found


def _odometer(state: Ram, second: EstimatorSecond) -> JsonObject | None:
    """Return scale and mounting of the odometer; None without one."""
    if not state.odometer.interval_epochs:
        return None
    units = np.array([PPM, math.radians(1), math.radians(1)])
    found, sigma = second["odometer"] / units, second["odometer_sigma"] / units
    names = {"scale_ppm": SCALE, "yaw_deg": YAW, "pitch_deg": PITCH}
    return {
        name: {"estimated": _number(found[at]), "sigma": _number(sigma[at])}
        for name, at in names.items()
    } | {"metres_per_pulse": float(state.odometer["metres_per_pulse"])}


def _altimeter(state: Ram, second: EstimatorSecond) -> JsonObject | None:
    """Return the altimeter's bias; None where it is no measurement."""
    if not state.estimator.altimeter:
        return None
    bias, sigma = second["altimeter_bias"], second["altimeter_bias_sigma"]
    return {"bias_m": {"estimated": _number(bias), "sigma": _number(sigma)}}


def estimator_summary(state: Ram) -> JsonObject | None:
    """Return what the estimator knows at the end of its last second; None without one.

    Without a second that it ended, sigma and sensors are null.
    """
    estimator = state.estimator
    if not estimator.enabled:
        return None
    sources: JsonObject = {}
    for aid in Aid:
        source = estimator.sources[aid]
        used, rejected = int(source.used), int(source.rejected)
        if used or rejected:
            nis = round(float(source.squares) / used, 4) if used else None
            sources[aid.name.lower()] = {"used": used, "rejected": rejected, "nis": nis}
    seconds = int(state.parameters.period_ns) * 1e-9
    found: JsonObject = {
        "aided_by": [name for name, source in sources.items() if source["used"]],
        "fine_alignment_s": round(int(estimator.aligned_epochs) * seconds, 3),
        "gate_openings": int(estimator.reopenings),
        "sigma": None,
        "sensors": None,
        "odometer": None,
        "altimeter": None,
        "sources": sources,
    }
    if not estimator.history_count:
        return found
    second = estimator.history[(int(estimator.history_count) - 1) % ESTIMATOR_HISTORY_S]
    found["sigma"] = {
        "attitude_arcsec": _numbers(second["attitude_sigma"] / ARCSEC),
        "velocity_mps": _numbers(second["velocity_sigma"]),
        "position_m": _numbers(second["position_sigma"]),
    }
    found["odometer"] = _odometer(state, second)
    found["altimeter"] = _altimeter(state, second)
    fusions = (state.gyros, state.accelerometers)
    found["sensors"] = {
        name: _sensors(state, second, kind, fusions[kind]) for kind, name in enumerate(_UNITS)
    }
    return found


def beside_truth(estimator: JsonObject | None, biases: JsonObject | None) -> JsonObject | None:
    """Return the estimator's summary with the true biases at the end of the run.

    Parameters
    ----------
    estimator : dict or None
        `estimator_summary`.
    biases : dict or None
        True biases of each kind, as `rrins.host_tools.runs.sides.hardware_job.hardware_summary` has
        them; None where nobody knows them: the truth is null then.
    """
    if estimator is None or estimator["sensors"] is None:
        return estimator
    sensors: JsonObject = {}
    for name, (suffix, _) in _UNITS.items():
        kind = dict(estimator["sensors"][name])
        gain = np.array(kind.pop("gain"))
        calibrated = np.array(kind.pop(f"calibrated_{suffix}"))
        kind[f"true_bias_{suffix}"] = kind[f"true_fused_bias_{suffix}"] = None
        if biases:
            true = np.array(biases[f"{name}_{suffix}"]) - calibrated
            kind[f"true_bias_{suffix}"] = _numbers(true)
            kind[f"true_fused_bias_{suffix}"] = _numbers(gain @ true)
        if kind["constants"] is not None:
            kind["constants"] = {
                key: found | {"true": _less(biases, name, key, kind["calibrated"][key])}
                for key, found in kind["constants"].items()
            }
        kind.pop("calibrated")
        sensors[name] = kind
    odometer, altimeter = _aids_beside_truth(estimator, biases)
    return estimator | {"sensors": sensors, "odometer": odometer, "altimeter": altimeter}


def _less(
    biases: JsonObject | None, name: str, key: str, calibrated: list[float]
) -> list[float] | None:
    """Return the true errors of a kind beyond what calibration removes."""
    known = (biases or {}).get(name)
    return None if known is None else _numbers(np.array(known[key]) - calibrated)


def _aids_beside_truth(
    estimator: JsonObject, biases: JsonObject | None
) -> tuple[JsonObject | None, JsonObject | None]:
    """Return what was estimated of odometer and altimeter, with the truth."""
    odometer, altimeter = estimator["odometer"], estimator["altimeter"]
    if odometer is not None:
        nominal, true = odometer["metres_per_pulse"], {}
        if biases and "odometer" in biases:
            x, y, z = biases["odometer"]["forward_b"]
            scale = biases["odometer"]["metres_per_pulse"] / nominal - 1
            yaw, pitch = math.degrees(x / y), math.degrees(z / y)
            true = {"scale_ppm": scale / PPM, "yaw_deg": yaw, "pitch_deg": pitch}
        odometer = {
            key: found | {"true": _number(true[key]) if true else None}
            for key, found in odometer.items()
            if key != "metres_per_pulse"
        }
    if altimeter is not None:
        known = (biases or {}).get("altimeter_m")
        altimeter = {"bias_m": altimeter["bias_m"] | {"true": known}}
    return odometer, altimeter


def estimator_lines(estimator: JsonObject | None) -> list[str]:
    """Return the lines of the summary for a person; none without an estimator."""
    if estimator is None:
        return []
    counts = "; ".join(
        f"{name.replace('_', ' ').replace('gnss', 'GNSS')}: {source['used']} used, "
        f"{source['rejected']} rejected"
        for name, source in estimator["sources"].items()
    )
    lines = [f"aided by {counts}" if counts else "estimator: nothing aided the navigation"]
    if estimator["gate_openings"]:
        lines.append(
            f"estimator: rejected all fixes for 120 s, then took them again, "
            f"{estimator['gate_openings']} times"
        )
    sigma = estimator["sigma"]
    if sigma is not None:
        level = math.hypot(*sigma["attitude_arcsec"][:2])
        position = math.hypot(*sigma["position_m"][:2])
        lines.append(
            f"estimator: fine alignment {estimator['fine_alignment_s']:g} s; at the end σ of level "
            f"{level:.3g}″, heading {sigma['attitude_arcsec'][2]:.3g}″, position {position:.3g} m"
        )
    return lines


def sensor_rows(estimator: JsonObject | None) -> list[list[str]]:
    """Return what was estimated of each sensor beside the truth: a head, then rows.

    Navigation sees the fused vector alone. Of more than three sensors, a part of their biases
    cancels in it and stays unknown: the last three rows of a kind are the part that is seen.
    """
    if estimator is None or estimator["sensors"] is None:
        return []
    rows = [["sensor", "unit", "estimated", "sigma", "true", "estimated_less_true"]]
    for name, (suffix, _) in _UNITS.items():
        kind, one = estimator["sensors"][name], name.removesuffix("s")
        true, sigma = kind[f"true_bias_{suffix}"], kind[f"sigma_{suffix}"]
        for k, bias in enumerate(kind[f"bias_{suffix}"]):
            known = None if true is None else true[k]
            rows.append([f"{one} {k + 1}", suffix, *_cells(bias, sigma[k], known)])
        fused = kind[f"true_fused_bias_{suffix}"]
        for k, bias in enumerate(kind[f"fused_bias_{suffix}"]):
            known = None if fused is None else fused[k]
            rows.append([f"fused {name} {_AXES[k]}", suffix, *_cells(bias, None, known)])
        for key, found in (kind["constants"] or {}).items():
            what, _, unit = key.rpartition("_")
            for k, value in enumerate(found["estimated"]):
                known = None if found["true"] is None else found["true"][k]
                cells = _cells(value, found["sigma"][k], known)
                rows.append([f"{one} {k + 1} {what.replace('_', ' ')}", unit, *cells])
    for name in ("odometer", "altimeter"):
        for key, found in (estimator[name] or {}).items():
            what, _, unit = key.rpartition("_")
            cells = _cells(found["estimated"], found["sigma"], found["true"])
            rows.append([f"{name} {what}", unit, *cells])
    return rows


def _cells(bias: float, sigma: float | None, true: float | None) -> list[str]:
    less = None if true is None else bias - true
    return ["" if value is None else f"{value:.6g}" for value in (bias, sigma, true, less)]


def write_sensors(path: Path, rows: list[list[str]]) -> None:
    """Write the rows of `sensor_rows` as a CSV file."""

    def write(file: IO[str]) -> None:
        csv.writer(file).writerows(rows)

    write_whole(path, write)
