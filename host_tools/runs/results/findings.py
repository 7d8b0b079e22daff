"""Findings of the firmware in a run: for each its key in the summary, its value, its words."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import IntEnum

from rrins.compiled.record import Records
from rrins.firmware_py.core.navigation.bridging import is_degraded
from rrins.firmware_py.core.records.encoder_records import AngleSource
from rrins.firmware_py.core.records.memory import Fusion, Ram
from rrins.firmware_py.core.records.redundancy_records import Found, Parity, Readmission, Refusal
from rrins.firmware_py.diagnostics.reader import FieldReader
from rrins.firmware_py.diagnostics.redundancy_identifiers import CALIBRATION_STATUS
from rrins.host_tools.diag.calibration_status import drift_words, origin_words, status_of
from rrins.host_tools.files import JsonObject
from rrins.host_tools.monitor.words import FOUND_BY, NOT_READMITTED
from rrins.host_tools.runs.results.estimates import estimator_lines, estimator_summary
from rrins.host_tools.runs.results.integrity import integrity_lines, integrity_summary
from rrins.host_tools.runs.results.sensor_errors import KINDS

AXES = ("inner", "outer")

_is_degraded = getattr(is_degraded, "py_func", is_degraded)

_INSTEAD = {
    "corrected": "less an offset of {offset_deg:.3f}°",
    "gyros": "the gyros' angle is used",
    "command": "the commanded angle is used",
}


@dataclass(frozen=True)
class Finding:
    """Something that the firmware may find out."""

    key: str  #: in the firmware's part of the summary
    #: returns its value; None where there is nothing to find out
    read: Callable[[Records[Ram]], JsonObject | None]
    #: yields the lines for a person from the firmware's part of the summary, any key of which a
    #: user's own program may leave out
    lines: Callable[[JsonObject], Iterator[str]]


def _rate_hz(state: Ram) -> float:
    return 1e9 / int(state.parameters.period_ns)


def _lower(value: IntEnum) -> str:
    return value.name.lower()


def _since_navigation(state: Ram) -> Callable[[int], float]:
    """Return what makes an epoch seconds since navigation began."""
    rate_hz, begun = _rate_hz(state), int(state.redundancy.navigation_epoch)
    return lambda epoch: round((int(epoch) - begun) / rate_hz, 3)


def redundancy_summary(ram: Records[Ram]) -> JsonObject | None:
    """Return what happened to the sensors of each kind; None if they are not compared.

    Times are seconds since navigation began, null where nothing happened.
    """
    state, redundancy = ram[0], ram[0].redundancy
    if not redundancy.enabled:
        return None
    seconds = _since_navigation(state)
    return {
        name: _redundancy_of(redundancy.readmission, redundancy[name], state[name], seconds)
        for name in KINDS
    }


def _redundancy_of(
    readmission: Readmission, parity: Parity, fusion: Fusion, seconds: Callable[[int], float]
) -> JsonObject:
    sensor, readmitted = int(parity.isolated), int(parity.readmitted)
    alarm, found = int(parity.alarm_epoch), int(parity.found_epoch)
    is_isolated, came_back = sensor >= 0, readmitted >= 0
    is_repaired = is_isolated and int(parity.repaired_epoch) >= 0
    is_open = alarm > (found if is_isolated else 0)
    has_alarmed = is_isolated or alarm > 0
    is_refused = bool(readmission.refusal) and int(readmission.kind) == int(parity.kind)
    return {
        "alarm_s": seconds(found if is_isolated else alarm) if has_alarmed else None,
        "isolated_s": seconds(parity.isolated_epoch) if is_isolated else None,
        "sensor": sensor + 1 if is_isolated else None,
        "how": _lower(Found(int(parity.how))) if is_isolated else None,
        "excluded": [k + 1 for k in range(fusion.count) if int(parity.excluded) >> k & 1] or None,
        "repaired": seconds(parity.repaired_epoch) if is_repaired else None,
        "unresolved_s": seconds(alarm) if is_open else None,
        "readmitted": readmitted + 1 if came_back else None,
        "readmitted_s": seconds(parity.readmitted_epoch) if came_back else None,
        "readmission_refused": _lower(Refusal(int(readmission.refusal))) if is_refused else None,
        "redundancy_left": bool(parity.redundancy_left),
    }


def _redundancy_lines(firmware: JsonObject) -> Iterator[str]:
    for name, kind in (firmware.get("redundancy") or {}).items():
        one = name.removesuffix("s")
        if kind["isolated_s"] is not None:
            text = f"{one} {kind['sensor']} left out at {kind['isolated_s']:.3f} s of navigation"
            text += f" (found by {FOUND_BY[kind['how'].upper()]}, alarm at {kind['alarm_s']:.3f} s)"
            if kind["repaired"] is not None:
                text += f", navigation repaired from {kind['repaired']:.0f} s on"
            yield text + ("" if kind["redundancy_left"] else "; no redundancy left")
        if kind["readmitted_s"] is not None:
            at = f"{kind['readmitted_s']:.3f} s of navigation"
            yield f"{one} {kind['readmitted']} in use again from {at} on"
        if kind["readmission_refused"] is not None:
            yield f"{one} not readmitted: {NOT_READMITTED[kind['readmission_refused'].upper()]}"
        if kind["unresolved_s"] is not None:
            yield (
                f"one of the {name} fails since {kind['unresolved_s']:.3f} s of navigation: "
                "unknown which, or none can be spared; all in use"
            )


def _calibrated_summary(ram: Records[Ram]) -> JsonObject | None:
    """Return when and how warm the sensors were calibrated, and whether that still holds.

    None where nothing is known of it. Times are seconds since navigation began.
    """
    values = FieldReader(ram, CALIBRATION_STATUS.fields).read()
    status = status_of(values)
    is_compared = any(status[name]["state"] != "not_compared" for name in KINDS)
    if not (values["date_utc_s"] or values["temperature_known"] or is_compared):
        return None
    seconds = _since_navigation(ram[0])
    for name in KINDS:
        is_drifted = status[name]["state"] == "drifted"
        since = ram[0].calibration[name].since_epoch
        status[name]["drifted_s"] = seconds(since) if is_drifted else None
    return status


def _calibrated_lines(firmware: JsonObject) -> Iterator[str]:
    calibrated = firmware.get("calibrated")
    if calibrated is None:
        return
    if words := origin_words(calibrated):
        yield f"sensors calibrated {words}"
    for name in KINDS:
        kind = calibrated[name]
        if kind["state"] == "drifted":
            yield f"{drift_words(name, kind)}, since {kind['drifted_s']:.0f} s of navigation"


def _bridging_summary(ram: Records[Ram]) -> JsonObject:
    """Return what was bridged since navigation began, and what that may have cost."""
    gaps, seconds = ram[0].bridging, int(ram[0].parameters.period_ns) * 1e-9
    arcsec = math.degrees(math.sqrt(float(gaps.angle_variance))) * 3600
    return {
        "bridged_s": round(int(gaps.bridged_epochs) * seconds, 3),
        "recent_s": round(float(gaps.recent_s), 3),
        "degraded": bool(_is_degraded(gaps)),
        "attitude_uncertainty_arcsec": round(arcsec, 3),
        "velocity_uncertainty_mps": round(math.sqrt(float(gaps.velocity_variance)), 6),
    }


def _bridging_lines(firmware: JsonObject) -> Iterator[str]:
    gaps = firmware.get("bridging")
    if gaps is not None and (gaps["degraded"] or gaps["bridged_s"] > 1):  # less does not matter
        state = "navigation degraded" if gaps["degraded"] else "navigation was degraded"
        yield (
            f"{state}: {gaps['bridged_s']:.1f} s of the sensor data bridged, attitude uncertain by "
            f"{gaps['attitude_uncertainty_arcsec']:.1f}″ for that"
        )


def _encoder_summary(ram: Records[Ram]) -> JsonObject:
    """Return what became of each axis' encoder; None for one that has always been right.

    `found_at_s` counts since power-on of the hardware, as `at_s` of a fault does.
    """
    encoders, rate_hz = ram[0].encoders, _rate_hz(ram[0])
    summary: JsonObject = dict.fromkeys(AXES)
    for k, name in enumerate(AXES):
        found_epoch = int(encoders.found_epoch[k]) - 1
        if found_epoch >= 0:
            summary[name] = {
                "found_at_s": round(found_epoch / rate_hz, 3),
                "source": _lower(AngleSource(int(encoders.source[k]))),
                "offset_deg": round(float(encoders.offset_deg[k]), 6),
            }
    return summary


def _table_lines(firmware: JsonObject) -> Iterator[str]:
    for k, axis in enumerate(AXES):
        count = firmware.get("axis_interruptions", (0, 0))[k]
        if firmware.get("axes_abandoned", (False, False))[k]:
            yield f"the {axis} axis did not follow in any try: rotation abandoned"
        elif firmware.get("axes_not_following", (False, False))[k]:
            yield f"the {axis} axis did not follow its command"
        elif count:
            times = "once" if count == 1 else f"{count} times"
            yield f"the {axis} axis did not follow its command {times}: rotation resumed"
        encoder = firmware.get("encoders", {}).get(axis)
        if encoder is not None:
            found = f"found {encoder['found_at_s']:.3f} s after power-on"
            if encoder["source"] == "encoder":
                yield f"the {axis} encoder contradicted the gyros ({found}), and is well"
            else:
                instead = _INSTEAD[encoder["source"]].format(**encoder)
                yield f"the {axis} encoder contradicts the gyros ({found}): {instead}"


FINDINGS = (
    Finding("calibrated", _calibrated_summary, _calibrated_lines),
    Finding("estimator", estimator_summary, estimator_lines),
    Finding("redundancy", redundancy_summary, _redundancy_lines),
    Finding("integrity", integrity_summary, integrity_lines),
    Finding("encoders", _encoder_summary, _table_lines),
    Finding("bridging", _bridging_summary, _bridging_lines),
)
"""All findings, in the order of their lines."""


def finding_lines(firmware: JsonObject) -> list[str]:
    """Return the lines of all findings, from the firmware's part of the summary."""
    return [line for finding in FINDINGS for line in finding.lines(firmware)]
