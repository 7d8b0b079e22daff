"""The definition of a campaign: scenario, variations, runs; from a TOML file or options."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from rrins.host_tools.campaigns import design as designs
from rrins.host_tools.campaigns.design import Plan
from rrins.host_tools.campaigns.distributions import is_distribution, with_values
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.inputs import changed, correlation_of, inputs_of
from rrins.host_tools.covariance.sources import Varied
from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.scenario.scenario import Scenario, parse, text_of
from rrins.host_tools.scenario.wrong_keys import first_line

DEFAULT_RUNS = 100
MOST_RUNS = 100_000_000


class _Correlation(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    between: tuple[str, str]
    value: float = Field(gt=-1, lt=1)


class Tolerance(BaseModel):
    """A σ of the sensors that is to be chosen, and what it costs: ``cost * (at / σ) ** power``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    key: str
    at: float = Field(gt=0, lt=1e12)
    cost: float = Field(gt=0, lt=1e12)
    """Of all sensors of the unit, in a unit of the user's, with a tolerance of `at`."""
    power: float = Field(default=1.0, gt=0, le=10)
    least: float = Field(gt=0, lt=1e12)
    most: float = Field(gt=0, lt=1e12)


class Choice(BaseModel):
    """A key of the scenario with a few values to choose from, and what each of them costs."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    key: str
    values: tuple[Any, ...] = Field(min_length=1, max_length=20)
    costs: tuple[Annotated[float, Field(ge=0, lt=1e12)], ...] = ()
    """One for each value; nothing without them."""

    @model_validator(mode="after")
    def _has_all_costs(self) -> Self:
        if self.costs and len(self.costs) != len(self.values):
            raise ValueError("costs: one for each of the values")
        return self


class Allocate(BaseModel):
    """A requirement, and what may be chosen to meet it: tolerances, and values of other keys."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    require: str
    """``p95 of horizontal_error_m <= 1000``"""
    tolerances: tuple[Tolerance, ...] = Field(default=(), max_length=40)
    choices: tuple[Choice, ...] = Field(default=(), max_length=10)

    @model_validator(mode="after")
    def _has_something_to_choose(self) -> Self:
        if not self.tolerances and not self.choices:
            raise ValueError("tolerances or choices: there are none")
        return self


class CampaignFile(BaseModel):
    """The keys of a campaign's TOML file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    title: str = Field(default="", max_length=200)
    scenario: str
    """Built-in scenario, or a file, relative to the campaign's."""
    runs: int = Field(default=DEFAULT_RUNS, ge=1, le=MOST_RUNS)
    seed: int = Field(default=1, ge=0)
    design: str = "random"
    duration_s: float | None = None
    set: dict[str, Any] = Field(default_factory=dict)
    """Keys of the scenario that all runs have, dots between table and key."""
    vary: dict[str, str] = Field(default_factory=dict)
    correlate: tuple[_Correlation, ...] = ()
    faults: tuple[dict[str, Any], ...] = ()
    """Faults beside those of the scenario; any value may be a distribution."""
    allocate: Allocate | None = None
    """For `rrins allocate`."""


@dataclass(frozen=True)
class Definition:
    """All that decides about the rows of a campaign."""

    name: str  #: of the scenario or the file that it came from
    title: str
    scenario: Scenario  #: what all runs have in common
    runs: int = DEFAULT_RUNS
    seed: int = 1
    design: str = "random"
    #: keys and distributions, those of faults included
    vary: Mapping[str, str] = field(default_factory=dict)
    correlate: tuple[tuple[str, str, float], ...] = ()
    #: beside the scenario's own; what varies of them stands in `vary`
    faults: tuple[JsonObject, ...] = ()

    @cached_property
    def plan(self) -> Plan:
        """The points of its runs.

        Raises
        ------
        CampaignError
        """
        inputs = inputs_of(self.scenario, self.vary)
        factor = correlation_of(inputs, {(a, b): value for a, b, value in self.correlate})
        designs.check(self.design, inputs, factor, self.runs)
        return Plan(self.design, inputs, factor, self.runs, self.seed)

    def varied(self) -> list[Varied]:
        """Return what varies, for a covariance analysis."""
        inputs, factor = self.plan.inputs, self.plan.factor
        return [
            Varied(one.key, one.sensor, one.distribution.moments, tuple(row))
            for one, row in zip(inputs, factor @ factor.T, strict=True)
        ]

    def scenario_of(self, run: int) -> Scenario:
        """Return the scenario of a run.

        Raises
        ------
        ScenarioError
            When what the run drew is impossible.
        """
        table = changed(self.scenario, self.plan.point(run), self.faults)
        table["seed"] = self.plan.seed(run)
        table["title"] = f"{self.title or self.name}, run {run}"[:200]
        return _checked(table)

    def check(self) -> None:
        """Refuse a campaign whose nominal run is impossible.

        Raises
        ------
        CampaignError, ScenarioError
        """
        plan = self.plan
        nominal = {one: one.distribution.nominal for one in plan.inputs}
        _checked(changed(self.scenario, nominal, self.faults))

    def with_runs(self, runs: int) -> Definition:
        """Return the same with another number of runs."""
        return replace(self, runs=runs)

    def values(self) -> JsonObject:
        """Return all that decides about the rows, as JSON has it."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        found: JsonObject = json.loads(json.dumps(values | {"scenario": self.scenario.toml()}))
        return found

    @classmethod
    def of(cls, values: JsonObject) -> Definition:
        """Return what `values` gave."""
        scenario = _checked(tomllib.loads(values["scenario"]))
        correlate = tuple((str(a), str(b), float(value)) for a, b, value in values["correlate"])
        tuples = {"correlate": correlate, "faults": tuple(values["faults"])}
        return cls(**{**values, "scenario": scenario, **tuples})


def _checked(table: JsonObject) -> Scenario:
    try:
        return Scenario.model_validate(table)
    except ValidationError as error:
        raise ScenarioError(f"campaign: {first_line(error, Scenario)}") from None


@dataclass(frozen=True)
class Wishes:
    """Options of the command line, or keywords in Python, that override a file."""

    runs: int | None = None
    seed: int | None = None
    design: str | None = None
    duration_s: float | None = None
    title: str | None = None
    set: Mapping[str, Any] = field(default_factory=dict)
    vary: Mapping[str, str] = field(default_factory=dict)
    correlate: Sequence[tuple[str, str, float]] = ()
    faults: Sequence[Mapping[str, Any]] = ()


def load(source: str | Mapping[str, Any] | Scenario, wishes: Wishes | None = None) -> Definition:
    """Return a campaign, checked.

    Parameters
    ----------
    source : str, mapping or Scenario
        A campaign's TOML file, or a scenario: built in, a file, its keys, or loaded.
    wishes : Wishes, optional

    Raises
    ------
    CampaignError, ScenarioError
    """
    wishes = wishes or Wishes()
    file, scenario, name = read(source)
    plain = ("runs", "seed", "design", "duration_s", "title")
    wished = {key: value for key in plain if (value := getattr(wishes, key)) is not None}
    file = file.model_copy(update=wished)
    settings = dict(file.set) | dict(wishes.set)
    if file.duration_s is not None:
        settings["duration_s"] = file.duration_s
    if settings:
        scenario = scenario.varied(**{k.replace(".", "__"): v for k, v in settings.items()})
    vary = dict(file.vary) | dict(wishes.vary)
    faults = _plain_faults([*file.faults, *wishes.faults], vary, len(scenario.faults))
    folder = Path(source).parent if isinstance(source, str) and Path(source).is_file() else Path()
    vary = {
        key: with_values(key, text, Path() if key in wishes.vary else folder)
        for key, text in vary.items()
    }
    pairs = [(*one.between, one.value) for one in file.correlate]
    definition = Definition(
        name=name,
        title=file.title or scenario.title if wishes.title is None else wishes.title,
        scenario=scenario,
        runs=file.runs,
        seed=file.seed,
        design=file.design,
        vary=vary,
        correlate=(*pairs, *wishes.correlate),
        faults=tuple(faults),
    )
    if wishes.runs is None and file.runs == DEFAULT_RUNS:
        definition = _with_fitting_runs(definition)
    definition.check()
    return definition


def read(source: str | Mapping[str, Any] | Scenario) -> tuple[CampaignFile, Scenario, str]:
    """Return the keys of a campaign, its scenario, and what it is called."""
    if isinstance(source, Scenario):
        return CampaignFile(scenario=""), source, "scenario"
    if isinstance(source, str):
        try:
            table, folder = tomllib.loads(text_of(source)), Path(source).parent
        except ValueError as error:
            raise ScenarioError(f"{source}: not TOML: {error}") from error
        name = Path(source).stem
    else:
        table, folder, name = dict(source), Path(), "campaign"
    if not isinstance(table.get("scenario"), str):
        return CampaignFile(scenario=""), parse(table, name, folder), name
    try:
        file = CampaignFile.model_validate(table)
    except ValidationError as error:
        raise CampaignError(f"campaign {name}: {first_line(error, CampaignFile)}") from None
    path = folder / file.scenario
    text = text_of(str(path) if path.is_file() else file.scenario)
    own = path.parent if path.is_file() else Path()
    return file, parse(tomllib.loads(text), file.scenario, own), name


def _plain_faults(
    faults: Sequence[Mapping[str, Any]], vary: dict[str, str], before: int
) -> list[JsonObject]:
    """Return faults without their distributions, which go into `vary`."""
    plain = []
    for number, fault in enumerate(faults, before + 1):
        vary |= {f"faults.{number}.{k}": v for k, v in fault.items() if is_distribution(v)}
        plain.append({k: v for k, v in fault.items() if not is_distribution(v)})
    return plain


def _with_fitting_runs(definition: Definition) -> Definition:
    """Return the campaign with one block more than its runs, where a design goes by blocks."""
    if definition.design not in ("grid", "one-at-a-time", "saltelli"):
        return definition
    inputs = inputs_of(definition.scenario, definition.vary)
    block = Plan(definition.design, inputs, correlation_of(inputs, {}), 0, 0).block
    blocks = -(-definition.runs // block) if definition.design == "saltelli" else 1
    return definition.with_runs(block * blocks)
