"""The numbers of the diagnostics as C: `rrins_diagnostics.h`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from rrins.dbc.contract import SENSOR_GROUPS
from rrins.dbc.values import AxisCommand, AxisState
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.modes.modes import FirmwareFault
from rrins.firmware_py.core.monitoring.monitor import COUNTER_CEILING, COUNTER_ONE
from rrins.firmware_py.core.records.diagnostic_records import (
    ATTENTION_FRAMES,
    ATTENTION_TROUBLES,
    RoutineRequest,
)
from rrins.firmware_py.core.records.initial_attitude import (
    LEAST_HEADING,
    LEAST_LEVEL,
    InitialAttitude,
)
from rrins.firmware_py.core.records.memory import SCHEME_CAPACITY, Ram
from rrins.firmware_py.core.records.redundancy_records import ReadmissionOrder, ReadmissionState
from rrins.firmware_py.core.records.trouble_table import TROUBLES
from rrins.firmware_py.core.records.troubles import (
    AGING_CYCLES,
    ALL_GROUPS,
    CLEARED_STATUS,
    FORMAT_IDENTIFIER,
    STATUS_AVAILABILITY,
    Status,
    SystemFault,
)
from rrins.firmware_py.core.redundancy import drift_settings
from rrins.firmware_py.core.sensors.calibration import ARCSEC, DPH, PPM, UG
from rrins.firmware_py.core.sensors.fusion import GAIN_LIMIT, WEIGHT_RATIO_LIMIT
from rrins.firmware_py.core.settings import Settings
from rrins.firmware_py.core.turntable.table_sums import ORIENTATIONS, TURNS
from rrins.firmware_py.diagnostics import (
    access,
    fault_memory,
    node,
    regions,
    server,
    store,
    table,
    transport,
)
from rrins.firmware_py.diagnostics.calibration_record import (
    AT_REST,
    HEAD,
    RECORD_ADDRESS,
    CalibrationEnd,
)
from rrins.firmware_py.diagnostics.codecs import Field
from rrins.firmware_py.diagnostics.computer import IDENTITY, NO_BOUND
from rrins.firmware_py.diagnostics.identifiers import READINGS
from rrins.firmware_py.diagnostics.last_second import LAST_SECOND
from rrins.firmware_py.diagnostics.parameters import (
    ACCELEROMETER_CALIBRATIONS,
    ACCELEROMETER_SIGMAS,
    CALIBRATED,
    GYRO_CALIBRATIONS,
    GYRO_SIGMAS,
    LASTING,
    PARAMETERS,
    SETTINGS,
)
from rrins.firmware_py.diagnostics.responses import Code
from rrins.firmware_py.diagnostics.routines import RoutineState
from rrins.firmware_py.diagnostics.services import calibration, programmes, table_calibration
from rrins.firmware_py.diagnostics.services.data import MOST_IDENTIFIERS
from rrins.host_tools.builds.derived import DERIVED
from rrins.host_tools.builds.images import Images

BY_NUMBER = sorted(PARAMETERS, key=lambda parameter: parameter.number)
"""The parameters in the order of C."""

_NS_PER_MS = 1_000_000


def special_names() -> list[str]:
    """Return the fields that the server computes, those of the identification last."""
    names = [
        field.name
        for did in READINGS
        for field in did.fields
        if not field.source and field.name not in LAST_SECOND and field.name not in IDENTITY
    ]
    return [*names, *IDENTITY]


def header(images: Images, choices: int, segments: int) -> str:
    """Return the header.

    Parameters
    ----------
    choices, segments : int
        Lengths of these tables.
    """
    settings = images.settings
    lines = [
        "/* The numbers of the diagnostics; written by `rrins build`. */",
        "#ifndef RRINS_DIAGNOSTICS_H",
        "#define RRINS_DIAGNOSTICS_H",
        "",
    ]
    numbers = _numbers(settings) | {"CHOICES": choices, "MEMORY_SEGMENTS": segments}
    numbers |= _indices() | _offsets()
    lines += [f"#define {name} {_literal(value)}" for name, value in numbers.items()]
    lines += _lists(settings)
    lines += _enum("special", "SPECIAL", special_names())
    lines += _enum("routine_index", "ROUTINE", (routine.name for routine in table.ROUTINES))
    return "\n".join((*lines, "", "#endif", ""))


def _literal(value: int | float) -> str:
    if isinstance(value, int):
        return str(value) if value < 1 << 31 else f"INT64_C({value})"
    return value.hex()


def _enum(name: str, prefix: str, members: Iterable[str]) -> list[str]:
    lines = (f"    {prefix}_{member.upper()}," for member in members)
    return [f"enum {name} {{", *lines, "};"]


def _numbers(settings: Settings) -> dict[str, float]:
    """Return what is defined, by name."""
    period_ns = 1_000_000_000 // settings.rate_hz
    fed = transport.most_fed(period_ns)
    return {
        "RATE_HZ": settings.rate_hz,
        "PERIOD_NS": period_ns,
        "SENSORS": SENSOR_GROUPS,
        "GYROS": len(settings.gyro_axes_deg),
        "ACCELEROMETERS": len(settings.accelerometer_axes_deg),
        "IS_REDUNDANT": int(settings.redundancy is not None),
        "SCHEME_CAPACITY": SCHEME_CAPACITY,
        "MEMORY_BYTES": Ram.dtype.itemsize,
        "IDENTIFIERS": len(table.IDENTIFIERS),
        "PARAMETERS": len(PARAMETERS),
        "PARAMETER_SIZE": max(parameter.layout.size for parameter in PARAMETERS),
        "SERVICES": len(table.SERVICES),
        "ROUTINES": len(table.ROUTINES),
        "TROUBLES": len(TROUBLES),
        "SNAPSHOT_IDENTIFIERS": len(table.SNAPSHOT),
        "IDENTITIES": len(IDENTITY),
        "SILENCED_IDS": len(node.SILENCED),
        "TABLE_CRC32": table.crc32(),
        "REQUEST_ID": table.request_id(),
        "FUNCTIONAL_ID": table.functional_id(),
        "RESPONSE_ID": table.response_id(),
        "SLOTS": transport.slots_per_epoch(period_ns),
        "FED_FRAMES": fed,
        "WAITING_FRAMES": fed * transport.WAITING_EPOCHS,
        "REQUESTS": transport.REQUESTS,
        "N_BS_NS": access.N_BS_MS * _NS_PER_MS,
        "N_CR_NS": access.N_CR_MS * _NS_PER_MS,
        "S3_NS": access.S3_MS * _NS_PER_MS,
        "ATTEMPT_DELAY_NS": access.ATTEMPT_DELAY_MS * _NS_PER_MS,
        "PENDING_NS": round(server.PENDING_SHARE * access.P2_MS * _NS_PER_MS),
        "PENDING_AGAIN_NS": round(server.PENDING_SHARE * access.P2_STAR_MS * _NS_PER_MS),
        "LONG_SENDING_NS": node.LONG_SENDING_NS,
        **{
            name: getattr(access, name)
            for name in (
                "P2_MS", "P2_STAR_MS", "ST_MIN_MS", "BLOCK_SIZE", "PADDING", "MESSAGE_CAPACITY",
                "SEED_SIZE", "KEY_SIZE", "ATTEMPTS",
            )
        },
        "MOST_IDENTIFIERS": MOST_IDENTIFIERS,
        "CALIBRATION_ADDRESS": regions.CALIBRATION_ADDRESS,
        "CALIBRATION_CAPACITY": regions.CALIBRATION_CAPACITY,
        "BLOCK_LENGTH": regions.BLOCK_LENGTH,
        "RECORD_ADDRESS": RECORD_ADDRESS,
        "FAULT_CAPACITY": fault_memory.CAPACITY,
        "FAULT_LAYOUT": fault_memory.LAYOUT,
        "STORE_VERSION": store.VERSION,
        "STORE_PAGE": store.PAGE,
        "STORE_HEAD": store.IMAGE,
        "COUNTER_ONE": COUNTER_ONE,
        "COUNTER_FAILED": COUNTER_CEILING // COUNTER_ONE,
        "AGING_CYCLES": AGING_CYCLES,
        "ALL_GROUPS": ALL_GROUPS,
        "CLEARED_STATUS": CLEARED_STATUS,
        "FORMAT_IDENTIFIER": FORMAT_IDENTIFIER,
        "STATUS_AVAILABILITY": STATUS_AVAILABILITY,
        "ATTENTION_FRAMES": ATTENTION_FRAMES,
        "ATTENTION_TROUBLES": ATTENTION_TROUBLES,
        "DPH": DPH,
        "UG": UG,
        "PPM": PPM,
        "ARCSEC": ARCSEC,
        "DEGREE": math.radians(1.0),
        "NO_BOUND": NO_BOUND,
        "EARTH_RATE": earth.RATE,
        "WEIGHT_RATIO_LIMIT": WEIGHT_RATIO_LIMIT,
        "GAIN_LIMIT": GAIN_LIMIT,
        "LEAST_LEVEL": LEAST_LEVEL,
        "LEAST_HEADING": LEAST_HEADING,
        "ARRIVED_DEG": programmes.ARRIVED_DEG,
        "GRACE_S": programmes.GRACE_S,
        "MISSING_SHARE": calibration.MISSING_SHARE,
        "AT_REST_S": AT_REST,
        "HEAD_NUMBERS": len(HEAD),
        "SUM_ORIENTATIONS": ORIENTATIONS,
        "SUM_TURNS": TURNS,
        **{
            name: getattr(table_calibration, name)
            for name in (
                "SETTLE_S", "WATCH_EPOCHS", "MISSING_S", "MOVED_S", "TURN_LIMIT", "FORCE_LIMIT",
            )
        },
        "FAULT_COPY_DAMAGED": SystemFault.PARAMETER_COPY_DAMAGED.value,
        "FAULT_PARAMETERS_LOST": SystemFault.PARAMETERS_LOST.value,
        "FAULT_OUT_OF_LIMITS": SystemFault.PARAMETER_OUT_OF_LIMITS.value,
        "FAULT_SELF_TEST_FAILED": FirmwareFault.SELF_TEST_FAILED.value,
        "COMMAND_POSITION": AxisCommand.POSITION.value,
        "COMMAND_HOLD": AxisCommand.HOLD.value,
        "READMISSION_TESTING": ReadmissionState.TESTING.value,
        **{code.name: code.value for code in Code},
        **{f"SESSION_{one.name}": one.value for one in access.Session},
        **{f"STATUS_{one.name}": one.value for one in Status},
        **{f"AXIS_{one.name}": one.value for one in AxisState},
        **{f"REQUEST_{one.name}": one.value for one in RoutineRequest},
        **{f"ORDER_{one.name}": one.value for one in ReadmissionOrder},
        **{f"END_{one.name}": one.value for one in CalibrationEnd},
        **{f"METHOD_{one.name}": one.value for one in InitialAttitude},
        "DERIVED": len(DERIVED),
        **{f"DERIVED_{name.upper()}": index for index, name in enumerate(DERIVED)},
    }  # fmt: skip


def _indices() -> dict[str, float]:
    """Return where parameters stand in the table; of those by sensor the first."""
    found: dict[str, float] = {
        f"P_{one.name.upper()}": BY_NUMBER.index(one) for one in (*SETTINGS, CALIBRATED)
    }
    for name, ones in (
        ("GYRO_CALIBRATION", GYRO_CALIBRATIONS),
        ("GYRO_SIGMA", GYRO_SIGMAS),
        ("ACCELEROMETER_CALIBRATION", ACCELEROMETER_CALIBRATIONS),
        ("ACCELEROMETER_SIGMA", ACCELEROMETER_SIGMAS),
    ):
        found[f"P_{name}"] = BY_NUMBER.index(ones[0])
    for did in READINGS:
        if did.control is not None:
            found[f"DID_{did.name.upper()}"] = did.number
    return found


def _offsets() -> dict[str, float]:
    """Return where values stand in the records of parameters and in routines' arguments."""
    records: list[tuple[str, Sequence[Field]]] = [
        *((one.name, one.fields) for one in (*SETTINGS, CALIBRATED)),
        ("calibration", ACCELEROMETER_CALIBRATIONS[0].fields),
        *((one.name, one.arguments) for one in table.ROUTINES),
    ]
    found: dict[str, float] = {}
    for name, fields in records:
        at = 0
        for field in fields:
            found[f"AT_{name}_{field.name}".upper()] = at
            at += field.size
    found["LASTING_BEGIN"] = found[f"AT_CALIBRATION_{LASTING[0][0]}".upper()]
    found["LASTING_END"] = found[f"AT_CALIBRATION_{LASTING[-1][0]}".upper()] + 8
    return found


def _lists(settings: Settings) -> list[str]:
    """Return initialisers of short lists."""
    stability, limits = [0.0, 0.0], [0.0, 0.0]
    if settings.redundancy is not None:
        allowed = settings.redundancy.false_alarms_per_1000_h
        sheets = settings.redundancy.gyros, settings.redundancy.accelerometers
        stability = [sheet.scale_stability for sheet in sheets]
        limits = [
            drift_settings.kind_limit(allowed, len(axes))
            for axes in (settings.gyro_axes_deg, settings.accelerometer_axes_deg)
        ]
    outcomes = [programmes.OUTCOMES[one] for one in ReadmissionState]
    names = {RoutineState.DONE: "FINISHED"}
    lists: Mapping[str, Iterable[str]] = {
        "SCALE_STABILITY": map(float.hex, map(float, stability)),
        "DRIFT_LIMIT": map(float.hex, map(float, limits)),
        "READMISSION_OUTCOMES": (names.get(one, one.name) for one in outcomes),
        "SECRET": map(str, access.DEFAULT_SECRET),
        "STORE_MAGIC": map(str, store.MAGIC),
        "SILENT_WHEN_FUNCTIONAL": map(str, map(int, sorted(server.SILENT_WHEN_FUNCTIONAL))),
    }
    return [f"#define {name} {{{', '.join(values)}}}" for name, values in lists.items()]
