"""The report of a calibration: one self-contained HTML page, its picture, and the file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rrins.compiled.record import Floats
from rrins.firmware_py.core.sensors.calibration import ARCSEC, Origin
from rrins.host_tools.calibration.estimation import Estimate, Unit
from rrins.host_tools.calibration.file import KEYS, UNKNOWN, both, to_toml
from rrins.host_tools.calibration.observability import LIMITS
from rrins.host_tools.calibration.pictures import residuals_figure
from rrins.host_tools.drawing.page import REPORT, write_report
from rrins.host_tools.files import JsonObject, write_text
from rrins.host_tools.runs.results.sensor_errors import CONSTANTS, KINDS
from rrins.host_tools.runs.set_up.typed_numbers import typed_number, typed_numbers
from rrins.host_tools.terminal import figure, rounded_by

PICTURE, FILE = "residuals.png", "calibration.toml"

_ROWS = (("bias", 0), ("λ", 1), ("μ", 2), ("δu", 3), ("δv", 4))
_UNITS = {name: (bias.unit, *(one.unit for one in CONSTANTS)) for name, bias in KINDS.items()}


def kinds_of(found: Estimate) -> list[JsonObject]:
    """Return what the tables show of gyros and of accelerometers."""
    kinds = []
    for limits, (name, one, units) in zip(LIMITS, both(found), strict=True):
        values, sigma = one.constants / units, one.sigma / units
        rows = [
            {
                "name": word,
                "unit": _UNITS[name][k],
                "cells": [
                    tuple(rounded_by(s, v, s))
                    for v, s in zip(values[:, k], sigma[:, k], strict=True)
                ],
                "sigma": figure(float(np.sqrt((sigma[:, k] ** 2).mean())), 2),
                "wanted": f"{limits[k]:g}",
            }
            for word, k in _ROWS
        ]
        kinds.append(
            {
                "name": name,
                "count": len(values),
                "unit": _UNITS[name][0],
                "rows": rows,
                "before": _rms(one.before / units[0]),
                "after": _rms(one.after / units[0]),
            }
        )
    return kinds


def _rms(values: Floats) -> list[str]:
    return [figure(float(value)) for value in np.sqrt(np.nanmean(values**2, axis=0))]


def result_of(found: Estimate) -> JsonObject:
    """Return a calibration as one JSON object: values and σ by the keys of the file."""
    result: JsonObject = {
        "seconds": len(found.seconds),
        "duration_s": typed_number(found.seconds.total_s),
        "base_sigma_arcsec": typed_numbers(found.base_sigma / ARCSEC),
        "squareness_arcsec": typed_number(found.epsilon / ARCSEC),
        "squareness_sigma_arcsec": typed_number(found.epsilon_sigma / ARCSEC),
    }
    for name, one, units in both(found):
        result[name] = {
            key: {
                "value": typed_numbers(one.constants[:, k] / units[k]),
                "sigma": typed_numbers(one.sigma[:, k] / units[k]),
            }
            for k, key in enumerate(KEYS[name])
        } | {
            "residual_before_rms": np.sqrt(np.nanmean((one.before / units[0]) ** 2, 0)).tolist(),
            "residual_after_rms": np.sqrt(np.nanmean((one.after / units[0]) ** 2, 0)).tolist(),
        }
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
    base = [f"{value / ARCSEC:.2g}" for value in found.base_sigma[:2]]
    paths = write_report(
        folder,
        "rrins.host_tools.calibration",
        {"residuals": residuals_figure(found)},
        keeps=(REPORT, PICTURE, FILE),
        title=title,
        origin=how,
        kinds=kinds_of(found),
        base=[*base, f"{found.base_sigma[2] / ARCSEC:.0f}"],
        squareness=f"{found.epsilon / ARCSEC:.2f}",
        squareness_sigma=f"{found.epsilon_sigma / ARCSEC:.2f}",
        gravity=f"{unit.site.force_n[2]:.6f}",
        verified=verified,
    )
    write_text(folder / FILE, to_toml(found, how, origin))
    return [*paths, folder / FILE]
