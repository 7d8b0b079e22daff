"""The paper's experiments by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rrins.host_tools.experiments import drive, prototype, static, variation
from rrins.host_tools.experiments.fleet import Fleet
from rrins.host_tools.experiments.sections import Section

EXPERIMENTS = ("scheme", "static", "rotating", "experiment", "drive")
"""By name, in the order of the paper."""


def runs_of(which: tuple[str, ...], seeds: int, motion: Path | None) -> int:
    """Return how many runs the experiments take."""
    runs = {
        "scheme": 0,
        "static": static.runs_of(static.STATIC),
        "rotating": static.runs_of(static.ROTATING),
        "experiment": prototype.runs_of(seeds),
        "drive": drive.runs_of(seeds, motion is not None),
    }
    return sum(runs[name] for name in which)


def reproduce_sections(
    which: tuple[str, ...],
    seeds: int,
    motion: Path | None,
    on_done: Callable[[], None] = lambda: None,
    say: Callable[[str], None] = lambda name: None,
) -> list[Section]:
    """Run experiments; return one report section for each.

    Parameters
    ----------
    which : tuple of str
        Names from `EXPERIMENTS`.
    seeds : int
        Runs of each noisy variant.
    motion : Path or None
        Recorded motion for ``drive``.
    on_done : callable
        Called after each run.
    say : callable
        Receives the name of each experiment as it begins.
    """
    fleet = Fleet(on_done)
    run: dict[str, Callable[[], Section]] = {
        "scheme": variation.reproduce,
        "static": lambda: static.simulate(static.STATIC, fleet),
        "rotating": lambda: static.simulate(static.ROTATING, fleet),
        "experiment": lambda: prototype.reproduce(fleet, seeds),
        "drive": lambda: drive.reproduce(fleet, seeds, motion),
    }
    sections = []
    for name in which:
        say(name)
        sections.append(run[name]())
    return sections
