"""Distributions of a key, as a person writes them: ``normal(0, 0.1)``, ``list(1, 2, 5)``, ….

Every distribution is a function of one number in (0, 1), its quantile: so that one set of points,
drawn at random, by Latin hypercube or by Sobol's sequence, serves them all.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from rrins.host_tools.campaigns.errors import CampaignError

Value = float | int | str | bool
"""A value of a scenario's key."""

_CALL = re.compile(r"\s*(\w+)\s*\(([^()]*)\)\s*(.*)\Z", re.DOTALL)
_CORRELATED = re.compile(r"correlated\s*\(?\s*([-+.\deE]+)\s*\)?\Z")
_NUMBER_OF_VALUES: Final = {
    "normal": 2,
    "uniform": 2,
    "loguniform": 2,
    "lognormal": 2,
    "truncated": 4,
    "steps": 3,
}
_KINDS: Final = (*_NUMBER_OF_VALUES, "list", "empirical")
_MOST_STEPS = 100_000
_MOST_MEASURED = 10_000


def cumulative_normal(z: float) -> float:
    """Return the probability that a standard normal number is below `z`."""
    return 0.5 * math.erfc(-z / math.sqrt(2.0))


def normal_quantile(probability: float) -> float:
    """Return the standard normal number below which another one is with a probability."""
    from scipy.special import ndtri

    return float(ndtri(probability))


@dataclass(frozen=True)
class Distribution:
    """The distribution of a key."""

    kind: str
    #: mean and standard deviation; lower and upper limit; mean, standard deviation of the normal
    #: distribution and its limits; median and standard deviation of the logarithm; or the values
    #: that are equally likely, or that were measured
    values: tuple[Value, ...]
    is_common: bool = False  #: whether all sensors get one value; else each its own
    correlation: float = 0.0  #: between the values of two sensors

    def quantile(self, probability: float) -> Value:
        """Return the value below which another one is with a probability between 0 and 1."""
        if self.kind == "list":
            return self.values[min(int(probability * len(self.values)), len(self.values) - 1)]
        if self.kind == "empirical":
            return float(np.quantile(self._numbers, probability))
        first, second, *limits = self._numbers
        if self.kind == "uniform":
            return first + (second - first) * probability
        if self.kind == "lognormal":
            return first * math.exp(second * normal_quantile(probability))
        if self.kind == "loguniform":
            return float(first * (second / first) ** probability)
        if self.kind == "normal":
            return first + second * normal_quantile(probability)
        low, high = (cumulative_normal((limit - first) / second) for limit in limits)
        z = normal_quantile(low + (high - low) * probability)
        return min(max(first + second * z, limits[0]), limits[1])

    @property
    def _numbers(self) -> tuple[float, ...]:
        return tuple(float(value) for value in self.values)

    @property
    def is_numeric(self) -> bool:
        """Whether its values are numbers."""
        return all(isinstance(v, float | int) and not isinstance(v, bool) for v in self.values)

    @property
    def stored_as(self) -> str:
        """The type of its column: ``int64``, ``double``, ``bool`` or ``string``."""
        types = {type(value) for value in self.values}
        if self.kind == "list" and len(types) == 1:
            return {int: "int64", float: "double", bool: "bool", str: "string"}[types.pop()]
        return "double" if self.is_numeric else "string"

    @property
    def levels(self) -> tuple[Value, ...]:
        """The values of a sweep: a list's own, the limits of a uniform distribution, else ± 1 σ."""
        if self.kind in ("list", "uniform", "loguniform"):
            return self.values
        return self.quantile(cumulative_normal(-1.0)), self.quantile(cumulative_normal(1.0))

    @property
    def nominal(self) -> Value:
        """The value while another key is swept: the median, the first of a list."""
        return self.values[0] if self.kind == "list" else self.quantile(0.5)

    @property
    def moments(self) -> tuple[float, float]:
        """Mean and standard deviation; NaN for words."""
        if not self.is_numeric:
            return math.nan, math.nan
        if self.kind == "list":
            return float(np.mean(self._numbers)), float(np.std(self._numbers))
        if self.kind == "empirical":
            return float(np.mean(self._numbers)), float(np.std(self._numbers, ddof=1))
        first, second, *limits = self._numbers
        if self.kind == "lognormal":
            mean = first * math.exp(0.5 * second**2)
            return mean, mean * math.sqrt(math.expm1(second**2))
        if self.kind == "uniform":
            return (first + second) / 2.0, (second - first) / math.sqrt(12.0)
        if self.kind == "loguniform":
            width = math.log(second / first)
            mean = (second - first) / width
            return mean, math.sqrt((second**2 - first**2) / (2.0 * width) - mean**2)
        if self.kind == "normal":
            return first, second
        from scipy.stats import truncnorm

        cut = truncnorm(*((limit - first) / second for limit in limits), first, second)
        return float(cut.mean()), float(cut.std())

    def text(self) -> str:
        """Return it as a person writes it."""
        words = [f"{self.kind}({', '.join(_written(v) for v in self.values)})"]
        if self.is_common:
            words.append("common")
        if self.correlation:
            words.append(f"correlated {self.correlation:g}")
        return " ".join(words)


def _written(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return value if isinstance(value, str) else repr(value)


def _value(text: str) -> Value:
    """Return a number, a truth value or a word."""
    word = text.strip().strip("\"'")
    if word in ("true", "false"):
        return word == "true"
    for kind in (int, float):
        try:
            return kind(word)
        except ValueError:
            continue
    return word


def is_distribution(text: object) -> bool:
    """Return whether a value of a table is the text of a distribution."""
    found = _CALL.match(text) if isinstance(text, str) else None
    return found is not None and found[1] in _KINDS


def parse(key: str, text: str) -> Distribution:
    """Return the distribution that a text describes.

    Parameters
    ----------
    key : str
        What errors name.
    text : str
        ``normal(mean, σ)``, ``uniform(low, high)``, ``loguniform(low, high)``,
        ``lognormal(median, σ of the logarithm)``, ``truncated(mean, σ, low, high)``,
        ``list(value, …)``, ``steps(first, last, number)`` or ``empirical(value, …)``;
        behind it ``common`` (one value for all sensors) or ``correlated ρ`` (between sensors).

    Raises
    ------
    CampaignError
    """
    found = _CALL.match(text)
    if found is None or found[1] not in _KINDS:
        raise CampaignError(
            f"{key}: {text.strip()!r} is not a distribution; known are normal(mean, σ), "
            "uniform(low, high), loguniform(low, high), lognormal(median, σ of the logarithm), "
            "truncated(mean, σ, low, high), list(…), steps(first, last, number), "
            "empirical(file.csv, column)"
        )
    kind, inside, behind = found[1], found[2], found[3].strip()
    values = tuple(_value(part) for part in inside.split(",")) if inside.strip() else ()
    is_common, correlation = _suffix(key, behind)
    if kind not in ("list", "empirical"):
        values = _checked(key, kind, values)
    if not values:
        raise CampaignError(f"{key}: {kind}() is empty")
    if kind == "empirical":
        values = _measured(key, values)
    if kind == "steps":
        kind, values = "list", _steps(key, values)
    return Distribution(kind, values, is_common, correlation)


def _suffix(key: str, text: str) -> tuple[bool, float]:
    if text in ("", "each", "common"):
        return text == "common", 0.0
    found = _CORRELATED.match(text)
    try:
        correlation = float(found[1]) if found else math.nan
    except ValueError:
        correlation = math.nan
    if not -1.0 < correlation < 1.0:
        raise CampaignError(
            f"{key}: {text!r} behind the distribution; there are `common` and `correlated ρ` "
            "with -1 < ρ < 1"
        )
    return False, correlation


def _checked(key: str, kind: str, values: Sequence[Value]) -> tuple[Value, ...]:
    """Return the numbers of a distribution; its parameters make sense."""
    wanted = _NUMBER_OF_VALUES[kind]
    if len(values) != wanted:
        raise CampaignError(f"{key}: {kind} takes {wanted} numbers, not {len(values)}")
    for value in values:
        if isinstance(value, str | bool) or not math.isfinite(value):
            raise CampaignError(f"{key}: {value!r} in {kind}() is not a number")
    numbers = tuple(float(value) for value in values)
    if kind in ("normal", "lognormal", "truncated") and numbers[1] <= 0:
        raise CampaignError(f"{key}: the standard deviation in {kind}() must be above 0")
    low, high = numbers[-2:] if kind == "truncated" else numbers[:2]
    if kind == "lognormal" and low <= 0:
        raise CampaignError(f"{key}: the median in lognormal() must be above 0")
    if kind == "loguniform" and low <= 0:
        raise CampaignError(f"{key}: the lower limit in loguniform() must be above 0")
    if kind in ("uniform", "loguniform", "truncated") and low >= high:
        raise CampaignError(f"{key}: the lower limit in {kind}() must be below the upper")
    if kind == "truncated":
        mean, spread, low, high = numbers
        inside = cumulative_normal((high - mean) / spread) - cumulative_normal(
            (low - mean) / spread
        )
        if inside < 1e-9:
            raise CampaignError(f"{key}: nothing of the normal distribution lies within {low:g} …")
    return tuple(values)


def _measured(key: str, values: Sequence[Value]) -> tuple[Value, ...]:
    """Return measured numbers in order."""
    numbers = [float(v) for v in values if not isinstance(v, str | bool) and math.isfinite(v)]
    if len(numbers) < len(values):
        wrong = next(v for v in values if isinstance(v, str | bool) or not math.isfinite(v))
        raise CampaignError(f"{key}: {wrong!r} in empirical() is not a number")
    if not 2 <= len(numbers) <= _MOST_MEASURED:
        raise CampaignError(f"{key}: empirical() takes 2 to {_MOST_MEASURED} values")
    return tuple(sorted(numbers))


def with_values(key: str, text: str, folder: Path) -> str:
    """Return the text of a distribution with the values of a file in place of its name.

    ``empirical(file.csv, column)``: the file, relative to a folder, has a line of names.

    Raises
    ------
    CampaignError
        When the file cannot be read, or has no such column or numbers.
    """
    found = _CALL.match(text)
    parts = [part.strip().strip("\"'") for part in found[2].split(",")] if found else []
    if found is None or found[1] != "empirical" or len(parts) > 2 or not parts[0].endswith(".csv"):
        return text
    path = folder / parts[0]
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            names = [name.strip() for name in reader.fieldnames or ()]
            rows = [dict(zip(names, row.values(), strict=False)) for row in reader]
    except (OSError, ValueError, csv.Error) as error:
        raise CampaignError(f"{key}: {path}: cannot be read: {error}") from error
    column = parts[-1] if len(parts) == 2 else names[0] if len(names) == 1 else ""
    if column not in names:
        raise CampaignError(f"{key}: {path}: name one of its columns: {', '.join(names)}")
    cells = [str(row[column]).strip() for row in rows if str(row[column] or "").strip()]
    measured = _measured(f"{key}: {path}", tuple(_value(cell) for cell in cells))
    return f"empirical({', '.join(map(_written, measured))}) {found[3]}".strip()


def _steps(key: str, values: Sequence[Value]) -> tuple[Value, ...]:
    """Return equally spaced numbers."""
    first, last, number = (float(value) for value in values)
    count = int(number)
    if count != number or not 2 <= count <= _MOST_STEPS:
        raise CampaignError(f"{key}: the number of steps() is a whole number from 2 on")
    steps = [first + (last - first) * k / (count - 1) for k in range(count)]
    is_whole = all(isinstance(value, int) for value in values) and all(map(float.is_integer, steps))
    return tuple(int(step) if is_whole else step for step in steps)
