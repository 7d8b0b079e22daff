"""Findings about a recorded motion, as numbers."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.files import JsonObject
from rrins.host_tools.motion.bridges import angle_gaps
from rrins.host_tools.motion.mending import interval_of
from rrins.host_tools.motion.recording import Recording
from rrins.host_tools.motion.smoothing import Smoothed, edge_speeds
from rrins.host_tools.motion.trajectory import ATTITUDE, SPECIFIC_FORCE_B, VELOCITY_N
from rrins.host_tools.rounding import NOTHING, alike, rounded, with_unit

_STEP_S = 0.05
_ANGLES = ("roll", "pitch", "heading")


def _attitude(recording: Recording, smoothed: Smoothed, angles: Floats) -> JsonObject:
    """Return ranges, residuals and gaps of the attitude; `angles` in rad, shape (m, 3)."""
    times = smoothed.residuals.time_s
    given = np.isfinite(recording.attitude).all(axis=1)
    source = "file" if recording.has_attitude else "track"
    if source == "file":
        times = times[given]
    gaps = angle_gaps(times)
    longest = max(gaps, key=lambda gap: gap[1] - gap[0], default=(0.0, 0.0))
    lines = recording.line[given] if source == "file" else recording.line
    degrees = np.degrees(angles)
    return {
        "source": source,
        "range_deg": {
            name: [float(low), float(high)]
            for name, low, high in zip(
                _ANGLES, degrees.min(axis=0), degrees.max(axis=0), strict=True
            )
        },
        "heading_begin_deg": float(degrees[0, 2]),
        "residual_deg": {
            name: _size(np.degrees(column[:, None]))
            for name, column in zip(_ANGLES, smoothed.residuals.attitude.T, strict=True)
        },
        "held_before_s": float(times[0]),
        "held_after_s": float(smoothed.trajectory.duration_s - times[-1]),
        "gaps": len(gaps),
        "longest_gap_s": longest[1] - longest[0],
        "longest_gap_before_line": (
            int(lines[np.searchsorted(times, longest[1])]) if gaps else None
        ),
    }


def _size(residual: Floats) -> dict[str, float] | None:
    """Return the rms and largest length of vectors, None if there are none."""
    finite = residual[np.isfinite(residual).all(axis=1)]
    if not len(finite):
        return None
    lengths = np.linalg.norm(finite, axis=1)
    return {"rms": float(np.sqrt(np.mean(lengths**2))), "max": float(lengths.max())}


def findings(recording: Recording, smoothed: Smoothed) -> JsonObject:
    """Return what `rrins motion check --json` prints."""
    trajectory = smoothed.trajectory
    state = trajectory.at(np.arange(0.0, trajectory.duration_s, _STEP_S))
    speed = np.linalg.norm(state[:, VELOCITY_N], axis=1)
    sideways = np.linalg.norm(state[:, SPECIFIC_FORCE_B][:, :2], axis=1)
    interval_s = interval_of(recording)
    begin, end = edge_speeds(recording)
    return {
        "file": str(recording.path),
        "format": recording.kind,
        "lines": recording.lines,
        "samples": len(recording),
        "span_s": float(recording.time_s[-1] - recording.time_s[0]),
        "interval_s": interval_s,
        "rate_hz": 1 / interval_s,
        "has_velocity": recording.has_velocity,
        "has_attitude": recording.has_attitude,
        "unused_columns": list(recording.unused),
        "would_be_refused": bool(recording.irregularities),
        "counts": dict(Counter(i.kind for i in recording.irregularities)),
        "irregularities": [asdict(i) for i in recording.irregularities],
        "distance_m": float(speed.sum() * _STEP_S),
        "speed_max_mps": float(speed.max()),
        "speed_begin_mps": begin,
        "speed_end_mps": end,
        "specific_force_horizontal_max_mps2": float(sideways.max()),
        "height_min_m": float(state[:, 8].min()),
        "height_max_m": float(state[:, 8].max()),
        "motion_s": trajectory.duration_s,
        "position_residual_m": _size(smoothed.residuals.position),
        "velocity_residual_mps": _size(smoothed.residuals.velocity),
        "attitude": _attitude(recording, smoothed, state[:, ATTITUDE]),
        "notes": list(trajectory.notes),
    }


def _residual(size: dict[str, float] | None, unit: str) -> str:
    if size is None:
        return NOTHING
    return f"rms {with_unit(size['rms'], unit)}, largest {with_unit(size['max'], unit)}"


def _attitude_rows(attitude: JsonObject) -> list[tuple[str, str]]:
    ranges, begin = attitude["range_deg"], attitude["heading_begin_deg"]
    low, high = (round(angle - begin, 1) + 0.0 for angle in ranges["heading"])  # no -0.0
    texts = [f"{name} {ranges[name][0]:.1f} to {ranges[name][1]:.1f}°" for name in _ANGLES[:2]]
    texts.append(f"heading from {round(begin, 1) % 360:.1f}°, turns {low:+.1f} to {high:+.1f}°")
    rows = [(f"attitude of {attitude['source']}", ", ".join(texts))]
    if attitude["source"] == "file":
        sizes = (
            f"{name} rms {rounded(size['rms'], 2)}°, largest {rounded(size['max'], 2)}°"
            for name, size in attitude["residual_deg"].items()
        )
        rows.append(("", f"smoothed - file: {'; '.join(sizes)}"))
    before, after = attitude["held_before_s"], attitude["held_after_s"]
    rows.append(("", f"held for {rounded(before)} s before and {rounded(after)} s after the file"))
    if attitude["gaps"]:
        count = "1 gap" if attitude["gaps"] == 1 else f"{attitude['gaps']} gaps, the longest"
        line = attitude["longest_gap_before_line"]
        rows.append(
            ("", f"held in {count} of {rounded(attitude['longest_gap_s'])} s before line {line}")
        )
    return rows


def table(found: JsonObject, most: int = 20) -> list[str]:
    """Return the lines that `rrins motion check` prints."""
    given = [word for word in ("velocity", "attitude") if found[f"has_{word}"]]
    speeds = alike(found[f"speed_{one}_mps"] for one in ("max", "begin", "end"))
    rows = [
        ("file", f"{found['file']} ({found['format']}: {', '.join(['position', *given])})"),
        ("lines", f"{found['lines']}, {found['samples']} usable"),
        ("span", f"{found['span_s']:.3f} s, {rounded(found['rate_hz'], 4)} Hz"),
        ("distance", f"{found['distance_m']:.0f} m"),
        (
            "speed",
            f"up to {speeds[0]} m/s, {speeds[1]} at the start, {speeds[2]} at the end",
        ),
        ("height", f"{found['height_min_m']:.1f} to {found['height_max_m']:.1f} m"),
        ("smoothed - file", _residual(found["position_residual_m"], "m")),
        ("", _residual(found["velocity_residual_mps"], "m/s")),
        ("", f"horizontal force up to {rounded(found['specific_force_horizontal_max_mps2'])} m/s²"),
    ]
    rows += _attitude_rows(found["attitude"])
    if found["unused_columns"]:
        rows.append(("not used", ", ".join(found["unused_columns"])))
    rows += [("note", note) for note in found["notes"]]
    lines = [f"{name:<16} {text}" for name, text in rows]
    irregular = found["irregularities"]
    word = "the file would be refused" if irregular else "nothing to mend"
    lines.append(f'{"irregularities":<16} {len(irregular)}: with "refuse" {word}')
    lines += [f"  line {i['line']}: {i['text']}: {i['mended']}" for i in irregular[:most]]
    if len(irregular) > most:
        lines.append(f"  and {len(irregular) - most} more (--json lists all)")
    return lines
