"""Forms of all faults that can be injected live: the kinds and keys of `rrins inject`."""

from __future__ import annotations

from typing import Any, Final

from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware.fault_kinds import HardwareFault, Part
from rrins.host_tools.scenario.fault_tables import KINDS
from rrins.host_tools.wire.fault_kinds import FaultKind

_GROUPS: Final = {Part.AXIS: "turntable", Part.GYRO: "gyros", Part.ACCELEROMETER: "accelerometers"}
_NOT_LIVE: Final = ("kind", "at_s")
_LAST: Final = ("for_s", "period_s", "duty")


def fault_forms() -> JsonObject:
    """Return each kind's form: group, effect; key, type, default and limits of each field."""
    forms = {}
    for kind, table in KINDS.items():
        schema = table.model_json_schema()
        keys = [key for key in table.model_fields if key not in (*_NOT_LIVE, *_LAST)]
        keys += [key for key in _LAST if key in table.model_fields]
        fields = [_field(key, schema["properties"][key], key in schema["required"]) for key in keys]
        forms[kind] = {**_described(kind.upper()), "fields": fields}
    return forms


def _described(name: str) -> JsonObject:
    hardware = HardwareFault.__members__.get(name)
    if hardware is None:
        return {"group": "on the wire", "text": FaultKind[name].effect}
    return {"group": _GROUPS.get(hardware.part, "aiding"), "text": hardware.effect}


def _field(key: str, schema: Any, is_needed: bool) -> JsonObject:
    """Return a field from the JSON schema of a key."""
    value = schema.get("anyOf", [schema])[0]
    form: JsonObject = {"key": key, "default": schema.get("default"), "is_needed": is_needed}
    if "enum" in value:
        return form | {"type": "choice", "choices": value["enum"]}
    if value["type"] == "string":
        return form | {"type": "message"}
    limits = {
        name: value[key]
        for name, keys in (
            ("minimum", ("minimum", "exclusiveMinimum")),
            ("maximum", ("maximum", "exclusiveMaximum")),
        )
        for key in keys
        if key in value
    }
    return form | {"type": "whole" if value["type"] == "integer" else "number"} | limits
