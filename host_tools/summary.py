"""The summary of a run: one object with the same keys whichever way it was run, and its table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.table import Table

from host_tools.outfit import trajectory_of
from host_tools.results import Errors, read_errors, write_errors, write_summary
from host_tools.scenario import Scenario
from host_tools.sides import NAVIGATION_ROWS, TRUTH_ROWS


def frames_lost(firmware: dict[str, Any], hardware: dict[str, Any]) -> int | None:
    """Return the frames that one side sent and the other did not get; None if a side is mute."""
    if not firmware or not hardware:
        return None
    up = int(hardware["frames_sent"]) - int(firmware["frames_received"])
    down = int(firmware["frames_sent"]) - int(hardware["frames_received"])
    return max(0, up) + max(0, down)


def _motion_of(scenario: Scenario) -> dict[str, Any]:
    """Return what the vehicle does, and what a recording had to be mended for."""
    trajectory = trajectory_of(scenario)
    notes = [] if trajectory is None else list(trajectory.notes)
    return {"kind": scenario.motion.kind, "notes": notes}


def summarise(
    name: str,
    scenario: Scenario,
    interface: str,
    wall_s: float,
    firmware: dict[str, Any],
    hardware: dict[str, Any],
    errors: Errors,
    stopped: str | None = None,
) -> dict[str, Any]:
    """Return the summary object of a run.

    Parameters
    ----------
    firmware, hardware : dict
        What each side reported at its end; empty for a side that could not.
    stopped : str, optional
        Why the run did not come to its end.
    """
    epochs = int(hardware.get("epochs", 0))
    overruns = firmware.get("lateness_us", {}).get("overruns", 0)
    overruns += hardware.get("lateness_us", {}).get("overruns", 0)
    return {
        "scenario": name,
        "title": scenario.title,
        "completed": stopped is None,
        "stopped": stopped,
        "interface": interface,
        "duration_s": scenario.duration_s,
        "rate_hz": scenario.rate_hz,
        "seed": scenario.seed,
        "initial_attitude": scenario.firmware.initial_attitude,
        "height_channel": scenario.firmware.height_channel,
        "motion": _motion_of(scenario),
        "epochs": epochs,
        "wall_s": round(wall_s, 3),
        "epochs_per_s": round(epochs / wall_s, 1) if wall_s > 0 else 0.0,
        "frames_lost": frames_lost(firmware, hardware),
        "overruns": overruns,
        **errors.largest(),
        "error_sample_interval_s": errors.sample_interval_s,
        "navigation_sha256": firmware.get("navigation_sha256"),
        "paper": None if scenario.paper is None else scenario.paper.model_dump(),
        "firmware": firmware,
        "hardware": hardware,
    }


def write_results(folder: Path, summary: dict[str, Any], errors: Errors, title: str) -> list[Path]:
    """Write pictures, errors and summary of a run into a folder; return their paths.

    Raises
    ------
    RehearsalError
        When one cannot be written; the summary is the first, then the pictures.
    """
    from host_tools.plots import write_plots  # half a second that only pictures are worth

    write_summary(folder / "summary.json", summary)  # what is smallest is there on a full disk
    paths = write_plots(folder, errors, title)
    if len(errors):
        write_errors(folder / "errors.csv", errors)
        paths.append(folder / "errors.csv")
    return [*paths, folder / "summary.json"]


def collect(folder: Path, rate_hz: int) -> Errors:
    """Return the errors from the logs in a folder, and remove the logs: the CSV takes over."""
    errors = read_errors(folder, rate_hz)
    for name in (NAVIGATION_ROWS, TRUTH_ROWS):
        (folder / name).unlink(missing_ok=True)
    return errors


def _shown(value: float | None, unit: str) -> str:
    if value is None:
        return "-"
    if unit == "m" and abs(value) >= 1000:
        return f"{value / 1000:.3g} km"
    if abs(value) < 0.1 and value != 0:
        return f"{value * 1000:.3g} m{unit}"
    return f"{value:.3g} {unit}"


def table_of(summary: dict[str, Any]) -> Table:
    """Return the table that a person sees at the end of a run."""
    table = Table(title=summary["title"] or summary["scenario"], title_justify="left")
    table.add_column("largest error", no_wrap=True)
    table.add_column("east", justify="right")
    table.add_column("north", justify="right")
    paper = summary["paper"] or {}
    if paper:
        table.add_column("paper, east", justify="right")
        table.add_column("paper, north", justify="right")
    for label, key, unit in (
        ("position", "max_abs_position_error_m", "m"),
        ("velocity", "max_abs_velocity_error_mps", "m/s"),
    ):
        ours, theirs = summary[key] or {}, paper.get(key) or {}
        cells = [_shown(ours.get(side), unit) for side in ("east", "north")]
        if paper:
            cells += [_shown(theirs.get(side), unit) for side in ("east", "north")]
        table.add_row(label, *cells)
    return table


def _lateness_line(side: str, lateness: dict[str, Any]) -> str:
    return (
        f"{side:>8} lateness: p50 {lateness['p50']:.0f} µs, p99 {lateness['p99']:.0f} µs, "
        f"p99.9 {lateness['p999']:.0f} µs, max {lateness['max']:.0f} µs, "
        f"{lateness['overruns']} overruns in {lateness['epochs']} epochs"
    )


def _wire_line(wire: dict[str, Any]) -> str:
    slowest = max(wire["messages"], key=lambda name: wire["messages"][name]["worst_response_us"])
    return (
        f"wire at {wire['bitrate'] // 1000} kbit/s: load {wire['load']:.1%}, "
        f"worst 100 ms {wire['worst_window_load']:.1%}; slowest {slowest}, "
        f"{wire['messages'][slowest]['worst_response_us']:.0f} µs from request to end"
    )


def _keys_of(calibration: dict[str, Any]) -> str:
    tables = (f"{kind} {', '.join(calibration[kind])}" for kind in calibration if kind != "file")
    return "; ".join(tables) or "holds nothing"


def lines_of(summary: dict[str, Any]) -> list[str]:
    """Return the lines below the table: how the run went."""
    firmware = summary["firmware"]
    lines = [
        f"{summary['epochs']} epochs in {summary['wall_s']:.1f} s: "
        f"{summary['epochs_per_s']:.0f} epochs/s, "
        f"{summary['epochs_per_s'] / summary['rate_hz']:.0f} times real time; "
        f"{summary['frames_lost']} frames lost, {summary['overruns']} overruns",
        f"initial attitude {summary['initial_attitude']}, height {summary['height_channel']}; "
        f"navigation sha256 {(summary['navigation_sha256'] or '-')[:16]}…",
    ]
    lines.extend(f"motion: {note}" for note in summary["motion"]["notes"])
    calibration = firmware.get("calibration")
    if calibration is not None:
        lines.append(f"calibration {calibration['file']}: {_keys_of(calibration)}")
    paper_s = (summary["paper"] or {}).get("duration_s")
    if paper_s not in (None, summary["duration_s"]):
        lines.append(
            f"over {summary['duration_s']:g} s; the paper's figures are over {paper_s:g} s"
        )
    for side in ("firmware", "hardware"):
        lateness = summary[side].get("lateness_us", {})
        if lateness.get("epochs"):
            lines.append(_lateness_line(side, lateness))
    wire = summary["hardware"].get("wire")
    if wire:
        lines.append(_wire_line(wire))
    faults = {name: count for name, count in firmware.get("faults", {}).items() if count}
    if faults:
        counted = ", ".join(f"{name} {count}" for name, count in faults.items())
        lines.append(f"faults counted by the firmware: {counted}")
    for axis, lost in zip(("inner", "outer"), firmware.get("axes_not_following", ()), strict=False):
        if lost:
            lines.append(f"the {axis} axis did not follow its command")
    return lines
