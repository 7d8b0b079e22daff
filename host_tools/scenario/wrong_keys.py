"""The one line that says which key of a table is wrong, in the words of whoever wrote it."""

from __future__ import annotations

import difflib
import types
from collections.abc import Iterator
from typing import Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from rrins.host_tools.scenario.fault_tables import KINDS

_LIMITS = {
    "gt": "greater than",
    "ge": "greater than or equal to",
    "lt": "less than",
    "le": "less than or equal to",
}
_LONGEST_SHOWN = 100  # letters of a wrong value


def first_line(error: ValidationError, root: type[BaseModel]) -> str:
    """Return the most telling fault that pydantic found in a model, in the words of a scenario."""
    # A misspelt key tells more than the missing one; of the readings of a value that may be one
    # thing or another, the one that got furthest.
    first = max(error.errors(), key=lambda e: (e["type"] == "extra_forbidden", len(e["loc"])))
    last = len(first["loc"]) - 1
    where = ".".join(
        str(part + 1) if isinstance(part, int) else part
        for place, part in enumerate(first["loc"])
        if isinstance(part, int)
        or (part.isidentifier() and part != "float" and (part not in KINDS or place == last))
    )
    if first["type"] == "extra_forbidden":
        near = difflib.get_close_matches(str(first["loc"][-1]), _keys(first["loc"][:-1], root), 1)
        hint = f", did you mean {near[0]}?" if near else ""
        text = f"{where}: no such key{hint}"
    elif first["type"] == "value_error":
        message = str(first["ctx"]["error"])
        text = f"{where}: {message}" if where else message
    elif first["type"] == "union_tag_invalid":
        tag = first["ctx"]["tag"]
        known = [name.strip(" '") for name in first["ctx"]["expected_tags"].split(",")]
        near = difflib.get_close_matches(tag, known, 1)
        hint = f", did you mean {near[0]}?" if near else f"; there are {', '.join(known)}"
        text = f"{where}: kind: there is no fault {tag!r}{hint}".removeprefix(": ")
    elif first["type"] == "union_tag_not_found":
        text = f"{where}: kind: is missing".removeprefix(": ")
    elif first["type"] == "missing":
        text = f"{where}: is missing"
    else:
        text = f"{where}: {_reason(first)}, got {_shown(first['input'])}"
    others = error.error_count() - 1
    return f"{text} (and {others} more)" if others else text


def _reason(error: ErrorDetails) -> str:
    """Return pydantic's reason; limits in the shortest way."""
    for limit, words in _LIMITS.items():
        if limit in error.get("ctx", {}):
            return f"input should be {words} {error['ctx'][limit]:.12g}"
    return f"{error['msg'][0].lower()}{error['msg'][1:]}"


def _shown(value: object) -> str:
    """Return a value of a file for a message: its beginning, if it is long."""
    text = repr(value)
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]} …"


def _keys(location: tuple[int | str, ...], root: type[BaseModel]) -> list[str]:
    """Return the keys that a table of the model can have."""
    models = [root]
    for part in location:
        if part in KINDS:
            models = [KINDS[str(part)]]
            continue
        fields = [m.model_fields[str(part)] for m in models if part in m.model_fields]
        found = [t for f in fields for t in tables_in(f.annotation, in_arrays=True)]
        models = found or models
    return [key for model in models for key in model.model_fields]


def tables_in(annotation: object, *, in_arrays: bool = False) -> Iterator[type[BaseModel]]:
    """Yield the tables that a key may hold."""
    if in_arrays or get_origin(annotation) in (Union, types.UnionType):
        for member in get_args(annotation):
            yield from tables_in(member, in_arrays=in_arrays)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
