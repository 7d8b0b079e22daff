"""The estimator in a run's summary: sigmas, biases compared with the truth, what aided it."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Records
from rrins.firmware_py.core.records.estimator_records import (
    ESTIMATOR_HISTORY_S,
    PITCH,
    PIVOT,
    SCALE,
    SENSOR_CONSTANTS,
    YAW,
    Aid,
    EstimatorSecond,
)
from rrins.firmware_py.core.records.memory import Fusion, Ram
from rrins.firmware_py.core.sensors.calibration import ARCSEC, PPM
from rrins.host_tools.files import JsonObject, write_whole
from rrins.host_tools.rounding import rounded
from rrins.host_tools.runs.results.sensor_errors import CONSTANTS, KINDS, estimated

_AXES = ("x", "y", "z")


class Band(NamedTuple):
    """A part of the navigation of which the estimator knows the standard deviation."""

    key: str  #: in the summary
    sigma: str  #: field of `EstimatorSecond`, along east, north and up
    size: float  #: of the key's unit, SI
    label: str  #: of its panels
    unit: str  #: of its panels
    factor: float  #: from the unit of its errors to that of the panels
    errors: tuple[str, ...]  #: of `Errors`, along east, north and up


BANDS = (
    Band("attitude_arcsec", "attitude_sigma", ARCSEC, "attitude error\nabout {}", "″", 1.0,
        ("turn_east_arcsec", "turn_north_arcsec", "turn_up_arcsec")),
    Band("velocity_mps", "velocity_sigma", 1.0, "velocity error\n{}", "mm/s", 1e3,
        ("velocity_east_mps", "velocity_north_mps")),
    Band("position_m", "position_sigma", 1.0, "position error\n{}", "m", 1.0,
        ("position_east_m", "position_north_m", "height_m")),
)  # fmt: skip


def _numbers(values: NDArray[np.float64]) -> list[float]:
    return [float(f"{value:.7g}") for value in np.asarray(values).tolist()]


def _number(value: float) -> float:
    return float(f"{float(value):.7g}")


def _sensors(state: Ram, second: EstimatorSecond, kind: int, fusion: Fusion) -> JsonObject:
    """Return the biases of a kind; the fused ones are those of the vector that is navigated."""
    bias_of = tuple(KINDS.values())[kind]
    count, dt = int(fusion.count), int(state.parameters.period_ns) * 1e-9
    bias, unit = second["bias"][kind, :count] / bias_of.size, bias_of.key.removeprefix("bias_")
    gain = fusion["gain"][:, :count]
    calibrated = (
        fusion["scale_error"][:count] / PPM,
        fusion["asymmetric_scale_error"][:count] / PPM,
        _installed(state, fusion, kind, 1),
        _installed(state, fusion, kind, 0),
    )
    keys = [constant.key for constant in CONSTANTS]
    return {
        f"bias_{unit}": _numbers(bias),
        f"sigma_{unit}": _numbers(second["bias_sigma"][kind, :count] / bias_of.size),
        f"fused_bias_{unit}": _numbers(gain @ bias),
        f"calibrated_{unit}": _numbers(fusion["bias_increment"][:count] / dt / bias_of.size),
        "gain": gain.tolist(),
        "constants": _constants(second, kind, count) if state.estimator.constants else None,
        "calibrated": dict(zip(keys, map(_numbers, calibrated), strict=True)),
    }


def _installed(state: Ram, fusion: Fusion, kind: int, across: int) -> NDArray[np.float64]:
    """Return the calibrated installation angles: the axes are h - δu v - δv u. Paper, (13)."""
    axes = state.estimator["transverse"][kind, : int(fusion.count), across]
    return -np.einsum("ki,ki->k", fusion["H"][: int(fusion.count)], axes) / ARCSEC


def _constants(second: EstimatorSecond, kind: int, count: int) -> JsonObject:
    """Return scale factors and installation errors of a kind."""
    rows = enumerate(CONSTANTS, SENSOR_CONSTANTS * kind)
    return {
        constant.key: {
            "estimated": _numbers(second["constant"][row, :count] / constant.size),
            "sigma": _numbers(second["constant_sigma"][row, :count] / constant.size),
        }
        for row, constant in rows
    }


def _odometer(state: Ram, second: EstimatorSecond) -> JsonObject | None:
    """Return scale, mounting and pivot of the odometer; None without one."""
    if not state.odometer.interval_epochs:
        return None
    units = np.array([PPM, math.radians(1), math.radians(1), 1.0])
    found, sigma = second["odometer"] / units, second["odometer_sigma"] / units
    names = {"scale_ppm": SCALE, "yaw_deg": YAW, "pitch_deg": PITCH, "pivot_m": PIVOT}
    return {
        name: {"estimated": _number(found[at]), "sigma": _number(sigma[at])}
        for name, at in names.items()
    } | {"metres_per_pulse": float(state.odometer["metres_per_pulse"])}


def _altimeter(state: Ram, second: EstimatorSecond) -> JsonObject | None:
    """Return the altimeter's bias; None where it is not a measurement."""
    if not state.estimator.altimeter:
        return None
    bias, sigma = second["altimeter_bias"], second["altimeter_bias_sigma"]
    return {"bias_m": {"estimated": _number(bias), "sigma": _number(sigma)}}


def estimator_summary(ram: Records[Ram]) -> JsonObject | None:
    """Return what the estimator knows at the end of its last second; None without one.

    Without a second that it ended, sigma and sensors are null.
    """
    state = ram[0]
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
    found["sigma"] = {band.key: _numbers(second[band.sigma] / band.size) for band in BANDS}
    found["odometer"] = _odometer(state, second)
    found["altimeter"] = _altimeter(state, second)
    found["sensors"] = {
        name: _sensors(state, second, kind, state[name]) for kind, name in enumerate(KINDS)
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
        them; None where they are unknown: the truth is null then.
    """
    if estimator is None or estimator["sensors"] is None:
        return estimator
    sensors: JsonObject = {}
    for name, (key, *_) in KINDS.items():
        kind, unit = dict(estimator["sensors"][name]), key.removeprefix("bias_")
        gain = np.array(kind.pop("gain"))
        calibrated = kind.pop("calibrated")
        calibrated_bias = kind.pop(f"calibrated_{unit}")
        true = None
        if biases:
            true = np.array(biases[f"{name}_{unit}"]) - calibrated_bias
        kind[f"true_{key}"] = None if true is None else _numbers(true)
        kind[f"true_fused_{key}"] = None if true is None else _numbers(gain @ true)
        if kind["constants"] is not None:
            kind["constants"] = {
                key: found | {"true": _less(biases, name, key, calibrated[key])}
                for key, found in kind["constants"].items()
            }
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
            x, y, z = forward_b = biases["odometer"]["forward_b"]
            scale = biases["odometer"]["metres_per_pulse"] / nominal - 1
            yaw, pitch = math.degrees(x / y), math.degrees(z / y)
            pivot = -float(np.dot(forward_b, biases["odometer"]["lever_arm_m"]))
            true = {
                "scale_ppm": scale / PPM,
                "yaw_deg": yaw,
                "pitch_deg": pitch,
                "pivot_m": pivot,  # the reference point does not move sideways
            }
        odometer = {
            key: found | {"true": _number(true[key]) if true else None}
            for key, found in odometer.items()
            if key != "metres_per_pulse"
        }
    if altimeter is not None:
        known = (biases or {}).get("altimeter_m")
        altimeter = {"bias_m": altimeter["bias_m"] | {"true": known}}
    return odometer, altimeter


def estimator_lines(firmware: JsonObject) -> Iterator[str]:
    """Yield the lines for a person, from the firmware's part of the summary."""
    estimator = firmware.get("estimator")
    if estimator is None:
        return
    counts = "; ".join(
        f"{name.replace('_', ' ').replace('gnss', 'GNSS')}: {source['used']} used, "
        f"{source['rejected']} rejected"
        for name, source in estimator["sources"].items()
    )
    yield f"aided by {counts}" if counts else "estimator: nothing aided the navigation"
    if estimator["gate_openings"]:
        yield (
            f"estimator: rejected all fixes for 120 s, then took them again, "
            f"{estimator['gate_openings']} times"
        )
    sigma = estimator["sigma"]
    if sigma is not None:
        level = math.hypot(*sigma["attitude_arcsec"][:2])
        position = math.hypot(*sigma["position_m"][:2])
        yield (
            f"estimator: fine alignment {estimator['fine_alignment_s']:g} s; at the end σ of level "
            f"{rounded(level)}″, heading {rounded(sigma['attitude_arcsec'][2])}″, "
            f"position {rounded(position)} m"
        )


def sensor_rows(estimator: JsonObject | None) -> list[list[str]]:
    """Return what was estimated of each sensor beside the truth: a head, then rows.

    Navigation sees the fused vector alone. Of more than three sensors, a part of their biases
    cancels in it and stays unknown: the last three rows of a kind are the part that is seen.
    """
    if estimator is None or estimator["sensors"] is None:
        return []
    rows = [["sensor", "unit", "estimated", "sigma", "true", "estimated_less_true"]]
    for name, (bias, *_) in KINDS.items():
        kind, one = estimator["sensors"][name], name.removesuffix("s")
        of_each = [
            row
            for error, values, sigma, true in estimated(name, kind)
            for row in _rows(f"{one} {{}}", error.key, values, sigma, true)
        ]
        count = len(kind[bias])
        fused, true = kind[f"fused_{bias}"], kind[f"true_fused_{bias}"]
        of_vector = _rows(f"fused {name} {{}}", bias, fused, None, true, _AXES)
        rows += [*of_each[:count], *of_vector, *of_each[count:]]
    for name in ("odometer", "altimeter"):
        for key, found in (estimator[name] or {}).items():
            what, _, unit = key.rpartition("_")
            cells = _cells(found["estimated"], found["sigma"], found["true"])
            rows.append([f"{name} {what}", unit, *cells])
    return rows


def _rows(
    what: str,
    key: str,
    values: list[float],
    sigma: list[float] | None,
    true: list[float] | None,
    axes: Sequence[str] = (),
) -> list[list[str]]:
    """Return the rows of an error, one for each sensor or axis."""
    error, _, unit = key.rpartition("_")
    words = "" if error == "bias" else f" {error.replace('_', ' ')}"
    rows = []
    for k, value in enumerate(values):
        cells = _cells(value, sigma[k] if sigma else None, true[k] if true else None)
        rows.append([what.format(axes[k] if axes else k + 1) + words, unit, *cells])
    return rows


def _cells(bias: float, sigma: float | None, true: float | None) -> list[str]:
    less = None if true is None else bias - true
    return ["" if value is None else f"{value:.6g}" for value in (bias, sigma, true, less)]


def write_sensors(path: Path, rows: list[list[str]]) -> None:
    """Write the rows of `sensor_rows` as a CSV file."""

    def write(file: IO[str]) -> None:
        csv.writer(file).writerows(rows)

    write_whole(path, write)
