"""What a run's summary says of the calibration in use: its date, age, temperature and drift."""

from __future__ import annotations

from rrins.compiled.record import Records
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.diagnostics.reader import FieldReader
from rrins.firmware_py.diagnostics.redundancy_identifiers import CALIBRATION_STATUS
from rrins.host_tools.diag.calibration_status import drift_words, origin_words, status_of
from rrins.host_tools.files import JsonObject
from rrins.host_tools.runs.results.redundancy_summary import KINDS


def calibrated_summary(ram: Records[Ram]) -> JsonObject | None:
    """Return when and how warm the sensors were calibrated, and whether that still holds.

    None where nothing is known of it. Times are seconds since navigation began.
    """
    values = FieldReader(ram, CALIBRATION_STATUS.fields, {}).read()
    status = status_of(values)
    is_compared = any(status[name]["state"] != "not_compared" for name in KINDS)
    if not (values["date_utc_s"] or values["temperature_known"] or is_compared):
        return None
    state = ram[0]
    rate_hz = 1e9 / int(state.parameters.period_ns)
    begun = int(state.redundancy.navigation_epoch)
    for name in KINDS:
        kind = status[name]
        since = int(state.calibration[name].since_epoch)
        is_drifted = kind["state"] == "drifted"
        kind["drifted_s"] = round((since - begun) / rate_hz, 3) if is_drifted else None
    return status


def calibrated_lines(calibrated: JsonObject | None) -> list[str]:
    """Return the lines of the summary for a person."""
    if calibrated is None:
        return []
    words = origin_words(calibrated)
    lines = [f"sensors calibrated {words}"] if words else []
    for name in KINDS:
        kind = calibrated[name]
        if kind["state"] == "drifted":
            lines.append(f"{drift_words(name, kind)}, since {kind['drifted_s']:.0f} s")
    return lines
