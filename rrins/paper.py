"""The paper's experiments, run again."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from rrins.host_tools.experiments.paper import EXPERIMENTS, reproduce_sections
from rrins.host_tools.experiments.report import write
from rrins.host_tools.experiments.sections import Section


def reproduce(
    experiments: Iterable[str] = EXPERIMENTS,
    *,
    seeds: int = 20,
    motion: str | Path | None = None,
    out: str | Path | None = None,
) -> list[Section]:
    """Run the paper's experiments; return the results beside its figures.

    Parameters
    ----------
    experiments : iterable of str
        Any of ``scheme``, ``static``, ``rotating``, ``experiment``, ``drive``.
    seeds : int
        Runs of each noisy variant.
    motion : str or Path, optional
        Recorded motion for ``drive``, beside the synthetic one.
    out : str or Path, optional
        Folder for the report and its pictures; without it nothing is written.
    """
    recorded = None if motion is None else Path(motion)
    sections = reproduce_sections(tuple(experiments), seeds, recorded)
    if out is not None:
        folder = Path(out)
        folder.mkdir(parents=True, exist_ok=True)
        write(folder, sections)
    return sections
