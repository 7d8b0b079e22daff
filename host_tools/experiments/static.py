"""Sections 4.3.1 and 4.3.2: the simulations at standstill, without and with rotation.

The choices that the paper leaves open are varied one at a time; the variant closest in all figures
of a case stands beside each that differs by more than a factor of two.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from rrins.host_tools.experiments.figures import draw_pair
from rrins.host_tools.experiments.fleet import Fleet
from rrins.host_tools.experiments.sections import FigureRow, Picture, Section
from rrins.host_tools.experiments.variants import with_closest
from rrins.host_tools.runs.results.results import Errors
from rrins.host_tools.scenario.scenario import Scenario, load

VARIANT_RATE_HZ: Final = 50

QUANTITIES: Final = (
    ("max_abs_position_error_m", "east", "largest position error, east", "m"),
    ("max_abs_position_error_m", "north", "largest position error, north", "m"),
    ("max_abs_velocity_error_mps", "east", "largest velocity error, east", "m/s"),
    ("max_abs_velocity_error_mps", "north", "largest velocity error, north", "m/s"),
)


@dataclass(frozen=True)
class Variant:
    """A different choice for something that the paper leaves open."""

    words: str
    changes: dict[str, float | str] = field(default_factory=dict)


_SELF_ALIGNED: Final[dict[str, float | str]] = {
    "firmware__initial_attitude": "self-aligned",
    "firmware__alignment_s": 60,
}
STRAPDOWN_VARIANTS: Final = (
    Variant("attitude self-aligned", _SELF_ALIGNED),
    Variant("heading 45°", {"body__heading_deg": 45}),
    Variant("heading 90°", {"body__heading_deg": 90}),
    Variant("heading 270°", {"body__heading_deg": 270}),
    Variant("3600 s", {"duration_s": 3600}),
    Variant("attitude self-aligned, 3600 s", _SELF_ALIGNED | {"duration_s": 3600}),
    Variant("latitude 30°", {"site__latitude_deg": 30.0}),
)
ROTATING_VARIANTS: Final = (
    Variant("turning at 3 °/s", {"firmware__turn_rate_dps": 3}),
    Variant("turning at 3.5 °/s", {"firmware__turn_rate_dps": 3.5}),
    Variant("turning at 4 °/s", {"firmware__turn_rate_dps": 4}),
    Variant("turning at 6 °/s", {"firmware__turn_rate_dps": 6}),
    Variant(
        "turning at 3 °/s, standing 1 s",
        {"firmware__turn_rate_dps": 3, "firmware__stand_s": 1},
    ),
    Variant(
        "turning at 6 °/s, standing 1 s",
        {"firmware__turn_rate_dps": 6, "firmware__stand_s": 1},
    ),
    Variant("standing 1 s", {"firmware__stand_s": 1}),
    Variant("standing 30 s", {"firmware__stand_s": 30}),
    Variant("heading 90°", {"body__heading_deg": 90}),
    Variant("one cycle, 1600 s", {"duration_s": 1600}),
    Variant("attitude self-aligned", _SELF_ALIGNED),
    Variant("8-position scheme", {"firmware__scheme": "8-position"}),
)


@dataclass(frozen=True)
class Simulation:
    """One of the two sections."""

    experiment: str
    title: str
    figure: str
    scenarios: tuple[str, ...]
    variants: tuple[Variant, ...]
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


def _largest_error(errors: Errors, key: str, side: str) -> float:
    return float(errors.largest()[key][side])


def _figure_rows(
    simulation: Simulation, name: str, scenario: Scenario, main: Errors, varied: list[Errors]
) -> list[FigureRow]:
    assert scenario.paper is not None
    settings = (
        f"{scenario.duration_s:g} s, attitude {scenario.firmware.initial_attitude}, "
        f"height {scenario.firmware.height_channel}"
    )
    rows = []
    for key, side, words, unit in QUANTITIES:
        table = getattr(scenario.paper, key)
        paper = None if table is None else float(getattr(table, side))
        ours = _largest_error(main, key, side)
        rows.append(FigureRow(simulation.experiment, name, words, unit, paper, ours, settings))
    values = {
        variant.words: [_largest_error(errors, key, side) for key, side, *_ in QUANTITIES]
        for variant, errors in zip(simulation.variants, varied, strict=True)
    }
    return with_closest(rows, values)


def _variant_rows(
    simulation: Simulation, name: str, scenario: Scenario, varied: list[Errors]
) -> list[FigureRow]:
    """Return the rows of the variants, one for each of its figures."""
    assert scenario.paper is not None
    tables = {key: getattr(scenario.paper, key) for key, *_ in QUANTITIES}
    return [
        FigureRow(
            simulation.experiment,
            f"{name}: {variant.words}",
            words,
            unit,
            None if tables[key] is None else float(getattr(tables[key], side)),
            _largest_error(errors, key, side),
            "variant",
        )
        for variant, errors in zip(simulation.variants, varied, strict=True)
        for key, side, words, unit in QUANTITIES
    ]


def simulate(simulation: Simulation, fleet: Fleet) -> Section:
    """Run one of the two simulations and its variants."""
    section = Section(simulation.experiment, simulation.title)
    section.open_points.extend(simulation.open_points)
    scenarios = {name: load(name) for name in simulation.scenarios}
    slow: dict[str, float | str] = {"rate_hz": VARIANT_RATE_HZ}
    jobs = [
        scenario.varied(**changes)
        for scenario in scenarios.values()
        for changes in ({}, *(slow | variant.changes for variant in simulation.variants))
    ]
    outcomes = iter(fleet.run_all(jobs))
    main: dict[str, Errors] = {}
    variants: list[FigureRow] = []
    for name, scenario in scenarios.items():
        main[name] = next(outcomes)
        varied = [next(outcomes) for _ in simulation.variants]
        section.rows.extend(_figure_rows(simulation, name, scenario, main[name], varied))
        variants.extend(_variant_rows(simulation, name, scenario, varied))
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
