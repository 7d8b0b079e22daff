"""The summary of a run: one object with the same keys whichever way it was run, and its table."""

from __future__ import annotations

from pathlib import Path
from typing import cast

from rich.table import Table

from rrins.host_tools.files import JsonObject
from rrins.host_tools.rounding import as_stated, coarse, rounded, with_unit
from rrins.host_tools.runs.results.estimates import beside_truth, sensor_rows, write_sensors
from rrins.host_tools.runs.results.findings import finding_lines
from rrins.host_tools.runs.results.outcome import Outcome
from rrins.host_tools.runs.results.results import Errors, write_errors, write_summary
from rrins.host_tools.runs.results.seconds_log import Seconds
from rrins.host_tools.runs.results.stalls import stall_before_fault
from rrins.host_tools.runs.results.summary_types import AnySummary, Summary
from rrins.host_tools.runs.set_up import given_attitude
from rrins.host_tools.runs.set_up.load_warnings import warnings_of
from rrins.host_tools.runs.set_up.settings import trajectory_of
from rrins.host_tools.scenario.scenario import Scenario


def frames_lost(firmware: JsonObject, hardware: JsonObject) -> int | None:
    """Return the frames that one side sent and the other did not get; None if a side is mute."""
    if not firmware or not hardware or "frames_received" not in firmware:
        return None
    up = int(hardware["frames_sent"]) - int(firmware["frames_received"])
    down = int(firmware["frames_sent"]) - int(hardware["frames_received"])
    return max(0, up) + max(0, down)


def _motion_of(scenario: Scenario) -> JsonObject:
    """Return what the vehicle does, and what a recording had to be mended for."""
    trajectory = trajectory_of(scenario)
    notes = [] if trajectory is None else list(trajectory.notes)
    return {"kind": scenario.motion.kind, "notes": notes}


def summarise(
    name: str,
    scenario: Scenario,
    interface: str,
    outcome: Outcome,
    errors: Errors,
    stopped: str | None = None,
) -> Summary:
    """Return the summary object of a run.

    Parameters
    ----------
    stopped : str, optional
        Why the run did not come to its end.
    """
    firmware, hardware, wall_s = outcome.firmware, outcome.hardware, outcome.wall_s
    epochs = int(hardware.get("epochs", 0))
    overruns = firmware.get("lateness_us", {}).get("overruns", 0)
    overruns += hardware.get("lateness_us", {}).get("overruns", 0)
    until_s = float(errors.epoch[-1]) / scenario.rate_hz if len(errors) else None
    summary = {
        "scenario": name,
        "title": scenario.title,
        "completed": stopped is None,
        "stopped": stopped,
        "interface": interface,
        "duration_s": scenario.duration_s,
        "rate_hz": scenario.rate_hz,
        "seed": scenario.seed,
        "initial_attitude": scenario.firmware.initial_attitude,
        "given_attitude_error_arcsec": given_attitude.error_arcsec(scenario),
        "height_channel": scenario.firmware.height_channel,
        "motion": _motion_of(scenario),
        "warnings": warnings_of(scenario),
        "epochs": epochs,
        "wall_s": round(wall_s, 3),
        "epochs_per_s": round(epochs / wall_s, 1) if wall_s > 0 else 0.0,
        # A run that is stopped leaves frames under way, and the last ones uncounted.
        "frames_lost": frames_lost(firmware, hardware) if stopped is None else None,
        "overruns": overruns,
        "stall": stall_before_fault(firmware, hardware, until_s, scenario.firmware.bridge_s),
        **errors.largest(),
        "error_sample_interval_s": errors.sample_interval_s,
        "navigation_sha256": firmware.get("navigation_sha256"),
        "redundancy": firmware.get("redundancy"),
        "integrity": firmware.get("integrity"),
        "estimator": beside_truth(firmware.get("estimator"), hardware.get("biases")),
        "paper": None if scenario.paper is None else scenario.paper.model_dump(),
        "firmware": firmware,
        "hardware": hardware,
    }
    return cast(Summary, summary)  # a test compares the keys


def write_results(
    folder: Path, summary: AnySummary, errors: Errors, title: str, seconds: Seconds
) -> list[Path]:
    """Write pictures, errors and summary of a run into a folder; return their paths.

    Raises
    ------
    RehearsalError
        When one cannot be written; the summary is the first, then the pictures.
    """
    from rrins.host_tools.runs.results.plots import (
        write_plots,  # half a second that only pictures are worth
    )

    write_summary(folder / "summary.json", summary)  # what is smallest is there on a full disk
    paths = write_plots(folder, errors, title, summary["rate_hz"], seconds, summary)
    rows = sensor_rows(summary["estimator"])
    if rows:
        write_sensors(folder / "estimated_sensors.csv", rows)
        paths.append(folder / "estimated_sensors.csv")
    if len(errors):
        write_errors(folder / "errors.csv", errors)
        paths.append(folder / "errors.csv")
    return [*paths, folder / "summary.json"]


def cells_of(summary: AnySummary) -> list[list[str]]:
    """Return the cells of the table of a run: its head, then a row for each kind of error."""
    paper = summary["paper"] or {}
    rows = [["largest error", "east", "north", *(["paper, east", "paper, north"] if paper else [])]]
    for label, key, unit in (
        ("position", "max_abs_position_error_m", "m"),
        ("velocity", "max_abs_velocity_error_mps", "m/s"),
    ):
        ours, theirs = summary[key] or {}, paper.get(key) or {}
        cells = [with_unit(ours.get(side), unit) for side in ("east", "north")]
        if paper:
            cells += [as_stated(theirs.get(side), unit) for side in ("east", "north")]
        rows.append([label, *cells])
    return rows


def table_of(summary: AnySummary) -> Table:
    """Return the table that a person sees at the end of a run."""
    head, *rows = cells_of(summary)
    table = Table(title=summary["title"] or summary["scenario"], title_justify="left")
    table.add_column(head[0], no_wrap=True)
    for name in head[1:]:
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(*row)
    return table


def _lateness_line(side: str, lateness: JsonObject) -> str:
    worst = max(lateness["stalls"], key=lambda stall: stall["late_ms"], default=None)
    at = "" if worst is None else f" at {worst['at_s']:.1f} s"
    return (
        f"{side:>8} lateness: p50 {lateness['p50']:.0f} µs, p99 {lateness['p99']:.0f} µs, "
        f"p99.9 {lateness['p999']:.0f} µs, max {lateness['max']:.0f} µs{at}, "
        f"{lateness['overruns']} overruns in {lateness['epochs']} epochs"
    )


def _wire_line(wire: JsonObject) -> str:
    slowest = max(wire["messages"], key=lambda name: wire["messages"][name]["worst_response_us"])
    return (
        f"wire at {wire['bitrate'] // 1000} kbit/s: load {wire['load']:.1%}, "
        f"worst 100 ms {wire['worst_window_load']:.1%}; slowest {slowest}, "
        f"{wire['messages'][slowest]['worst_response_us']:.0f} µs from request to end"
    )


def _bus_lines(bus: JsonObject | None) -> list[str]:
    """Return what the host of the embedded bus did not let through."""
    if not bus:
        return []
    lines = []
    if bus["refused_frames"]:
        senders = ", ".join(f"{count} of {name}" for name, count in bus["senders"].items())
        lines.append(f"frames not delivered, as the contract gives them to a side: {senders}")
    if bus["cut_off"]:
        lines.append(f"cut off for what they sent: {bus['cut_off']} peers of the bus")
    if bus["held_back"]:
        lines.append(f"held back, as they sent too much: {', '.join(bus['held_back'])}")
    return lines


def _keys_of(calibration: JsonObject) -> str:
    tables = (f"{kind} {', '.join(calibration[kind])}" for kind in calibration if kind != "file")
    return "; ".join(tables) or "holds nothing"


def hash_words(firmware: JsonObject) -> str:
    """Return the beginning of the navigation's hash; a user's own program has none."""
    sha256 = firmware.get("navigation_sha256")
    if sha256 is not None:
        return f"navigation sha256 {sha256[:16]}…"
    return "nothing was navigated" if firmware.get("epochs_navigated") == 0 else ""


def _late_line(summary: AnySummary) -> list[str]:
    """Return how often the user's own program answered late."""
    program, faults = summary["firmware"].get("program"), summary["hardware"].get("faults", {})
    late, missing = faults.get("counter_errors", 0), faults.get("missing_commands", 0)
    if program is None or not (late or missing):
        return []
    stalls = faults.get("overruns", 0)
    own = f"; the hardware itself was late {stalls} times" if stalls else ""
    return [f"{program} answered late: {late} commands of another epoch, {missing} missing{own}"]


def _duration_line(summary: AnySummary) -> list[str]:
    """Return how long was navigated, where the scenario or the paper has another duration."""
    seconds, words = summary["duration_s"], f"over {summary['duration_s']:g} s"
    epochs = summary["firmware"].get("epochs_navigated")
    if summary["stopped"] is not None and epochs is not None:
        seconds = epochs / summary["rate_hz"]
        words = f"over {seconds:g} s of {summary['duration_s']:g} s"
    paper_s = (summary["paper"] or {}).get("duration_s")
    if paper_s not in (None, seconds):
        return [f"{words}; the paper's figures are over {paper_s:g} s"]
    return [words] if seconds != summary["duration_s"] else []


def pace_words(summary: AnySummary) -> str:
    """Return how fast a run was."""
    pace = summary["epochs_per_s"]
    return (
        f"{summary['epochs']:,} epochs in {coarse(summary['wall_s'])} s: {rounded(pace)} epochs/s, "
        f"{rounded(pace / summary['rate_hz'])} × real time"
    )


def lines_of(summary: AnySummary) -> list[str]:
    """Return the lines below the table: how the run went."""
    firmware = summary["firmware"]
    lines = [
        f"{pace_words(summary)}; "
        + ("" if summary["frames_lost"] is None else f"{summary['frames_lost']} frames lost, ")
        + f"{summary['overruns']} overruns",
        "; ".join(
            part
            for part in (
                f"initial attitude {summary['initial_attitude']}, "
                f"height {summary['height_channel']}",
                hash_words(firmware),
            )
            if part
        ),
    ]
    if summary["given_attitude_error_arcsec"] is not None:
        lines.append(given_attitude.words(summary["given_attitude_error_arcsec"]))
    lines.extend(f"motion: {note}" for note in summary["motion"]["notes"])
    calibration = firmware.get("calibration")
    if calibration is not None:
        lines.append(f"calibration {calibration['file']}: {_keys_of(calibration)}")
    lines += _duration_line(summary)
    for side in ("firmware", "hardware"):
        lateness = summary[side].get("lateness_us", {})
        if lateness.get("epochs"):
            lines.append(_lateness_line(side, lateness))
    lines += finding_lines(firmware)
    wire = summary["hardware"].get("wire")
    if wire:
        lines.append(_wire_line(wire))
    lines += _bus_lines(summary["hardware"].get("bus"))
    faults = {name: count for name, count in firmware.get("faults", {}).items() if count}
    if faults:
        counted = ", ".join(f"{name} {count}" for name, count in faults.items())
        lines.append(f"faults counted by the firmware: {counted}")
    return lines + _late_line(summary)
