"""The steps as machine code for other processors, from Python."""

from __future__ import annotations

from pathlib import Path

from rrins.host_tools.builds.build import Build
from rrins.host_tools.builds.build import build as build_steps
from rrins.host_tools.scenario.scenario import Scenario, load


def build(
    scenario: Scenario | str,
    folder: Path | str,
    target: str = "x86_64-linux",
    executable: bool = False,
    fmu: bool = False,
) -> Build:
    """Build the steps of a scenario as machine code; see docs/build.md.

    Parameters
    ----------
    scenario : Scenario or str
        Or its name, or the path of its file.
    folder : Path or str
        For objects, library, headers, images and manifest.
    target : str
        As ``rrins build --target`` takes it.
    executable : bool
        Whether to link a navigation computer, too.
    fmu : bool
        Whether to link both sides as FMUs, too.

    Raises
    ------
    RehearsalError
        When there is no machine code for the target, or it cannot be linked.
    """
    given = load(scenario) if isinstance(scenario, str) else scenario
    name = Path(scenario).stem if isinstance(scenario, str) else "scenario"
    return build_steps(given, name, target, Path(folder), executable=executable, fmus=fmu)
