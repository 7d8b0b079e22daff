"""What a run's summary says of the turntable: wrong encoders, axes that did not follow."""

from __future__ import annotations

from rrins.firmware_py.core.records.encoder_records import AngleSource
from rrins.firmware_py.core.records.memory import Ram
from rrins.host_tools.files import JsonObject

AXES = ("inner", "outer")

_INSTEAD = {
    "corrected": "less an offset of {offset_deg:.3f}°",
    "gyros": "the gyros' angle is used",
    "command": "the commanded angle is used",
}


def encoder_summary(state: Ram) -> JsonObject:
    """Return what became of each axis' encoder; None for one that has always been right.

    `found_at_s` counts since power-on of the hardware, as `at_s` of a fault does.
    """
    encoders = state.encoders
    rate_hz = 1e9 / int(state.parameters.period_ns)
    summary: JsonObject = {}
    for index, name in enumerate(AXES):
        found_epoch = int(encoders.found_epoch[index]) - 1
        summary[name] = None
        if found_epoch >= 0:
            summary[name] = {
                "found_at_s": round(found_epoch / rate_hz, 3),
                "source": AngleSource(int(encoders.source[index])).name.lower(),
                "offset_deg": round(float(encoders.offset_deg[index]), 6),
            }
    return summary


def table_lines(firmware: JsonObject) -> list[str]:
    """Return what a person is told of the turntable; nothing if all was well."""
    lines = []
    for k, axis in enumerate(AXES):
        count = firmware.get("axis_interruptions", (0, 0))[k]
        if firmware.get("axes_abandoned", (False, False))[k]:
            lines.append(f"the {axis} axis did not follow in any try: rotation abandoned")
        elif firmware.get("axes_not_following", (False, False))[k]:
            lines.append(f"the {axis} axis did not follow its command")
        elif count:
            times = "once" if count == 1 else f"{count} times"
            lines.append(f"the {axis} axis did not follow its command {times}: rotation resumed")
        encoder = firmware.get("encoders", {}).get(axis)
        if encoder is not None:
            found = f"found at {encoder['found_at_s']:.3f} s"
            if encoder["source"] == "encoder":
                lines.append(f"the {axis} encoder contradicted the gyros ({found}), and is well")
            else:
                instead = _INSTEAD[encoder["source"]].format(**encoder)
                lines.append(f"the {axis} encoder contradicts the gyros ({found}): {instead}")
    return lines
