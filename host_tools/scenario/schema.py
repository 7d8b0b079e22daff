"""The JSON schema of scenarios: keys with meaning, unit, limits and default, for editors."""

from __future__ import annotations

import ast
import functools
import inspect
import textwrap
from collections.abc import Iterator

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from rrins.host_tools.hardware.units import split
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.wrong_keys import tables_in


class _ForEditors(GenerateJsonSchema):
    """Keys with what they mean; without what TOML cannot say and defaults that are tables."""

    def model_schema(self, schema: core_schema.ModelSchema) -> JsonSchemaValue:
        found = super().model_schema(schema)
        for key, of_key in found["properties"].items():
            of_key["description"] = description(schema["cls"], key)
            if isinstance(of_key.get("default", {}), dict | None):
                of_key.pop("default", None)
        return found

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def field_title_should_be_set(self, schema: object) -> bool:
        return False


def json_schema() -> JsonSchemaValue:
    """Return the JSON schema of a scenario's file."""
    found = Scenario.model_json_schema(schema_generator=_ForEditors)
    return {"$schema": _ForEditors.schema_dialect} | found


def description(table: type[BaseModel], key: str) -> str:
    """Return what a key of a table means, and its unit."""
    symbol = split(key)[1].symbol
    return f"{meaning(table, key)} Unit: {symbol}." if symbol else meaning(table, key)


def meaning(table: type[BaseModel], key: str) -> str:
    """Return what a key means: the text below it, or what the table that it holds is."""
    field = table.model_fields[key]
    own = field.description or next(
        (d[key] for d in map(_docstrings, _models(table)) if key in d), None
    )
    return own or next((inspect.getdoc(one) or "" for one in tables_in(field.annotation)), "")


def _models(table: type[BaseModel]) -> Iterator[type[BaseModel]]:
    return (c for c in table.__mro__ if issubclass(c, BaseModel) and c is not BaseModel)


@functools.cache
def _docstrings(table: type[BaseModel]) -> dict[str, str]:
    """Return the text below each key of a class; nothing of one that was made by a call."""
    try:
        source = inspect.getsource(table)
    except (OSError, TypeError):
        return {}
    (body,) = ast.parse(textwrap.dedent(source)).body
    assert isinstance(body, ast.ClassDef)
    found: dict[str, str] = {}
    for before, line in zip(body.body, body.body[1:], strict=False):
        if (
            isinstance(before, ast.AnnAssign)
            and isinstance(before.target, ast.Name)
            and isinstance(line, ast.Expr)
            and isinstance(line.value, ast.Constant)
        ):
            found[before.target.id] = " ".join(str(line.value.value).split())
    return found
