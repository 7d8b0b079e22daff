"""Output of a replay through the firmware: summary, tables and plots."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Records
from rrins.firmware_py.core.records.memory import NavigationOutput
from rrins.host_tools.files import JsonObject, write_whole
from rrins.host_tools.logs.beside import Navigated
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.logs.replay import Replayed
from rrins.host_tools.rounding import NOTHING, kept, rounded
from rrins.host_tools.runs.results.estimates import estimator_lines
from rrins.host_tools.runs.results.keeping import place_for
from rrins.host_tools.runs.results.outcome import Outcome
from rrins.host_tools.runs.results.results import Errors, read_errors, write_summary
from rrins.host_tools.runs.results.samples import NAVIGATION_SAMPLES, TRUTH_SAMPLES, read_samples
from rrins.host_tools.runs.results.seconds_log import take_seconds
from rrins.host_tools.runs.results.summary import (
    hash_words,
    pace_words,
    summarise,
    table_of,
    write_results,
)
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.terminal import new_console, print_line, print_table

_COLUMNS = (
    ("time_s", "%.3f"),
    ("latitude_deg", "%.12g"),
    ("longitude_deg", "%.12g"),
    ("height_m", "%.6f"),
    ("velocity_east_mps", "%.9g"),
    ("velocity_north_mps", "%.9g"),
    ("velocity_up_mps", "%.9g"),
    ("roll_deg", "%.9g"),
    ("pitch_deg", "%.9g"),
    ("heading_deg", "%.9g"),
)


def write_replay(
    folder: Path,
    name: str,
    scenario: Scenario,
    log: Log,
    replayed: Replayed,
    on_note: Callable[[str], None],
) -> tuple[Navigated, list[Path]]:
    """Write the results of a replay to a folder; return them and the paths.

    The samples that it left there become tables and pictures: the navigation, and, where the truth
    is known, its errors as after a simulation. `on_note` hears what became of an earlier result.
    """
    navigation = read_samples(folder / NAVIGATION_SAMPLES, NavigationOutput)
    if replayed.why_no_truth is not None:
        (folder / TRUTH_SAMPLES).unlink(missing_ok=True)
    errors = read_errors(folder, scenario.rate_hz)
    for file in (NAVIGATION_SAMPLES, TRUTH_SAMPLES):
        (folder / file).unlink(missing_ok=True)
    seconds = take_seconds(folder)
    summary = _summary_of(name, scenario, log, replayed, errors)
    title = f"{scenario.title or name}, replayed from {log.path.name}"
    folder, note = place_for(folder, summary)
    if note is not None:
        on_note(note)
    paths = _write_navigation(folder, navigation, scenario.rate_hz, title)
    navigated = Navigated("as it is", summary, navigation, errors)
    if len(errors):
        written = write_results(folder, summary, errors, title, seconds)
        return navigated, [*paths, *written]
    write_summary(folder / "summary.json", summary)
    return navigated, [*paths, folder / "summary.json"]


def _summary_of(
    name: str, scenario: Scenario, log: Log, replayed: Replayed, errors: Errors
) -> JsonObject:
    """Return the summary of a run, including what is known about the recording."""
    outcome = Outcome(replayed.firmware, wall_s=replayed.wall_s)
    summary: JsonObject = {**summarise(name, scenario, "replay", outcome, errors)}
    summary["epochs"] = replayed.steps
    summary["epochs_per_s"] = round(replayed.steps / max(replayed.wall_s, 1e-9), 1)
    sha256 = None if log.note is None else log.note.navigation_sha256
    summary["recording"] = {
        "file": str(log.path),
        "frames": log.frames,
        "first_epoch": replayed.first_epoch,
        "last_epoch": replayed.last_epoch,
        "damage": log.damage,
        "navigation_sha256": sha256,
        "no_truth": replayed.why_no_truth,
        "unanswered_s": round(replayed.unanswered_s, 3),
        "rms_error": rms_of(errors),
    }
    comparison = replayed.comparison
    summary["comparison"] = None if comparison is None else comparison.summary()
    return summary


_RMS = {
    "position_m": {"east": "position_east_m", "north": "position_north_m", "up": "height_m"},
    "velocity_mps": {"east": "velocity_east_mps", "north": "velocity_north_mps"},
    "attitude_deg": {"roll": "roll_deg", "pitch": "pitch_deg", "heading": "heading_deg"},
}


def rms_of(errors: Errors) -> JsonObject | None:
    """Return the root mean squares of the errors over the navigation; None without a truth.

    What the truth does not say, such as an attitude, is null.
    """
    if not len(errors):
        return None
    return {
        kind: {side: _rms(getattr(errors, name)) for side, name in names.items()}
        for kind, names in _RMS.items()
    }


def _rms(values: NDArray[np.float64]) -> float | None:
    return kept(float(np.sqrt(np.mean(np.square(values)))), 6)


def _rms_line(rms: JsonObject) -> str:
    place, velocity, angles = ([*map(rounded, rms[kind].values())] for kind in _RMS)
    text = (
        f"rms error: east {place[0]} m, north {place[1]} m, up {place[2]} m; "
        f"{velocity[0]} m/s, {velocity[1]} m/s"
    )
    if NOTHING not in angles:
        text += f"; roll {angles[0]}°, pitch {angles[1]}°, heading {angles[2]}°"
    return text


def _write_navigation(
    folder: Path, navigation: Records[NavigationOutput], rate_hz: int, title: str
) -> list[Path]:
    if len(navigation) < 2:
        return []
    from rrins.host_tools.drawing.saving import write_pictures
    from rrins.host_tools.logs.pictures import draw_navigation

    table = folder / "navigation.csv"
    pictures = write_pictures(folder, {"navigation": draw_navigation(navigation, rate_hz, title)})
    columns = [
        navigation["epoch"] / rate_hz,
        np.degrees(navigation["latitude"]),
        np.degrees(navigation["longitude"]),
        navigation["height"],
        *(navigation["velocity_n"][:, axis] for axis in range(3)),
        *(np.degrees(navigation[angle]) for angle in ("roll", "pitch", "heading")),
    ]
    texts = [
        [spec % value for value in column.tolist()]
        for (_, spec), column in zip(_COLUMNS, columns, strict=True)
    ]

    def write(file: IO[str]) -> None:
        writer = csv.writer(file)
        writer.writerow(["epoch", *(column for column, _ in _COLUMNS)])
        writer.writerows(zip(navigation["epoch"].tolist(), *texts, strict=True))

    write_whole(table, write)
    return [*pictures, table]


_UNANSWERED_S = 0.1  # a recording may extend this far past the last step of a normal run


def print_replay(summary: JsonObject, paths: list[Path]) -> None:
    """Print the result of a replay for a person."""
    console = new_console()
    if summary["max_abs_position_error_m"] is not None:
        print_table(table_of(summary), console)
    recording = summary["recording"]
    lines = [
        pace_words(summary),
        _how_it_ended(summary["firmware"]),
        hash_words(summary["firmware"])
        + _same_or_not(summary["navigation_sha256"], recording["navigation_sha256"]),
    ]
    if recording["rms_error"] is not None:
        lines.append(_rms_line(recording["rms_error"]))
    lines.extend(estimator_lines(summary["firmware"]))
    if recording["no_truth"] is not None:
        lines.append(f"no error statistics without a truth: {recording['no_truth']}")
    if recording["first_epoch"] > 0:
        lines.append(
            f"the log begins at epoch {recording['first_epoch']}; the firmware was powered on there"
        )
    if recording["unanswered_s"] > _UNANSWERED_S:
        lines.append(
            f"the last {recording['unanswered_s']:.1f} s of the log were not navigated: the "
            "firmware had stopped sending"
        )
    for text in (*lines, *(f"  {path}" for path in paths)):
        print_line(console, text, highlight=False)


def _how_it_ended(firmware: JsonObject) -> str:
    text = f"{firmware['epochs_navigated']} epochs navigated, ended in {firmware['mode']}"
    if firmware["fault"] != "NONE":
        text += f" ({firmware['fault']})"
    counted = [f"{name} {count}" for name, count in firmware["faults"].items() if count]
    return text + (f"; faults counted: {', '.join(counted)}" if counted else "")


def _same_or_not(ours: str, recorded: str | None) -> str:
    if recorded is None:
        return ""
    return ", as recorded" if ours == recorded else f", recorded {recorded[:16]}…"
