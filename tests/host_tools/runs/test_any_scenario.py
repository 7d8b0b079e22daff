"""Whatever a scenario may say, it runs: built-in scenarios with random keys, by their schema.

`RRINS_SCENARIOS=2000 pytest -m soak tests/host_tools/runs/test_any_scenario.py` draws more.
"""

from __future__ import annotations

import json
import os
import random

import pytest

import rrins
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.runs.direct import run_direct, run_without_frames
from rrins.host_tools.runs.set_up.settings import scenario_wire
from rrins.host_tools.scenario import scenario as scenarios
from rrins.host_tools.scenario.scenario import Scenario

SCENARIOS = int(os.environ.get("RRINS_SCENARIOS", "200"))
SCHEMA = Scenario.model_json_schema()
KEPT = {"title", "description", "bus", "xcp", "paper", "duration_s", "seed"}
LONGEST_S = 900  # with the alignment


def shape(schema):
    while "$ref" in schema:
        schema = SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]]
    return schema


def number(chance, schema, usual):
    least = schema.get("minimum", schema.get("exclusiveMinimum", -1e4))
    most = schema.get("maximum", schema.get("exclusiveMaximum", 1e4))
    choices = [least, most, chance.uniform(least, most), 10.0 ** chance.uniform(-6, 4)]
    if isinstance(usual, (int, float)):
        choices += [usual * 10 ** chance.uniform(-1.5, 1.5) for _ in range(4)]
    value = min(max(chance.choice(choices), least), most)
    if value == schema.get("exclusiveMinimum"):
        value += 1e-9
    return round(value) if schema["type"] == "integer" else value


def drawn(chance, schema, usual=None):
    """Return a value of a schema; numbers often near the usual one."""
    schema = shape(schema)
    for key in ("anyOf", "oneOf"):
        if key in schema:
            kinds = [one for one in schema[key] if shape(one).get("type") != "null"]
            return drawn(chance, chance.choice(kinds), usual)
    if "enum" in schema or "const" in schema:
        return chance.choice(schema.get("enum", [schema.get("const")]))
    usual = schema.get("default") if usual is None else usual
    match schema.get("type"):
        case "boolean":
            return chance.random() < 0.5
        case "number" | "integer":
            return number(chance, schema, usual)
        case "array":
            least = schema.get("minItems", 0)
            items = schema.get("prefixItems") or [schema["items"]] * chance.randint(
                least, least + 3
            )
            return [drawn(chance, item) for item in items]
        case "object":
            wanted = schema.get("required", [])
            keys = schema.get("properties", {}).items()
            some = [(key, one) for key, one in keys if key in wanted or chance.random() < 0.25]
            return {key: drawn(chance, one) for key, one in some}
    return usual


def changed(chance, table):
    for _ in range(chance.randint(1, 6)):
        key = chance.choice(sorted(SCHEMA["properties"].keys() - KEPT))
        schema, own = shape(SCHEMA["properties"][key]), table.get(key)
        tables = [one for one in map(shape, schema.get("anyOf", [schema])) if "properties" in one]
        if isinstance(own, dict) and tables:
            inner = chance.choice(sorted(tables[0]["properties"]))
            own[inner] = drawn(chance, tables[0]["properties"][inner], own.get(inner))
        else:
            table[key] = drawn(chance, schema, own)
    return table | {"duration_s": chance.choice((30, 60, 120)), "seed": chance.randrange(1 << 30)}


@pytest.mark.soak
def test_what_is_accepted_runs_and_stays_finite(tmp_path):
    names, ran = sorted(rrins.scenario_names()), 0
    for number_of_case in range(5 * SCENARIOS):
        chance = random.Random(f"any {number_of_case}")
        base = rrins.load_scenario(chance.choice(names))
        table = changed(chance, base.model_dump(exclude_unset=True, mode="json"))
        try:
            scenario = scenarios.parse(table, f"case {number_of_case}")
        except RehearsalError:
            continue
        if scenario.epochs > LONGEST_S * scenario.rate_hz:
            continue
        path = tmp_path / "scenario.toml"
        path.write_text(scenario.toml(), encoding="utf-8")  # of the one that fails
        way = run_without_frames if scenario_wire(scenario) is None else run_direct
        try:
            outcome = way(scenario, tmp_path)
        except RehearsalError as error:
            print(number_of_case, error)
            continue
        ran += 1
        assert "NaN" not in json.dumps(outcome.firmware, default=str)
    assert ran > SCENARIOS // 5
