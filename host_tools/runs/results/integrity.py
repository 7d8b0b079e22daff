"""The integrity in a run's summary: the bounds of the error at the end, and what set them."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rrins.compiled.record import Records
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.records.estimator_records import ESTIMATOR_HISTORY_S
from rrins.firmware_py.core.records.integrity_records import (
    ACCELEROMETERS_SHIFT,
    ALL_ACCELEROMETERS,
    ALL_GYROS,
    ALTIMETER_DRIFT,
    ALTIMETER_FAULT,
    GNSS_DRIFT,
    GYROS_SHIFT,
    HEADING,
    HORIZONTAL,
    ODOMETER_FAULT,
    TABLE_FAULT,
    VERTICAL,
    IntegrityStatus,
)
from rrins.firmware_py.core.records.memory import Ram
from rrins.host_tools.files import JsonObject
from rrins.host_tools.rounding import rounded

_OTHERS = {
    ODOMETER_FAULT: "odometer",
    ALTIMETER_FAULT: "altimeter",
    ALTIMETER_DRIFT: "altimeter drift",
    ALL_GYROS: "all gyros",
    ALL_ACCELEROMETERS: "all accelerometers",
    GYROS_SHIFT: "bias of all gyros",
    ACCELEROMETERS_SHIFT: "bias of all accelerometers",
}


def fault_name(number: int) -> str | None:
    """Return the name of the fault that sets a bound; None where none does."""
    if number < 0:
        return None
    if number == TABLE_FAULT:
        return "table"
    kind, sensor = divmod(number, SENSOR_GROUPS)
    if kind < 2:
        return f"{('gyro', 'accelerometer')[kind]} {sensor + 1}"
    if sensor >= ODOMETER_FAULT:
        return _OTHERS[sensor]
    return "GNSS drift" if sensor >= GNSS_DRIFT else "GNSS position"


def integrity_summary(ram: Records[Ram]) -> JsonObject | None:
    """Return the last bounds, and how long each status lasted; None without integrity."""
    integrity = ram[0].integrity
    if not integrity.enabled:
        return None
    estimator = ram[0].estimator
    last = estimator.history[(int(estimator.history_count) - 1) % ESTIMATOR_HISTORY_S]
    bounds = [float(bound) for bound in last["protection"]]
    found = [round(bound, 4) if math.isfinite(bound) else None for bound in bounds]
    counts = [int(count) for count in integrity["counts"]]
    total = max(1, sum(counts))
    return {
        "status": IntegrityStatus(int(last.integrity)).name.lower(),
        "horizontal_protection_m": found[HORIZONTAL],
        "vertical_protection_m": found[VERTICAL] if estimator.vertical else None,
        "heading_protection_deg": (
            round(math.degrees(bounds[HEADING]), 6) if found[HEADING] is not None else None
        ),
        "limited_by": [fault_name(int(number)) for number in last["limit"]],
        "suspected": bool(integrity.suspected),
        "available_share": round(counts[IntegrityStatus.AVAILABLE] / total, 6),
        "degraded_share": round(counts[IntegrityStatus.DEGRADED] / total, 6),
    }


def integrity_lines(firmware: JsonObject) -> Iterator[str]:
    """Yield the lines for a person, from the firmware's part of the summary."""
    found = firmware.get("integrity")
    if found is None:
        return
    level, heading = found["horizontal_protection_m"], found["heading_protection_deg"]
    bounds = "no bound" if level is None else f"{rounded(level)} m horizontally"
    if found["vertical_protection_m"] is not None:
        bounds += f", {rounded(found['vertical_protection_m'])} m in height"
    if heading is not None:
        bounds += f", {rounded(heading)}° in heading"
    yield (
        f"integrity: {found['status'].replace('_', ' ')} at the end, protection levels {bounds}; "
        f"available for {rounded(100 * found['available_share'], 4)} % of the navigation"
    )
