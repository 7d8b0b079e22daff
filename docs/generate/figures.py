"""Writes the data of the figures in `docs/what-for.md`: ``python -m generate.figures``.

From runs: with the table turning and at rest, and with an accelerometer's bias for three hours.
The file is a script, not JSON, so that a page that is opened from a disk can read it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from rrins.dbc.contract import load_contract
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.results.results import compare
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario, load

TO = Path(__file__).parents[1] / "_static" / "figures_data.js"
_DIGITS = 4
_BIAS_UG = 100.0


def _rounded(values: Any) -> list[float]:
    return [float(f"{value:.{_DIGITS}g}") for value in np.asarray(values).tolist()]


def _run(scenario: Scenario, every_s: float) -> dict[str, list[float]]:
    every = round(every_s * scenario.rate_hz)
    run = FastRun.of(firmware_settings(scenario), hardware_settings(scenario), every)
    track = run.run(scenario.epochs)
    found = compare(track.navigation, track.truth, scenario.rate_hz)
    return {
        "time_s": _rounded(found.time_s),
        "east_m": _rounded(found.position_east_m),
        "north_m": _rounded(found.position_north_m),
        "inner_deg": _rounded(found.inner_deg),
        "outer_deg": _rounded(found.outer_deg),
    }


def figures() -> dict[str, Any]:
    """Return the data of all figures."""
    turning = load("rimu_rotating", duration_s=1600)
    resting = load("rimu_strapdown", duration_s=1600)
    swinging = load("imu_strapdown", duration_s=3 * 3600).varied(
        gyros__bias_dph=0.0, accelerometers__bias_ug=(_BIAS_UG, 0.0, 0.0)
    )
    message = load_contract()[0].sensor[0]
    table = message.message
    return {
        "axes_deg": [list(pair) for pair in turning.rimu.gyros],
        "turning": _run(turning, 2.0),
        "resting": _run(resting, 4.0),
        "schuler": {"bias_ug": _BIAS_UG} | _run(swinging, 60.0),
        "frame": {
            "can_id": int(table.can_id),
            "data_id": int(table.data_id),
            "rate_hz": turning.rate_hz,
            "gyro": [int(message.gyro_dtheta.shift), float(message.gyro_dtheta.scale)],
            "accelerometer": [
                int(message.accelerometer_dv.shift),
                float(message.accelerometer_dv.scale),
            ],
        },
    }


def text_of(found: dict[str, Any]) -> str:
    """Return the script."""
    body = json.dumps(found, separators=(",", ":"))
    return (
        f"// Written by `python -m generate.figures`, from runs.\nwindow.rrinsFigures = {body};\n"
    )


if __name__ == "__main__":
    TO.write_text(text_of(figures()), encoding="utf-8")
