"""Failure modes and their rates, from a TOML file that the user owns."""

from __future__ import annotations

import difflib
import random
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from rrins.host_tools.campaigns import distributions
from rrins.host_tools.campaigns.distributions import Distribution
from rrins.host_tools.errors import RehearsalError, ScenarioError
from rrins.host_tools.files import text_of
from rrins.host_tools.hardware.fault_kinds import HardwareFault
from rrins.host_tools.integrity.phases import PHASES

FIT_PER_H = 1e-9
"""One failure in 1e9 h, per hour."""


@dataclass(frozen=True)
class FailureMode:
    """A way in which a part fails."""

    name: str
    fault: HardwareFault
    fit: float  #: failures in 1e9 h, of one part
    size: Distribution | None  #: of the kind's parameter, in the unit of its key

    def draw(self, chance: random.Random) -> float | None:
        """Return a size within the limits of the kind; None for a kind without a parameter."""
        parameter = self.fault.parameter
        if parameter is None or self.size is None:
            return None
        value = float(self.size.quantile(chance.random()))
        sign = chance.choice((1.0, -1.0)) if parameter.minimum < 0 else 1.0
        return min(max(sign * value, parameter.minimum), parameter.maximum)


@dataclass(frozen=True)
class Rates:
    """The failure modes of a unit."""

    modes: tuple[FailureMode, ...]
    phases: dict[str, float]  #: share of the operating time of each of `PHASES`


def default_text() -> str:
    """Return the TOML text of the example file."""
    return resources.files(__package__).joinpath("rates.toml").read_text(encoding="utf-8")


def load(path: Path | None = None) -> Rates:
    """Return the rates of a file; those of the example without one.

    Raises
    ------
    ScenarioError
        One line: which file, which mode, what is wrong.
    """
    name = "the example" if path is None else str(path)
    try:
        text = default_text() if path is None else text_of(path)
        table = tomllib.loads(text)
    except OSError as error:
        why = error.strerror or error
        raise ScenarioError(f"rates {name}: cannot be read: {why}") from error
    except ValueError as error:
        raise ScenarioError(f"rates {name}: not TOML: {error}") from error
    try:
        return _rates(table)
    except RehearsalError as error:
        raise ScenarioError(f"rates {name}: {error}") from error


def _rates(table: Mapping[str, Any]) -> Rates:
    _refuse_others(table, ("phases", "modes"))
    shares = table.get("phases", dict.fromkeys(PHASES, 1.0))
    if not isinstance(shares, dict):
        raise RehearsalError("phases: is not a table")
    _refuse_others(shares, PHASES, "phases.")
    phases = {name: _number(f"phases.{name}", shares.get(name, 0.0)) for name in PHASES}
    entries = table.get("modes")
    if not isinstance(entries, list) or not entries:
        raise RehearsalError("modes: is missing, a list of tables [[modes]]")
    modes = tuple(_mode(f"modes.{k}", entry) for k, entry in enumerate(entries, 1))
    names = [mode.name for mode in modes]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RehearsalError(f"modes: {twice} is there twice; give each another `name`")
    return Rates(modes, phases)


def _mode(where: str, entry: Any) -> FailureMode:
    if not isinstance(entry, dict) or not isinstance(entry.get("kind"), str):
        raise RehearsalError(f"{where}.kind: is missing, such as gyro_bias")
    word = entry["kind"]
    if word.upper() not in HardwareFault.__members__:
        near = difflib.get_close_matches(word, [kind.word for kind in HardwareFault], 1)
        hint = f", did you mean {near[0]}?" if near else "; `rrins inject --help` lists them"
        raise RehearsalError(f"{where}.kind: there is no fault {word!r} of the hardware{hint}")
    fault = HardwareFault[word.upper()]
    parameter = fault.parameter
    key = () if parameter is None else (parameter.key,)
    _refuse_others(entry, ("kind", "name", "fit", *key), f"{where}.")
    fit = _number(f"{where}.fit", entry.get("fit"))
    size = None
    if parameter is not None:
        size = _size(f"{where}.{parameter.key}", entry.get(parameter.key, parameter.default))
        for value in size.levels:
            if not parameter.minimum <= float(value) <= parameter.maximum:
                raise RehearsalError(
                    f"{where}.{parameter.key}: {value:g}, must be {parameter.minimum:g} to "
                    f"{parameter.maximum:g} {parameter.unit}"
                )
    return FailureMode(str(entry.get("name", word)), fault, fit, size)


def _number(where: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < 1e9:
        raise RehearsalError(f"{where}: {value!r} is not a number from 0 to 1e9")
    return float(value)


def _size(where: str, value: Any) -> Distribution:
    """Return the distribution of a number, a list or a text."""
    if distributions.is_distribution(value):
        found = distributions.parse(where, value)
    else:
        found = Distribution("list", tuple(value) if isinstance(value, list) else (value,))
    if not found.values or not found.is_numeric:
        raise RehearsalError(
            f"{where}: {value!r} is neither a number, a list of them nor a distribution"
        )
    return found


def _refuse_others(table: Mapping[str, Any], known: tuple[str, ...], where: str = "") -> None:
    for key in table:
        if key not in known:
            near = difflib.get_close_matches(key, known, 1)
            hint = f", did you mean {near[0]}?" if near else f"; there are {', '.join(known)}"
            raise RehearsalError(f"{where}{key}: no such key{hint}")
