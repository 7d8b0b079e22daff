"""The section of `docs/faults.md` on failing sensors without redundancy and with it."""

from __future__ import annotations

import math
from typing import Any, Final

import rrins

_AT_S = 203.0
_BEGIN_S = 3.0
"""When the fault begins after power-on, and navigation."""

_SENSOR = 3
_DURATION_S = 400
_NOISE = {
    "gyros": {"angle_random_walk_deg_per_sqrt_h": 0.005, "bias_dph": 0.0},
    "accelerometers": {"white_noise_ug_per_sqrt_hz": 10, "bias_ug": 0.0},
}

CASES: Final = (
    ("step, 10 °/h", {"kind": "gyro_bias"}),
    ("ramp, 10 °/h per minute", {"kind": "gyro_ramp", "bias_dph_per_min": 10}),
    ("scale factor, 1 %", {"kind": "gyro_scale"}),
    ("mount, δv of 60″", {"kind": "gyro_shift_v"}),
    ("noise, 1 °/√h", {"kind": "gyro_noise"}),
    ("stuck", {"kind": "gyro_stuck"}),
    ("dead", {"kind": "gyro_dead"}),
    ("full scale", {"kind": "gyro_full_scale"}),
    ("absent", {"kind": "gyro_absent"}),
    ("step, 2 s of every 10 s", {"kind": "gyro_bias", "period_s": 10, "duty": 0.2}),
    ("absent at power-on", {"kind": "gyro_absent", "at_s": 0}),
    ("dead at power-on", {"kind": "gyro_dead", "at_s": 0}),
    ("step, 1000 µg", {"kind": "accelerometer_bias"}),
    ("ramp, 100 µg per minute", {"kind": "accelerometer_ramp"}),
    ("scale factor, 1 %", {"kind": "accelerometer_scale"}),
    ("mount, δv of 60″", {"kind": "accelerometer_shift_v"}),
    ("noise, 1000 µg/√Hz", {"kind": "accelerometer_noise"}),
    ("stuck", {"kind": "accelerometer_stuck"}),
    ("dead", {"kind": "accelerometer_dead"}),
    ("full scale", {"kind": "accelerometer_full_scale"}),
    ("absent", {"kind": "accelerometer_absent"}),
    ("absent at power-on", {"kind": "accelerometer_absent", "at_s": 0}),
)
"""Faults of gyros, then of accelerometers."""

_HEAD = f"""
## Failing sensors, without redundancy and with it

`rimu_rotating` at rest, white noise of the preset `prototype` alone, {_DURATION_S} s; sensor
{_SENSOR} fails {_AT_S - _BEGIN_S:.0f} s into navigation or at power-on, with `[redundancy] enabled`
false and true. *Alarm* and *left out* are s from the fault; *error* is the largest horizontal one.

| fault | without: mode | error | with: mode | alarm | left out | error |
|---|---|---|---|---|---|---|
"""


def _run(fault: dict[str, Any] | None, enabled: bool) -> dict[str, Any]:
    faults = [] if fault is None else [{"sensor": _SENSOR, "at_s": _AT_S} | fault]
    run = rrins.simulate(
        "rimu_rotating",
        duration_s=_DURATION_S,
        faults=faults,
        redundancy={"enabled": enabled},
        **_NOISE,
    )
    return dict(run.summary)


def _error(summary: dict[str, Any]) -> str:
    worst = summary["max_abs_position_error_m"]
    if worst is None:
        return "-"
    metres = math.hypot(worst["east"], worst["north"])
    return f"{metres:.1f} m" if metres < 1000 else f"{metres / 1000:.1f} km"


def _mode(summary: dict[str, Any]) -> str:
    fault = summary["firmware"]["fault"]
    return "navigates" if fault == "NONE" else f"FAULT ({fault})"


def _row(name: str, fault: dict[str, Any]) -> str:
    before, after = _run(fault, False), _run(fault, True)
    kind = str(fault["kind"]).partition("_")[0]
    found = after["redundancy"][f"{kind}s"]
    begun_s = fault.get("at_s", _AT_S) - _BEGIN_S

    def since(key: str) -> str:
        return "-" if found[key] is None else f"{max(0.0, found[key] - begun_s):.1f}"

    left_out = since("isolated_s")
    if found["excluded"] is None and found["unresolved_s"] is not None:
        left_out = "one of them, unknown which"
    cells = (
        f"{kind}: {name}",
        _mode(before),
        _error(before),
        _mode(after),
        since("alarm_s"),
        left_out,
        _error(after),
    )
    return f"| {' | '.join(cells)} |"


def section() -> str:
    """Return the section as Markdown, measured."""
    none = _run(None, False), _run(None, True)
    lines = [f"| none | {_mode(none[0])} | {_error(none[0])} | {_mode(none[1])} | - | - "]
    lines[0] += f"| {_error(none[1])} |"
    lines += [_row(name, dict(fault)) for name, fault in CASES]
    return _HEAD + "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(section(), end="")
