"""Sections 4.3.1 and 4.3.2: the simulations at standstill, without and with rotation.

The choices that the paper leaves open are varied one at a time; the variant closest in all figures
of a case stands beside each that differs by more than a factor of two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from rrins.host_tools.experiments.figures import draw_pair
from rrins.host_tools.experiments.fleet import Fleet
from rrins.host_tools.experiments.sections import FigureRow, Picture, Section
from rrins.host_tools.experiments.variants import with_closest
from rrins.host_tools.runs.results.results import Errors
from rrins.host_tools.scenario.scenario import Scenario, load

VARIANT_RATE_HZ: Final = 50
Changes = dict[str, float | str]

QUANTITIES: Final = (
    ("max_abs_position_error_m", "east", "largest position error, east", "m"),
    ("max_abs_position_error_m", "north", "largest position error, north", "m"),
    ("max_abs_velocity_error_mps", "east", "largest velocity error, east", "m/s"),
    ("max_abs_velocity_error_mps", "north", "largest velocity error, north", "m/s"),
)


_SELF_ALIGNED: Final[Changes] = {
    "firmware__initial_attitude": "self-aligned",
    "firmware__alignment_s": 60,
}
STRAPDOWN_VARIANTS: Final[dict[str, Changes]] = {
    "attitude self-aligned": _SELF_ALIGNED,
    "heading 45°": {"body__heading_deg": 45},
    "heading 90°": {"body__heading_deg": 90},
    "heading 270°": {"body__heading_deg": 270},
    "3600 s": {"duration_s": 3600},
    "attitude self-aligned, 3600 s": _SELF_ALIGNED | {"duration_s": 3600},
    "latitude 30°": {"site__latitude_deg": 30.0},
}
ROTATING_VARIANTS: Final[dict[str, Changes]] = {
    "turning at 3 °/s": {"firmware__turn_rate_dps": 3},
    "turning at 3.5 °/s": {"firmware__turn_rate_dps": 3.5},
    "turning at 4 °/s": {"firmware__turn_rate_dps": 4},
    "turning at 6 °/s": {"firmware__turn_rate_dps": 6},
    "turning at 3 °/s, standing 1 s": {"firmware__turn_rate_dps": 3, "firmware__stand_s": 1},
    "turning at 6 °/s, standing 1 s": {"firmware__turn_rate_dps": 6, "firmware__stand_s": 1},
    "standing 1 s": {"firmware__stand_s": 1},
    "standing 30 s": {"firmware__stand_s": 30},
    "heading 90°": {"body__heading_deg": 90},
    "one cycle, 1600 s": {"duration_s": 1600},
    "attitude self-aligned": _SELF_ALIGNED,
    "8-position scheme": {"firmware__scheme": "8-position"},
}
"""Different choices for something that the paper leaves open."""


@dataclass(frozen=True)
class Simulation:
    """One of the two sections."""

    experiment: str
    title: str
    figure: str
    scenarios: tuple[str, ...]
    variants: dict[str, Changes]
    open_points: tuple[str, ...]


STATIC: Final = Simulation(
    "static",
    "Static navigation without rotation (4.3.1)",
    "figure_9",
    (
        "imu_strapdown",
        "rimu_strapdown",
        "imu_strapdown_self_aligned",
        "rimu_strapdown_self_aligned",
    ),
    STRAPDOWN_VARIANTS,
    (
        "How the attitude is initialised: given without error here, self-aligned in the scenarios "
        "that say so.",
        "Whether the height is aided: held here.",
        "The heading (0° here), the signs of the errors (positive here) and the sampling rate.",
    ),
)
ROTATING: Final = Simulation(
    "rotating",
    "Static navigation with rotation (4.3.2)",
    "figure_10",
    ("imu_rotating", "rimu_rotating"),
    ROTATING_VARIANTS,
    (
        "The duration (6000 s here, as without rotation) and the initial attitude (given here).",
        "Turn rate and standing time in the simulation: those of the experiment here "
        "(4.4: 2 °/s, 10 s). The residual error scales with the square of a position's duration.",
        "Velocities: the paper states the amplitude of the fluctuation; ours is the largest error.",
    ),
)


def runs_of(simulation: Simulation) -> int:
    """Return how many runs a simulation takes."""
    return len(simulation.scenarios) * (1 + len(simulation.variants))


def _rows(
    experiment: str, case: str, scenario: Scenario, errors: Errors, note: str
) -> list[FigureRow]:
    assert scenario.paper is not None
    rows = []
    for key, side, words, unit in QUANTITIES:
        table = getattr(scenario.paper, key)
        paper = None if table is None else float(getattr(table, side))
        ours = float(errors.largest()[key][side])
        rows.append(FigureRow(experiment, case, words, unit, paper, ours, note))
    return rows


def simulate(simulation: Simulation, fleet: Fleet) -> Section:
    """Run one of the two simulations and its variants."""
    section = Section(simulation.experiment, simulation.title)
    section.open_points.extend(simulation.open_points)
    scenarios = {name: load(name) for name in simulation.scenarios}
    slow: Changes = {"rate_hz": VARIANT_RATE_HZ}
    changes = ({}, *(slow | one for one in simulation.variants.values()))
    jobs = [scenario.varied(**one) for scenario in scenarios.values() for one in changes]
    outcomes = iter(fleet.run_all(jobs))
    main: dict[str, Errors] = {}
    variants: list[FigureRow] = []
    for name, scenario in scenarios.items():
        main[name] = next(outcomes)
        note = (
            f"{scenario.duration_s:g} s, attitude {scenario.firmware.initial_attitude}, "
            f"height {scenario.firmware.height_channel}"
        )
        rows = _rows(section.experiment, name, scenario, main[name], note)
        varied = {
            words: _rows(
                section.experiment, f"{name}: {words}", scenario, next(outcomes), "variant"
            )
            for words in simulation.variants
        }
        section.rows.extend(with_closest(rows, varied))
        for one in varied.values():
            variants.extend(one)
    section.rows.extend(variants)
    first = next(iter(scenarios.values()))
    section.settings.append(
        f"{first.rate_hz} Hz, latitude {first.site.latitude_deg:g}°; IMU: 0.1 °/h and 50 µg on "
        "each of three orthogonal sensors; RIMU: 0.1, 0.11, 0.12, 0.13 °/h and 50, 55, 60, 65 µg "
        "on a tetrahedron; no noise, so the seed does not matter. "
        f"Variants at {VARIANT_RATE_HZ} Hz, which agrees within 0.5 %."
    )
    imu, rimu = simulation.scenarios[:2]
    caption = f"{simulation.title}: orthogonal IMU (left) and tetrahedron RIMU (right)."
    drawn = draw_pair((main[imu], "IMU"), (main[rimu], "RIMU"))
    section.pictures.append(Picture(simulation.figure, caption, drawn))
    return section
