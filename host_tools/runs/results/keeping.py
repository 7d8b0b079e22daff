"""Folders of results: what becomes of the finished run that is there when the next one writes.

A run that was stopped leaves the finished one where it is, and goes into the folder `stopped`
there. A finished run takes the place; a finished one before it that came to something else is moved
into the folder `previous`.
"""

from __future__ import annotations

import json
from pathlib import Path

from rrins.host_tools.drawing.saving import names_of
from rrins.host_tools.files import JsonObject, keep, make_folder
from rrins.host_tools.runs.results.summary_types import AnySummary

STOPPED = "stopped"

SUMMARY = "summary.json"
_PICTURES = (
    "navigation_errors",
    "horizontal_track",
    "estimator",
    "estimated_sensors",
    "integrity",
    "parity",
    "navigation",
    "beside",
)
_TABLES = ("estimated_sensors.csv", "errors.csv", "navigation.csv")
_RESULTS = (*names_of(*_PICTURES), *_TABLES, SUMMARY)
_SAME = ("navigation_sha256", "scenario")
"""Keys that are equal in two runs of which the later may replace the earlier."""


def place_for(folder: Path, summary: AnySummary) -> tuple[Path, str | None]:
    """Return where a run writes its results, and a line if a finished one is kept.

    Parameters
    ----------
    folder : Path
        Where it was asked to.
    summary : dict
        Of the run that is to be written.

    Raises
    ------
    RehearsalError
        When a folder cannot be made, or a file not moved.
    """
    before = _summary_in(folder)
    if not before.get("completed"):
        return folder, None
    if not summary["completed"]:
        place = folder / STOPPED
        make_folder(place)
        return place, f"{folder} keeps the run that finished there; this one is in {place}"
    if all(before.get(key) == summary.get(key) for key in _SAME):
        return folder, None
    place = keep(folder, _RESULTS)
    return folder, f"the run that had finished in {folder} is kept in {place}"


def _summary_in(folder: Path) -> JsonObject:
    """Return the summary of the run that a folder has; empty without one."""
    try:
        found = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
