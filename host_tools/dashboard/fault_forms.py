"""Forms of all faults that can be injected live: the kinds and keys of `rrins inject`."""

from __future__ import annotations

from typing import Any, Final, get_args

from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware.fault_values import VALUES
from rrins.host_tools.hardware.faults import HardwareFault
from rrins.host_tools.hardware.tables import TomlTable
from rrins.host_tools.scenario.fault_tables import KINDS, FaultOnWire

_OF_KIND: Final = {
    "delay_s": ("delay",),
    "frames_per_epoch": ("babble",),
    "bit": ("corrupt",),
    "direction": ("gnss_jump", "gnss_pull"),
}
"""Keys that are for some kinds only, beside the values of hardware faults."""

_NOT_LIVE: Final = ("kind", "at_s")
_LAST: Final = ("for_s", "period_s", "duty")


def _limits(field: Any) -> JsonObject:
    found = {}
    for one in field.metadata:
        for name, key in (
            ("ge", "minimum"),
            ("gt", "minimum"),
            ("le", "maximum"),
            ("lt", "maximum"),
        ):
            if hasattr(one, name):
                found[key] = getattr(one, name)
    return found


def _choices(annotation: Any) -> list[str] | None:
    """Return the words of a `Literal`, or of one that may be missing."""
    for part in (annotation, *get_args(annotation)):
        words = get_args(part)
        if words and all(isinstance(word, str) for word in words):
            return list(words)
    return None


def _is_whole(annotation: Any) -> bool:
    return annotation is int or int in get_args(annotation)


def _field(kind: str, key: str, field: Any) -> JsonObject:
    choices = _choices(field.annotation)
    is_text = field.annotation is str or str in get_args(field.annotation)
    form: JsonObject = {
        "key": key,
        "default": None if field.is_required() else field.default,
        "is_needed": field.is_required(),
    }
    if choices is not None:
        return form | {"type": "choice", "choices": choices}
    if is_text:
        return form | {"type": "message"}
    limits = _limits(field)
    hardware = HardwareFault.__members__.get(kind.upper())
    if hardware in VALUES and VALUES[hardware].key == key:
        limits = {"minimum": VALUES[hardware].minimum, "maximum": VALUES[hardware].maximum}
    return form | {"type": "whole" if _is_whole(field.annotation) else "number"} | limits


def _is_for(kind: str, key: str, table: type[TomlTable]) -> bool:
    if key in _NOT_LIVE:
        return False
    if key in _OF_KIND:
        return kind in _OF_KIND[key]
    if table is FaultOnWire:
        return True
    valued = [k.name.lower() for k, value in VALUES.items() if value.key == key]
    return kind in valued if valued else True


def fault_forms() -> JsonObject:
    """Return the fields of each kind's form: key, type, default and limits."""
    forms = {}
    for kind, table in KINDS.items():
        keys = [key for key in table.model_fields if _is_for(kind, key, table)]
        keys.sort(key=lambda key: _LAST.index(key) if key in _LAST else -1)
        forms[kind] = [_field(kind, key, table.model_fields[key]) for key in keys]
    return forms
