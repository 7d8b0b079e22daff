"""The parts of an error against the linear error equations, where these apply.

The equations of `rrins.host_tools.covariance` share no code with the runs. Constants are propagated
with the values that the run has drawn; of noise only σ is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.covariance.analysis import analyse, model_of
from rrins.host_tools.covariance.kinds import Constant, Effect
from rrins.host_tools.covariance.linear import HORIZONTAL
from rrins.host_tools.covariance.model import Model
from rrins.host_tools.covariance.sources import KINDS
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.explanation.explain import Explanation
from rrins.host_tools.explanation.sources import (
    Sides,
    Source,
    joined,
    sides_of,
    sources_of,
    without,
    words_of,
)
from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware.settings import power_on
from rrins.host_tools.hardware.units import in_si
from rrins.host_tools.rounding import rounded
from rrins.host_tools.scenario.scenario import Scenario

_OF_RECORD: Final[dict[str, Effect]] = {
    "bias_increment": "bias",
    "scale_error": "scale",
    "asymmetric_scale_error": "asymmetry",
    "g_sensitivity": "force",
}
_BEYOND_S: Final = 2.0  # the instant lies between two of the equations
_OF_TABLE: Final[dict[str, Effect]] = {"installation_u": "delta_u", "installation_v": "delta_v"}


@dataclass(frozen=True)
class Check:
    """The position at the instant by the linear equations, m east and north."""

    constants: dict[tuple[str, str], Floats]  #: by source and part, shape (2,)
    sigmas: dict[str, Floats]  #: by source, of what a run draws, shape (2,)
    largest_m: float  #: difference of a constant's part
    not_covered: tuple[str, ...]  #: sources that the equations know nothing of

    def values(self) -> JsonObject:
        """Return it as plain values."""
        return {
            "largest_difference_m": self.largest_m,
            "constants": [
                {"source": source, "part": part, "east_m": east, "north_m": north}
                for (source, part), (east, north) in self.constants.items()
            ],
            "sigma": {
                source: {"east_m": float(east), "north_m": float(north)}
                for source, (east, north) in self.sigmas.items()
            },
            "not_covered": list(self.not_covered),
        }

    def lines(self, found: Explanation) -> list[str]:
        """Return what a person is told."""
        lines = []
        if self.constants:
            error = float(np.linalg.norm(found.error[-1, :2]))
            share = f", {self.largest_m / error:.2%} of the error" if error > 0 else ""
            count = len(self.constants)
            what = f"{count} constant{'s' * (count > 1)}"
            lines.append(
                f"linear error equations: {what}, each within {rounded(self.largest_m)} m of its "
                f"part{share}"
            )
        for source, sigma in self.sigmas.items():
            parts = [one.value[:2] for one in found.parts if one.source == source]
            drawn = np.nansum(parts, axis=0)
            times = float(np.linalg.norm(drawn) / np.linalg.norm(sigma))
            spread = f"σ {rounded(sigma[0])} m east, {rounded(sigma[1])} m north"
            lines.append(f"{source}: {spread}; this run drew {rounded(times, 2)} times that")
        if self.not_covered:
            lines.append(f"not in the equations: {', '.join(self.not_covered)}")
        return lines


def check(scenario: Scenario, found: Explanation) -> Check:
    """Compare the parts with the linear error equations.

    Raises
    ------
    RehearsalError
        When these do not cover the scenario.
    """
    if scenario.faults:
        raise RehearsalError("--check: the linear equations know no faults")
    try:
        until = scenario.varied(duration_s=found.time_s + _BEYOND_S)
        analysis = analyse(until)
    except RehearsalError as error:
        reason = str(error).removeprefix("covariance: ")
        raise RehearsalError(f"--check: the linear analysis {reason}") from error
    model = model_of(until)
    whole = sides_of(scenario)
    sources = sources_of(scenario)
    if found.by == "source":
        sources = joined(sources)
    constants: dict[tuple[str, str], Floats] = {}
    for source in sources:
        track = _linear(model, whole, source, found.time_s)
        if track is not None:
            constants[source.name, source.part] = track
    sigmas: dict[str, Floats] = {}
    for result in analysis.sources:
        name = words_of(result.name)
        before = sigmas.get(name, np.zeros(2))
        sigmas[name] = np.sqrt(before**2 + _at(found.time_s, analysis.times_s, result.sigma) ** 2)
    values = {(one.source, one.part): one.value[:2] for one in found.parts}
    off = [np.linalg.norm(values[key] - track) for key, track in constants.items()]
    known = {source for source, _ in constants} | set(sigmas)
    missing = dict.fromkeys(one.source for one in found.parts if one.source not in known)
    sigmas = {name: sigma for name, sigma in sigmas.items() if sigma.any()}
    return Check(constants, sigmas, float(max(off, default=0.0)), tuple(missing))


def _linear(model: Model, whole: Sides, source: Source, time_s: float) -> Floats | None:
    """Return the position that a source's constants give, shape (2,); None for what is none."""
    total, is_constant = np.zeros(2), False
    for one in _constants(whole, source):
        track = model.of_drawn(one).mean[:, HORIZONTAL]
        total += _at(time_s, model.times_s, track)
        is_constant = True
    return total if is_constant else None


def _at(time_s: float, times_s: Floats, track: Floats) -> Floats:
    return np.array([np.interp(time_s, times_s, column) for column in track.T])


def _constants(whole: Sides, source: Source) -> list[Constant]:
    """Return by how much the constants of the sensors differ with a source and without it."""
    left = without(whole, [source])
    plants = [power_on(sides.hardware)[0] for sides in (whole, left)]
    dt = 1 / whole.hardware.rate_hz
    found = []
    for kind in KINDS:
        count = int(getattr(plants[0], kind).count)
        tables = [in_si(getattr(sides.hardware, kind)) for sides in (whole, left)]
        differences: dict[Effect, Floats] = {}
        for field, effect in _OF_RECORD.items():
            pair = (getattr(plant, kind)[field][:count] for plant in plants)
            differences[effect] = np.subtract(*pair) / (dt if "increment" in field else 1.0)
        for key, effect in _OF_TABLE.items():
            pair = (np.broadcast_to(table[key], count) for table in tables)
            differences[effect] = np.subtract(*pair)
        found += [
            Constant(
                source.name, mean, np.zeros((count, count)), np.zeros((count, 0)), kind, effect
            )
            for effect, mean in differences.items()
            if mean.any()
        ]
    return found
