"""Numbers far beyond what makes sense, in every key: one line, or a set-up that is sane."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, get_args, get_origin

import numpy as np
import pytest

from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.fault_tables import KINDS
from rrins.host_tools.scenario.keywords import paths
from rrins.host_tools.scenario.scenario import Scenario, fault_of, parse
from tests.conftest import warnings_as_errors

EXTREMES = (1e300, -1e300, 5e-324, -5e-324, math.nan, math.inf, -math.inf, 10**30)
ALL = {
    "duration_s": 10,
    "gnss": {},
    "odometer": {},
    "altimeter": {},
    "estimator": {"enabled": True},
    "integrity": {"enabled": True},
    "motion": {"kind": "drive"},
    "firmware": {"height_channel": "free"},
    "paper": {name: {"east": 1, "north": 1} for name in ("max_abs_position_error_m",)}
    | {"max_abs_velocity_error_mps": {"east": 1, "north": 1}},
}
SWAYING = {"duration_s": 10, "motion": {"kind": "sway"}}
TRANSFERRED = {"duration_s": 10, "firmware": {"initial_attitude": "transferred"}, "master": {}}


def _is_number(annotation: Any) -> bool:
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _is_number(parts[0])
    is_union = origin not in (None, Literal, tuple)
    return annotation in (int, float) or (is_union and any(map(_is_number, parts)))


NUMBERS = [path for path, (_, field) in paths().items() if _is_number(field.annotation)]


def _base(path: str) -> dict[str, Any]:
    """Return a scenario in which a key means something."""
    if "wave" in path or "roll_period" in path:
        return SWAYING
    if path.startswith("master") or (path.startswith("firmware") and "error" in path):
        return TRANSFERRED
    return ALL


def _or_words(make):
    """Return what is made, or the words of what is wrong."""
    try:
        return make()
    except ScenarioError as error:
        return str(error)


def _check(scenario: Scenario) -> None:
    """Fail unless the set-up of both sides has no number that leads to overflow."""
    run = FastRun.of(firmware_settings(scenario), hardware_settings(scenario))
    for record in (run.ram, run.plant):
        for name, values in _floats(record, ""):
            with np.errstate(invalid="ignore"):
                assert not (np.isfinite(values) & (np.abs(values) > 1e60)).any(), name


def _floats(array: Any, name: str) -> Any:
    if array.dtype.names:
        for key in array.dtype.names:
            yield from _floats(array[key], f"{name}.{key}")
    elif array.dtype.kind == "f":
        yield name, array


@pytest.mark.parametrize("path", NUMBERS)
@warnings_as_errors()
def test_an_extreme_number_is_one_line_or_sane(path):
    base = parse(_base(path), "of a test")
    for value in EXTREMES:
        made = _or_words(lambda value=value: base.varied(**{path: value}))
        if isinstance(made, Scenario):
            assert abs(value) < 1
            _check(made)
        else:
            assert path.rpartition("__")[2] in made
            assert "\n" not in made


@pytest.mark.parametrize("kind", KINDS)
def test_an_extreme_number_of_a_fault_is_one_line_or_small(kind):
    needed = {"axis": "inner"} if "axis" in KINDS[kind].model_fields else {}
    for key, field in KINDS[kind].model_fields.items():
        for value in EXTREMES if _is_number(field.annotation) else ():
            table = {"kind": kind, **needed, key: value}
            made = _or_words(lambda table=table: fault_of(table))
            assert "\n" not in made if isinstance(made, str) else abs(value) < 1
