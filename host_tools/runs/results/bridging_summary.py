"""What a run's summary says of lost sensor data that were bridged."""

from __future__ import annotations

import math

from rrins.firmware_py.core.navigation.bridging import is_degraded
from rrins.firmware_py.core.records.memory import Ram
from rrins.host_tools.files import JsonObject

_is_degraded = getattr(is_degraded, "py_func", is_degraded)


def bridging_summary(state: Ram) -> JsonObject:
    """Return what was bridged since navigation began, and what that may have cost."""
    gaps = state.bridging
    seconds = int(state.parameters.period_ns) * 1e-9
    arcsec = math.degrees(math.sqrt(float(gaps.angle_variance))) * 3600
    return {
        "bridged_s": round(int(gaps.bridged_epochs) * seconds, 3),
        "recent_s": round(float(gaps.recent_s), 3),
        "degraded": bool(_is_degraded(gaps)),
        "attitude_uncertainty_arcsec": round(arcsec, 3),
        "velocity_uncertainty_mps": round(math.sqrt(float(gaps.velocity_variance)), 6),
    }


def bridging_lines(firmware: JsonObject) -> list[str]:
    """Return the line for a person; none if so little was bridged that it does not matter."""
    gaps = firmware.get("bridging")
    if gaps is None or not (gaps["degraded"] or gaps["bridged_s"] > 1):
        return []
    state = "navigation degraded" if gaps["degraded"] else "navigation was degraded"
    return [
        f"{state}: {gaps['bridged_s']:.1f} s of the sensor data bridged, attitude uncertain by "
        f"{gaps['attitude_uncertainty_arcsec']:.1f}″ for that"
    ]
