"""Settings of a navigation computer, as lines that any language reads.

The first line is ``rrins-setup`` and the version; then a key and its values in each, keys of
several parts repeated. `docs/own-firmware.md` has the table.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from rrins.firmware_py.core.settings import Settings
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.runs.set_up.settings import firmware_settings
from rrins.host_tools.scenario.scenario import Scenario

VERSION: Final = 1

_NUMBERS: Final = (
    "latitude_deg",
    "longitude_deg",
    "height_m",
    "roll_deg",
    "pitch_deg",
    "heading_deg",
    "alignment_s",
    "bridge_s",
    "axis_acceleration_dps2",
    "axis_rise_s",
    "follow_tolerance_deg",
    "axis_silence_s",
)


def _sensor_lines(
    kind: str, axes_deg: tuple[tuple[float, float], ...], weights: tuple[float, ...]
) -> list[str]:
    return [
        f"{kind} {polar!r} {azimuth!r} {weight!r}"
        for (polar, azimuth), weight in zip(axes_deg, weights, strict=True)
    ]


def _lines(settings: Settings) -> list[str]:
    scheme = settings.scheme
    lines = [
        f"rrins-setup {VERSION}",
        f"rate_hz {settings.rate_hz}",
        *(f"{name} {float(getattr(settings, name))!r}" for name in _NUMBERS),
        f"initial_attitude {settings.initial_attitude}",
        f"height_channel {settings.height_channel}",
        f"altimeter {int(settings.altimeter)}",
        f"gnss_interval_s {settings.gnss_interval_s!r}",
        *_sensor_lines("gyro", settings.gyro_axes_deg, settings.gyro_weights),
        *_sensor_lines(
            "accelerometer", settings.accelerometer_axes_deg, settings.accelerometer_weights
        ),
        f"turn_rate_dps {float(scheme.turn_rate_dps)!r}",
        f"stand_s {float(scheme.stand_s)!r}",
        *(f"turn {turn.axis} {float(turn.angle_deg)!r}" for turn in scheme.turns),
    ]
    if scheme.isolate_heading:
        lines.append(f"isolation_rate_dps {settings.isolation_rate_dps!r}")
    odometer = settings.odometer
    if odometer is not None:
        lever = " ".join(repr(part) for part in odometer.lever_arm_m)
        lines.append(f"odometer {odometer.interval_s!r} {odometer.metres_per_pulse!r} {lever}")
    return lines


def setup_text(scenario: Scenario) -> str:
    """Return the set-up of a scenario's navigation computer as lines.

    Raises
    ------
    RehearsalError
        When a file that the scenario names cannot be used.
    """
    return "\n".join(_lines(firmware_settings(scenario))) + "\n"


def write_setup(path: Path, scenario: Scenario) -> None:
    """Write the set-up of a scenario's navigation computer.

    Raises
    ------
    RehearsalError
        When the file cannot be written, or one that the scenario names cannot be used.
    """
    try:
        path.write_text(setup_text(scenario), encoding="ascii")
    except OSError as error:
        raise RehearsalError(f"{path}: cannot be written: {error.strerror}") from error
