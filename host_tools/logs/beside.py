"""The same recording navigated with other settings, beside each other: a table and a picture."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from rrins.compiled.record import Floats, Records
from rrins.firmware_py.core.records.memory import NavigationOutput
from rrins.host_tools.drawing.saving import write_pictures
from rrins.host_tools.drawing.style import (
    LINES,
    draw_line,
    finish,
    give_title,
    new_figure,
    quantity,
    time_axis,
)
from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.rounding import with_unit
from rrins.host_tools.runs.results.results import Errors, east_north_m
from rrins.host_tools.scenario.scenario import Scenario

_WIDE = 30.0
"""Largest over smallest line from which a scale is logarithmic."""

_LEAST = 1e-3


@dataclass(frozen=True)
class Navigated:
    """A recording navigated with some settings."""

    label: str
    summary: JsonObject  #: of the replay
    navigation: Records[NavigationOutput]
    errors: Errors  #: empty without a truth


def changes_of(settings: Iterable[str]) -> dict[str, Any]:
    """Return the changes that settings such as ``estimator.enabled=false`` make to a scenario.

    The key is that of the scenario's file, tables before it; the value is TOML, or a word.

    Raises
    ------
    ScenarioError
        If one is not KEY=VALUE.
    """
    changes: dict[str, Any] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        key = key.strip()
        if not equals or not all(part.isidentifier() for part in key.split(".")):
            raise ScenarioError(
                f"setting {setting!r}: not KEY=VALUE, such as estimator.enabled=false"
            )
        changes[key.replace(".", "__")] = _value(text.strip())
    return changes


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"it = {text}")["it"]
    except ValueError:  # a word without quotes
        return text


def varied(scenario: Scenario, settings: Sequence[str]) -> Scenario:
    """Return a scenario with settings changed.

    Raises
    ------
    ScenarioError
    """
    if not settings:
        return scenario
    changed = scenario.varied(**changes_of(settings))
    if changed.rate_hz != scenario.rate_hz:
        raise ScenarioError("setting rate_hz: a recording has its own rate")
    return changed


def table_of(navigated: Sequence[Navigated]) -> Table:
    """Return the table of the settings: errors, or how far they are from the first."""
    first = navigated[0]
    has_truth = bool(len(first.errors))
    what = "error" if has_truth else f"distance from {first.label}"
    table = Table(title=f"Level position: {what}", title_justify="left")
    table.add_column("settings", no_wrap=True)
    for name in ("rms", "largest", "at the end", "rms height", "navigation sha256"):
        table.add_column(name, justify="right", no_wrap=True)
    for one in navigated:
        _, level, height = _lines_of(one, first)
        cells = ["-"] * 4
        if len(level):
            figures = (_rms(level), float(np.max(level)), float(level[-1]), _rms(height))
            cells = [with_unit(figure, "m") for figure in figures]
        sha256 = one.summary["navigation_sha256"]
        table.add_row(one.label, *cells, "-" if sha256 is None else f"{sha256[:12]}…")
    return table


def summary_of(navigated: Sequence[Navigated]) -> list[JsonObject]:
    """Return the figures of the settings, for scripts."""
    found = []
    for one in navigated:
        _, level, height = _lines_of(one, navigated[0])
        has_any = bool(len(level))
        found.append(
            {
                "settings": one.label,
                "navigation_sha256": one.summary["navigation_sha256"],
                "is_error": bool(len(one.errors)),
                "rms_level_m": _rms(level) if has_any else None,
                "largest_level_m": float(np.max(level)) if has_any else None,
                "end_level_m": float(level[-1]) if has_any else None,
                "rms_height_m": _rms(height) if has_any else None,
                "estimator": one.summary["estimator"],
            }
        )
    return found


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _lines_of(one: Navigated, first: Navigated) -> tuple[Floats, Floats, Floats]:
    """Return time (s), level distance and height (m) from the truth, or from the first."""
    if len(one.errors):
        errors = one.errors
        level = np.hypot(errors.position_east_m, errors.position_north_m)
        return errors.time_s, level, errors.height_m
    _, ours, theirs = np.intersect1d(
        one.navigation["epoch"], first.navigation["epoch"], return_indices=True
    )
    nav, other = one.navigation[ours], first.navigation[theirs]
    if not len(nav):
        return np.zeros(0), np.zeros(0), np.zeros(0)
    east, north = east_north_m(
        nav["latitude"], nav["longitude"], other["latitude"], other["longitude"], other["height"]
    )
    rate_hz = int(one.summary["rate_hz"])
    time_s = (nav["epoch"] - nav["epoch"][0]) / rate_hz
    return time_s, np.hypot(east, north), nav["height"] - other["height"]


def draw(navigated: Sequence[Navigated], title: str) -> Figure:
    """Return level position, height and heading of each setting over time.

    With a truth they are errors; else differences from the first.
    """
    first = navigated[0]
    has_truth = bool(len(first.errors))
    figure = new_figure(9.0, 7.0)
    rows = figure.subplots(3, 1, sharex=True)
    what = "errors" if has_truth else f"differences from {first.label}"
    give_title(figure, f"{title}\n{what} with other settings")
    largest = []
    for k, one in enumerate(navigated):
        time_s, level, height = _lines_of(one, first)
        style = LINES[k % len(LINES)]
        draw_line(rows[0], time_s, level, label=one.label, **style)
        draw_line(rows[1], time_s, height, **style)
        draw_line(rows[2], time_s, _headings(one, first), **style)
        if len(level) and level.max() > 0:
            largest.append(float(level.max()))
    if largest and max(largest) > _WIDE * min(largest):
        rows[0].set_yscale("log")
        rows[0].set_ylim(bottom=max(_LEAST, min(largest) / 100))
        threshold = 10.0 ** math.ceil(math.log10(max(_LEAST, min(largest))))
        if max(map(abs, rows[1].dataLim.intervaly)) > 10 * threshold:
            rows[1].set_yscale("symlog", linthresh=threshold, linscale=2.0)
    for axes, label, unit in zip(
        rows, ("level position", "height", "heading"), ("m", "m", "°"), strict=True
    ):
        finish(axes, quantity(label, unit))
    rows[0].legend(
        loc="lower left", bbox_to_anchor=(0, 1), ncols=2, frameon=False, fontsize="small"
    )
    time_axis(rows[2])
    figure.align_ylabels()
    return figure


def _headings(one: Navigated, first: Navigated) -> Floats:
    """Return the heading's error or difference, °."""
    if len(one.errors):
        return one.errors.heading_deg
    _, ours, theirs = np.intersect1d(
        one.navigation["epoch"], first.navigation["epoch"], return_indices=True
    )
    turn = one.navigation["heading"][ours] - first.navigation["heading"][theirs]
    return np.degrees((turn + np.pi) % (2 * np.pi) - np.pi)


def write_picture(navigated: Sequence[Navigated], folder: Path, title: str) -> Path:
    """Write the picture into a folder; return its path."""
    (path,) = write_pictures(folder, {"beside": draw(navigated, title)})
    return path
