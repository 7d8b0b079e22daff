"""Section 4.4: the prototype at standstill, three hours strapdown and three hours rotating.

The constants of the real sensors are unknown. They are drawn from table 2 over seeds, for several
sets of scale factor and installation errors; the paper's result is located in the distribution.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.experiments.calibrated import switched_on
from rrins.host_tools.experiments.constants import REFERENCE, SETS, WORST, ConstantSet
from rrins.host_tools.experiments.figures import draw_bands, draw_pair
from rrins.host_tools.experiments.fleet import Fleet, run
from rrins.host_tools.experiments.sections import (
    Distribution,
    FigureRow,
    Picture,
    PictureGrid,
    Section,
)
from rrins.host_tools.rounding import rounded
from rrins.host_tools.runs.results.results import Errors
from rrins.host_tools.scenario.scenario import Scenario, load

EXPERIMENT: Final = "experiment"
RATE_HZ: Final = 50
"""At standstill the errors do not depend on the rate; a test compares with 200 Hz."""

_SAMPLE_S = 1.0
_SIDES = ("east", "north")
_LARGER = ConstantSet(50.0, 10.0, biases=8.0)
_QUANTITIES: Final = {
    "strapdown": ("largest position error, strapdown", "m"),
    "rotating": ("largest position error, rotating", "m"),
    "ratio": ("strapdown over rotating", "1"),
}
Outcome = dict[str, tuple[Distribution, Distribution]]
"""The distributions of a case, east and north, of each of `_QUANTITIES`."""


@dataclass(frozen=True)
class PrototypeCase:
    """A set of constants, the attitude initialisation, and whether the unit is calibrated."""

    constants: ConstantSet
    initial_attitude: str = "given"
    is_calibrated: bool = False

    @property
    def words(self) -> str:
        """The case in words."""
        if self.is_calibrated:
            return f"{self.constants.words}, calibrated"
        if self.initial_attitude == "given":
            return self.constants.words
        return f"{self.constants.words}, {self.initial_attitude}"


CASES: Final = (
    *(PrototypeCase(constants) for constants in SETS),
    PrototypeCase(ConstantSet(50.0, 10.0), "self-aligned"),
    PrototypeCase(_LARGER),
    PrototypeCase(WORST, is_calibrated=True),
)


def runs_of(seeds: int) -> int:
    """Return how many runs the experiment takes."""
    return 2 * seeds * len(CASES)


def _scenarios(case: PrototypeCase) -> tuple[Scenario, Scenario]:
    changes = {
        "rate_hz": RATE_HZ,
        "firmware__initial_attitude": case.initial_attitude,
        "firmware__alignment_s": 2 if case.initial_attitude == "given" else 300,
    }
    return (
        load("experiment_strapdown").varied(**changes),
        load("experiment_rotating").varied(**changes),
    )


def _largest(outcomes: list[Errors]) -> Floats:
    """Return the largest position errors, shape (seeds, 2), m."""
    return np.array(
        [[o.largest()["max_abs_position_error_m"][side] for side in _SIDES] for o in outcomes]
    )


def _paper(scenario: Scenario) -> Floats:
    """Return the paper's largest position errors, east and north, m."""
    assert scenario.paper is not None
    position = scenario.paper.max_abs_position_error_m
    assert position is not None
    return np.array([position.east, position.north])


def _holds(outcome: Outcome) -> bool:
    """Return whether both of the paper's ratios lie in the band."""
    return all(one.holds for one in outcome["ratio"])


def _outcome(case: PrototypeCase, seeds: int, fleet: Fleet) -> Outcome:
    scenarios = _scenarios(case)
    numbers = range(1, seeds + 1)
    pairs = [[case.constants.drawn(one, seed) for seed in numbers] for one in scenarios]
    found = None
    if case.is_calibrated:
        pairs = [[switched_on(one) for one in drawn] for drawn in pairs]
        found = fleet.calibrate(pairs[0])
    standing, turning = (_largest(fleet.run_all(drawn, _SAMPLE_S, found)) for drawn in pairs)
    at_rest, in_turn = map(_paper, scenarios)
    return {
        key: (Distribution.of(ours[:, 0], paper[0]), Distribution.of(ours[:, 1], paper[1]))
        for key, ours, paper in (
            ("strapdown", standing, at_rest),
            ("rotating", turning, in_turn),
            ("ratio", standing / turning, at_rest / in_turn),
        )
    }


def _figure_rows(case: PrototypeCase, outcome: Outcome, larger: Outcome) -> list[FigureRow]:
    """Return the rows of a case; rows that differ also state the result with larger biases."""
    rows = []
    for key, (words, unit) in _QUANTITIES.items():
        for side, one, of_larger in zip(_SIDES, outcome[key], larger[key], strict=True):
            quantity = f"{words}, {side}"
            row = FigureRow(
                EXPERIMENT, case.words, quantity, unit, one.paper, one.median, one.words()
            )
            if row.differs and unit == "m":
                note = f"{row.note}; {_LARGER.words}: {rounded(of_larger.median)} {unit}"
                row = replace(row, note=note)
            rows.append(row)
    return rows


def _grid(outcomes: dict[PrototypeCase, Outcome]) -> PictureGrid:
    quantities = (("strapdown", " / m"), ("rotating", " / m"), ("strapdown / rotating", ""))
    return PictureGrid(
        f"Largest position errors: median and {_spread_words(outcomes)}",
        tuple(f"{words}, {side}{unit}" for words, unit in quantities for side in _SIDES),
        tuple(
            (case.words, tuple(one for pair in outcome.values() for one in pair))
            for case, outcome in outcomes.items()
        ),
    )


def _finding(outcomes: dict[PrototypeCase, Outcome]) -> str:
    holding = [case.words for case, outcome in outcomes.items() if _holds(outcome)]
    words = _spread_words(outcomes)
    if not holding:
        return f"For no set do both of the paper's ratios lie in {words}."
    return f"Both of the paper's ratios lie in {words} with: {'; '.join(holding)}."


def _spread_words(outcomes: dict[PrototypeCase, Outcome]) -> str:
    return next(iter(outcomes.values()))["ratio"][0].spread_words


def reproduce(fleet: Fleet, seeds: int) -> Section:
    """Run section 4.4 over several seeds."""
    section = Section(EXPERIMENT, "Static experiment with the prototype (4.4)", seeds)
    section.settings.append(
        f"3 h strapdown and 3 h rotating (2 °/s, 10 s standing), {RATE_HZ} Hz, seeds 1 to {seeds}; "
        "bias repeatability and stability of table 2, white noise 0.005 °/√h and "
        "10 µg/√Hz; attitude given unless stated otherwise, height held. The sets are standard "
        "deviations of symmetric and asymmetric scale factor errors (accelerometers: 30/50 of it) "
        "and of installation errors."
    )
    section.open_points.extend(
        (
            "The constants of the real sensors: drawn from table 2 here.",
            "Scale factor, asymmetry and installation errors after the prototype's calibration.",
            "How the attitude was initialised.",
        )
    )
    outcomes = {case: _outcome(case, seeds, fleet) for case in CASES}
    for case, outcome in outcomes.items():
        section.rows.extend(_figure_rows(case, outcome, outcomes[PrototypeCase(_LARGER)]))
    section.open_rows = 0
    section.grids.append(_grid(outcomes))
    section.findings.append(_finding(outcomes))
    section.findings.append(_size(outcomes))
    bands = {case.words: outcome["ratio"] for case, outcome in outcomes.items()}
    east, north = (f"position error {side}: strapdown / rotating" for side in _SIDES)
    drawn = draw_bands(
        bands,
        (east, north),
        "Gain from rotation, by σ of scale factor and installation errors",
    )
    caption = "Gain from rotation (strapdown over rotating) for each set of constants."
    section.pictures.append(Picture("figure_4_4_ratio", caption, drawn))
    first, second = (run(REFERENCE.drawn(s, 1), _SAMPLE_S) for s in _scenarios(CASES[0]))
    drawn = draw_pair((first, "strapdown"), (second, "rotating"))
    caption = f"Seed 1 of the set {REFERENCE.words}: strapdown (left), rotating (right)."
    section.pictures.append(Picture("figure_12", caption, drawn))
    return section


def _size(outcomes: dict[PrototypeCase, Outcome]) -> str:
    """Describe the size of the paper's errors relative to those of table 2."""
    usual, larger = outcomes[PrototypeCase(REFERENCE)], outcomes[PrototypeCase(_LARGER)]
    factors = [one.paper / one.median for one in usual["strapdown"] if one.paper]
    before, inside = _errors_inside(usual), _errors_inside(larger)
    text = (
        f"The paper's strapdown errors are {rounded(factors[0])} (east) and {rounded(factors[1])} "
        f"(north) times the median of {len(usual['strapdown'][0].values)} seeds with "
        f"{REFERENCE.words}. Of its four position errors {before} lie in {_spread_words(outcomes)} "
        f"with {REFERENCE.words}, and {inside} with {_LARGER.words}."
    )
    if inside <= before:
        return text
    return (
        f"{text} Biases larger than table 2 states would explain this, and so might errors that "
        "the paper does not mention. That is an inference: no figure of the paper shows the biases "
        "during the experiment."
    )


def _errors_inside(outcome: Outcome) -> int:
    """Return how many of the paper's four position errors lie in the spread."""
    return sum(one.holds for pair in (outcome["strapdown"], outcome["rotating"]) for one in pair)
