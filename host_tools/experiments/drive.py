"""Section 4.5: a moving vehicle, strapdown and rotating, the error of the end point.

The paper's motion is not published. Each seed drives another synthetic route; a recorded motion
can be given beside.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from host_tools.experiments.constants import SETS, ConstantSet
from host_tools.experiments.figures import draw_bands, draw_track
from host_tools.experiments.fleet import Fleet
from host_tools.experiments.results import Distribution, Picture, Row, Section
from host_tools.motion.trajectory import PLACE
from host_tools.outfit import trajectory_of
from host_tools.results import Errors, east_north_m
from host_tools.scenario import Scenario, load

EXPERIMENT: Final = "drive"
RATE_HZ: Final = 50
_SAMPLE_S = 1.0
_NAMES = ("drive_strapdown", "drive_rotating")
_WAYS = ("strapdown", "rotating")
_VARIANTS: Final[dict[str, dict[str, Any]]] = {
    "the vehicle at rest": {"motion": {"kind": "stationary"}},
    "turning at 6 °/s, standing 2 s": {"firmware__turn_rate_dps": 6, "firmware__stand_s": 2},
    "turning at 20 °/s, standing 3 s": {"firmware__turn_rate_dps": 20, "firmware__stand_s": 3},
}
_IDEAL: Final[dict[str, Any]] = {"gyros": {}, "accelerometers": {}}


def runs_of(seeds: int, with_motion: bool) -> int:
    """Return how many runs the section takes."""
    return 2 * seeds * len(SETS) + 2 * len(_VARIANTS) + (8 if with_motion else 4)


def _end_m(errors: Errors) -> float:
    return float(errors.largest()["end_position_error_m"])


def _distributions(
    constants: ConstantSet, seeds: int, fleet: Fleet
) -> tuple[Distribution, Distribution, Distribution]:
    """Return the end point errors strapdown and rotating, and their ratio."""
    ends, papers = [], []
    for name in _NAMES:
        scenario = load(name).varied(rate_hz=RATE_HZ)
        assert scenario.paper is not None
        papers.append(scenario.paper.end_position_error_m or np.nan)
        jobs = [
            constants.drawn(scenario.varied(motion__seed=seed), seed)
            for seed in range(1, seeds + 1)
        ]
        ends.append(np.array([_end_m(errors) for errors in fleet.run_all(jobs, _SAMPLE_S)]))
    return (
        Distribution.of(ends[0], papers[0]),
        Distribution.of(ends[1], papers[1]),
        Distribution.of(ends[0] / ends[1], papers[0] / papers[1]),
    )


def _on(scenario: Scenario, motion: Path | None) -> Scenario:
    """Return a scenario on a recorded motion, as long as that is."""
    if motion is None:
        return scenario
    moved = scenario.varied(motion={"kind": "file", "path": str(motion.absolute())})
    trajectory = trajectory_of(moved)
    assert trajectory is not None
    return moved.varied(duration_s=trajectory.duration_s)


def _single(section: Section, fleet: Fleet, motion: Path | None, case: str, slug: str) -> None:
    """Run a motion once with the paper's constants and once with ideal sensors."""
    scenarios = [_on(load(name), motion) for name in _NAMES]
    ideal = [scenario.varied(**_IDEAL) for scenario in scenarios]
    outcomes = fleet.run_all([*scenarios, *ideal])
    for way, scenario, errors in zip(_WAYS, scenarios, outcomes[:2], strict=True):
        paper = scenario.paper.end_position_error_m if scenario.paper and not motion else None
        note = f"{scenario.duration_s:g} s, {scenario.rate_hz} Hz, attitude given"
        section.rows.append(
            Row(EXPERIMENT, case, f"end point error, {way}", "m", paper, _end_m(errors), note)
        )
        for side in ("east", "north"):
            table = scenario.paper.max_abs_velocity_error_mps if scenario.paper else None
            paper_velocity = float(getattr(table, side)) if table and not motion else None
            largest = errors.largest()["max_abs_velocity_error_mps"][side]
            words = f"largest velocity error, {side}, {way}"
            section.rows.append(Row(EXPERIMENT, case, words, "m/s", paper_velocity, largest, note))
    for way, errors in zip(_WAYS, outcomes[2:], strict=True):
        largest = float(np.max(np.hypot(errors.position_east_m, errors.position_north_m)))
        words = f"largest position error, ideal sensors, {way}"
        section.rows.append(
            Row(EXPERIMENT, case, words, "m", None, largest, "counts and CRC as ever; limit 0.5 m")
        )
    section.pictures.append(_picture(scenarios[0], outcomes[0], outcomes[1], case, slug))


def _vary(section: Section, fleet: Fleet) -> None:
    """Run what the paper leaves open otherwise, on route 1, and say what it does."""
    jobs = [load(name).varied(**changes) for changes in _VARIANTS.values() for name in _NAMES]
    ends = [_end_m(errors) for errors in fleet.run_all(jobs)]
    words = []
    for k, variant in enumerate(_VARIANTS):
        for way, name, end_m in zip(_WAYS, _NAMES, ends[2 * k : 2 * k + 2], strict=True):
            paper = load(name).paper
            assert paper is not None
            quantity = f"end point error, {way}"
            section.rows.append(
                Row(
                    EXPERIMENT,
                    f"route 1: {variant}",
                    quantity,
                    "m",
                    paper.end_position_error_m,
                    end_m,
                    "variant",
                )
            )
        words.append(f"{variant}: {ends[2 * k]:.3g} m strapdown, {ends[2 * k + 1]:.3g} m rotating")
    section.findings.append(
        "Rotation evens out the errors over a cycle of 1600 s on a body that keeps its heading; a "
        "vehicle that turns meanwhile breaks the balance, and evens out some errors by itself. "
        f"End points on route 1 otherwise: {'; '.join(words)}. The paper's 30 m lies between a "
        "vehicle at rest and one that turns as often as this one."
    )


def _picture(
    scenario: Scenario, strapdown: Errors, rotating: Errors, case: str, slug: str
) -> Picture:
    trajectory = trajectory_of(scenario)
    assert trajectory is not None
    latitude, longitude, height = trajectory.at(strapdown.time_s)[:, PLACE].T
    east, north = east_north_m(latitude, longitude, latitude[0], longitude[0], height)
    tracks = {"strapdown": strapdown, "rotating": rotating}
    return Picture(
        slug, f"{case}: the way driven and the position errors.", draw_track(east, north, tracks)
    )


def reproduce(fleet: Fleet, seeds: int, motion: Path | None) -> Section:
    """Run section 4.5 over some seeds, and on a recorded motion where one is given."""
    section = Section(EXPERIMENT, "Dynamic semi-physical simulation (4.5)")
    section.settings.append(
        f"Synthetic drive of 2500 s, another route for each of the seeds 1 to {seeds} ({RATE_HZ} "
        "Hz; route 1 also at 200 Hz), constant errors as in 4.3 and scale factor and installation "
        "errors of each set; attitude given, height damped by an altimeter without error."
    )
    section.open_points.extend(
        (
            "The vehicle's motion; only that it lasts less than 2500 s.",
            "Initial attitude, aiding of the height.",
        )
    )
    _single(section, fleet, None, "route 1", "figure_15")
    if motion is not None:
        _single(section, fleet, motion, motion.name, "figure_15_recorded")
    _vary(section, fleet)
    bands = {}
    held = False
    for constants in SETS:
        strapdown, rotating, ratio = _distributions(constants, seeds, fleet)
        bands[constants.words] = (strapdown, rotating)
        for words, unit, one in (
            ("end point error, strapdown", "m", strapdown),
            ("end point error, rotating", "m", rotating),
            ("strapdown over rotating", "1", ratio),
        ):
            section.rows.append(
                Row(EXPERIMENT, constants.words, words, unit, one.paper, one.median, one.words())
            )
        if strapdown.holds and rotating.holds and ratio.holds:
            held = True
            section.findings.append(
                f"With {constants.words} both end points and their ratio lie in the 5-95 % band."
            )
    figure = draw_bands(bands, "m")
    for axes, words in zip(figure.axes, _WAYS, strict=True):
        axes.set_xlabel(f"end point error, {words} / m")
    section.pictures.append(
        Picture("figure_4_5_spread", "End point errors over routes and constants.", figure)
    )
    worst = bands[SETS[1].words]
    section.findings.append(
        f"With installation errors of {SETS[1].installation_arcsec:g}″ the rotating end point is "
        f"{worst[1].median / worst[0].median:.2g} times the strapdown one: every half turn tilts "
        "the solution, and turns of the vehicle keep the tilts from cancelling. In a vehicle "
        "rotation needs calibrated installation and scale factors."
    )
    if not held:
        section.findings.append(
            "No set puts both end points and their ratio inside its 5-95 % band."
        )
    return section
