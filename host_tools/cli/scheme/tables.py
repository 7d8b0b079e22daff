"""Results of `rrins scheme`: tables for people, plain objects for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np
from rich.table import Table

from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.files import JsonObject
from rrins.host_tools.rotation.analysis import Integrals, Variation
from rrins.host_tools.rotation.closed_form import EQUATIONS
from rrins.host_tools.rotation.comparison import magnitudes_left, scheme_object, travel_object
from rrins.host_tools.rotation.errors import ERRORS
from rrins.host_tools.rotation.inputs import NamedRimu, NamedScheme
from rrins.host_tools.rotation.search import Candidate, SearchResult
from rrins.host_tools.rotation.travel import AxisTravel, travel_of
from rrins.host_tools.rounding import coarse, rounded
from rrins.host_tools.terminal import new_table

_PREFIXES = ((1.0, 1.0, ""), (1e-3, 1e3, "m"), (1e-6, 1e6, "µ"), (0.0, 1e9, "n"))
_COLUMNS_PER_TABLE = 4
_DRIVE_COLUMNS = {
    "constants_m": "constants",
    "calibrated_m": "calibrated",
    "noise_m": "white noise",
    "calibrated_with_noise_m": "calibrated, noise",
}


def value_text(value: float, unit: str) -> str:
    """Return a value with three digits and a prefix to its unit."""
    if value == 0:
        return "0"
    factor, prefix = next((f, p) for above, f, p in _PREFIXES if abs(value) >= above)
    return f"{rounded(value * factor)} {prefix}{unit}"


def analysis_object(named: NamedScheme, rimu: NamedRimu, variation: Variation) -> JsonObject:
    """Return an analysis for JSON: settings, and one row per sensor, error and axis."""
    rows = []
    for integrals in (variation.gyros, variation.accelerometers):
        largest = integrals.excursion.max(axis=-1)
        for row in integrals.residual_rows():
            whole = float(largest[row.sensor - 1, ERRORS.index(row.error)])
            ratio = abs(row.residual) / whole if whole else 0.0
            equations = EQUATIONS[row.sensor_kind, row.error]
            rows.append(asdict(row) | {"residual_ratio": ratio, "equations": equations})
    return {
        "scheme": scheme_object(named),
        "geometry": rimu.geometry,
        "errors": rimu.errors,
        "earth_latitude_deg": rimu.rimu.earth_latitude_deg,
        "travel": travel_object(travel_of(named.scheme)),
        "rows": rows,
    }


def sensor_table(integrals: Integrals, sensor: int) -> Table:
    """Return the residual and the peak of each error of one sensor."""
    kind, unit = integrals.sensors.kind, integrals.sensors.unit
    heads = (f"{what} {axis}" for what in ("left", "largest") for axis in "xyz")
    table = new_table(f"{kind} {sensor}, in the body frame", "error", *heads)
    vanishes = integrals.vanishes
    for k, error in enumerate(ERRORS):
        left = np.where(vanishes, 0.0, integrals.residual)[sensor - 1, k]
        largest = integrals.excursion[sensor - 1, k]
        table.add_row(error, *(value_text(float(value), unit) for value in (*left, *largest)))
    return table


def all_sensors_table(variation: Variation) -> Table:
    """Return the largest residual of any sensor, per error and axis."""
    heads = (f"{kind} {axis}" for kind in ("gyro", "accel.") for axis in "xyz")
    table = new_table("largest left by any sensor", "error", *heads)
    for k, error in enumerate(ERRORS):
        cells = [
            value_text(float(value), integrals.sensors.unit)
            for integrals in (variation.gyros, variation.accelerometers)
            for value in magnitudes_left(integrals)[:, k].max(axis=0)
        ]
        table.add_row(error, *cells)
    return table


def cycle_line(scheme: Scheme) -> str:
    """Return one line on the duration and travel of a cycle."""
    travel = travel_of(scheme)
    return (
        f"cycle {scheme.cycle_s:g} s, {len(scheme.turns)} positions, {scheme.turn_rate_dps:g} °/s, "
        f"{scheme.stand_s:g} s standing; inner {_range(travel.inner)}, outer {_range(travel.outer)}"
    )


def _range(axis: AxisTravel) -> str:
    if axis.net_deg:
        return f"ring, {axis.net_deg:+g}°"
    if axis.range_deg == 0:
        return "no turn"
    return f"{axis.lowest_deg:g} to {axis.highest_deg:g}°"


def comparison_tables(compared: list[JsonObject]) -> list[Table]:
    """Return the comparisons side by side, a few schemes per table."""
    return [
        _comparison_table(compared[start : start + _COLUMNS_PER_TABLE])
        for start in range(0, len(compared), _COLUMNS_PER_TABLE)
    ]


def _comparison_table(compared: list[JsonObject]) -> Table:
    table = new_table(None, "", *(one["scheme"]["name"] for one in compared))
    for what, key in (("left", "residual"), ("largest", "excursion")):
        for kind, label in (("gyro", "gyro"), ("accelerometer", "accel.")):
            for error in ERRORS:
                cells = [_error_cell(one["errors"][kind][error], key) for one in compared]
                table.add_row(f"{what}, {label} {error}", *cells)
        table.add_section()
    for label, key, unit in (
        ("velocity error, rms", "velocity_error_rms_mps", "m/s"),
        ("velocity error, per hour", "velocity_error_growth_mps_per_h", "m/s"),
    ):
        table.add_row(label, *(value_text(_clean(one[key]), unit) for one in compared))
    table.add_row("cycle", *(f"{one['scheme']['cycle_s']:g} s" for one in compared))
    for axis in ("inner", "outer"):
        travels = [one["travel"][axis] for one in compared]
        table.add_row(
            f"{axis} travel +, -",
            *(f"{t['forward_deg']:g}°, {t['backward_deg']:g}°" for t in travels),
        )
        table.add_row(f"{axis} needs", *(_range(AxisTravel(**travel)) for travel in travels))
        table.add_row(f"{axis} reversals", *(f"{t['reversals']}" for t in travels))
    return table


def _clean(value: float) -> float:
    """Return a velocity in m/s, rounding errors replaced by 0."""
    return 0.0 if abs(value) < 1e-12 else value


def _error_cell(error: JsonObject, key: str) -> str:
    text = value_text(error[key], error["unit"])
    return f"{text} ({''.join(error['axes_left'])})" if key == "residual" and error[key] else text


def drive_table(found: Sequence[JsonObject], routes: int) -> Table:
    """Return σ of the position at the end of the drive, a row for each scheme."""
    title = f"σ of the position at the end of the drive, rms of {routes} routes / m"
    table = new_table(title, "", *_DRIVE_COLUMNS.values())
    for one in found:
        table.add_row(one["scheme"], *(coarse(one[key]) for key in _DRIVE_COLUMNS))
    return table


def candidate_object(candidate: Candidate) -> JsonObject:
    """Return a scheme found by a search, for JSON."""
    return {
        "turns": [turn.model_dump() for turn in candidate.scheme.turns],
        "turn_rate_dps": candidate.scheme.turn_rate_dps,
        "stand_s": candidate.scheme.stand_s,
        "cycle_s": candidate.scheme.cycle_s,
        "mirror": candidate.mirror,
        "remaining": candidate.remaining,
        "velocity_error_rms_mps": candidate.velocity_rms_mps,
        "travel": travel_object(candidate.travel),
    }


def search_table(found: SearchResult, reference: str) -> Table:
    """Return the best schemes and the reference."""
    heads = ("turns, I inner, O outer", "left", "velocity rms", "inner", "outer", "rev.")
    table = new_table(f"best of {found.count} schemes", "", *heads)
    turns = table.columns[1]
    turns.justify, turns.no_wrap, turns.overflow = "left", False, "fold"
    rows = [(str(k), one) for k, one in enumerate(found.best, start=1)]
    for k, (label, one) in enumerate([*rows, (reference, found.reference)]):
        if k == len(rows):
            table.add_section()
        inner, outer = one.travel.inner, one.travel.outer
        table.add_row(
            label,
            turns_text(one.scheme),
            str(one.remaining),
            value_text(one.velocity_rms_mps, "m/s"),
            "ring" if inner.net_deg else f"{inner.range_deg:g}°",
            f"{outer.range_deg:g}°",
            str(inner.reversals + outer.reversals),
        )
    return table


def turns_text(scheme: Scheme) -> str:
    """Return half turns in short: ``I+O-``, four to a group; other angles in degrees."""
    words = []
    for turn in scheme.turns:
        angle = turn.angle_deg
        amount = ("+" if angle > 0 else "-") if abs(angle) == 180 else f"{angle:+g}°"
        words.append(turn.axis[0].upper() + amount)
    return " ".join("".join(words[start : start + 4]) for start in range(0, len(words), 4))


def verdict(found: SearchResult, reference: str) -> str:
    """Return one line on how the best compares with the reference."""
    best, beside = found.best[0], found.reference
    if found.better is None:
        return (
            f"a cycle of {reference} takes {beside.scheme.cycle_s:g} s, one of these "
            f"{best.scheme.cycle_s:g} s: their rms values are not comparable"
        )
    if best.order[:2] >= beside.order[:2]:
        return f"none is better than {reference}; {found.equal} are as good"
    share = 1 - best.velocity_rms_mps / beside.velocity_rms_mps
    saved = f"{abs(share):.1%} {'less' if share > 0 else 'more'} velocity error"
    left = f"{best.remaining} instead of {beside.remaining} residuals left, "
    return (
        f"the best: {left if best.remaining != beside.remaining else ''}{saved} than {reference}, "
        f"which {found.better} of the {found.count} surpass"
    )


def toml_of(scheme: Scheme) -> str:
    """Return a scheme as TOML, for a scenario or for `rrins scheme analyse`."""
    turns = "".join(
        f'    {{ axis = "{turn.axis}", angle_deg = {turn.angle_deg:g} }},\n'
        for turn in scheme.turns
    )
    return (
        f"[firmware]\nturn_rate_dps = {scheme.turn_rate_dps:g}\nstand_s = {scheme.stand_s:g}\n"
        f"scheme = [\n{turns}]\n"
    )
