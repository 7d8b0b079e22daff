"""The report of a calibration: one self-contained HTML page, its picture, and the file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rrins.compiled.record import Floats
from rrins.firmware_py.core.sensors.calibration import ARCSEC, Origin
from rrins.host_tools.calibration.estimation import Estimate, SensorsEstimate, Unit
from rrins.host_tools.calibration.file import KEYS, UNKNOWN, both, to_toml
from rrins.host_tools.calibration.observability import LIMITS, MARK
from rrins.host_tools.calibration.pictures import residuals_figure
from rrins.host_tools.drawing.page import REPORT, write_report
from rrins.host_tools.drawing.saving import names_of
from rrins.host_tools.files import JsonObject, write_text
from rrins.host_tools.rounding import alike, plus_minus, rounded, with_sigma
from rrins.host_tools.runs.results.sensor_errors import CONSTANTS, KINDS
from rrins.host_tools.runs.set_up.typed_numbers import typed_number, typed_numbers

FILE = "calibration.toml"

SYMBOLS = (
    ("λ", "scale factor error"),
    ("μ", "its asymmetry: added to λ for positive input, subtracted for negative"),
    ("δu, δv", "installation error: the input axis turned by δu about u and by -δv about v"),
    ("σ", "standard deviation of the estimate"),
    (
        "wanted",
        "σ, rms over the sensors, that half an hour with the prototype's noise is to reach",
    ),
    (MARK.strip(), "σ beyond what is wanted"),
)
"""Symbols of the tables and their meaning."""


def kinds_of(found: Estimate) -> list[JsonObject]:
    """Return what the tables show of gyros and of accelerometers."""
    kinds = []
    for limits, (name, one, units) in zip(LIMITS, both(found), strict=True):
        values, sigma, rms = one.constants / units, one.sigma / units, _sigma_rms(one, units)
        rows = [
            {
                "name": error.label,
                "unit": error.unit,
                "cells": [
                    with_sigma(*cell) for cell in zip(values[:, k], sigma[:, k], strict=True)
                ],
                "sigma": rounded(rms[k], 2),
                "wanted": rounded(limits[k], 2),
                "is_beyond": bool(rms[k] > limits[k]),
            }
            for k, error in enumerate((KINDS[name], *CONSTANTS))
        ]
        before, after = (alike(_rms(one) / units[0]) for one in (one.before, one.after))
        kinds.append(
            {
                "name": name,
                "count": len(values),
                "unit": KINDS[name].unit,
                "rows": rows,
                "residuals": {"before": before, "after": after},
            }
        )
    return kinds


def verdict_of(found: Estimate) -> str:
    """Return whether the constants are known as well as is wanted, and which are not."""
    beyond = [
        f"{kind['name'].removesuffix('s')} {row['name']} (σ {row['sigma']} {row['unit']}, "
        f"wanted {row['wanted']})"
        for kind in kinds_of(found)
        for row in kind["rows"]
        if row["is_beyond"]
    ]
    if not beyond:
        return "All constants are known as well as is wanted."
    return (
        f"Less well known than is wanted: {', '.join(beyond)}. More time on the table helps: "
        "--stand, or a longer --scheme."
    )


def _sigma_rms(one: SensorsEstimate, units: Floats) -> Floats:
    """Return σ of each constant, rms over the sensors."""
    return np.asarray(np.sqrt(np.mean((one.sigma / units) ** 2, axis=0)))


def _rms(values: Floats) -> Floats:
    return np.asarray(np.sqrt(np.nanmean(values**2, axis=0)))


def result_of(found: Estimate) -> JsonObject:
    """Return a calibration as one JSON object: values and σ by the keys of the file."""
    result: JsonObject = {
        "seconds": len(found.seconds),
        "duration_s": typed_number(found.seconds.total_s),
        "base_sigma_arcsec": typed_numbers(found.base_sigma / ARCSEC),
        "squareness_arcsec": typed_number(found.epsilon / ARCSEC),
        "squareness_sigma_arcsec": typed_number(found.epsilon_sigma / ARCSEC),
    }
    beyond = []
    for limits, (name, one, units) in zip(LIMITS, both(found), strict=True):
        rms = _sigma_rms(one, units)
        beyond += [f"{name}.{key}" for key in np.array(KEYS[name])[rms > limits].tolist()]
        result[name] = {
            key: {
                "value": typed_numbers(one.constants[:, k] / units[k]),
                "sigma": typed_numbers(one.sigma[:, k] / units[k]),
                "sigma_rms": typed_number(rms[k]),
                "wanted": float(limits[k]),
            }
            for k, key in enumerate(KEYS[name])
        } | {
            "residual_before_rms": _rms(one.before / units[0]).tolist(),
            "residual_after_rms": _rms(one.after / units[0]).tolist(),
        }
    result |= {"as_wanted": not beyond, "beyond_wanted": beyond}
    return result


def write(
    folder: Path,
    unit: Unit,
    found: Estimate,
    title: str,
    how: Sequence[str],
    verified: str = "",
    origin: Origin = UNKNOWN,
) -> list[Path]:
    """Write report, picture and calibration file to a folder; return their paths in this order.

    Former ones of other content are moved into the folder `previous`.

    Raises
    ------
    RehearsalError
        When they cannot be written.
    """
    base = alike(found.base_sigma[:2] / ARCSEC, 2)
    paths = write_report(
        folder,
        "rrins.host_tools.calibration",
        {"residuals": residuals_figure(found)},
        keeps=(REPORT, *names_of("residuals"), FILE),
        title=title,
        origin=how,
        kinds=kinds_of(found),
        symbols=SYMBOLS,
        mark=MARK,
        verdict=verdict_of(found),
        base=[*base, rounded(found.base_sigma[2] / ARCSEC, 2)],
        squareness=plus_minus(found.epsilon / ARCSEC, found.epsilon_sigma / ARCSEC),
        gravity=f"{unit.site.force_n[2]:.6f}",
        verified=verified,
    )
    write_text(folder / FILE, to_toml(found, how, origin))
    return [*paths, folder / FILE]
