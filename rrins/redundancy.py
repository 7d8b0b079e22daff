"""Detection limits of redundant sensors, from Python."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.redundancy.candidates import candidates_of, title_of
from rrins.host_tools.redundancy.survey import Study
from rrins.notebook import html_of, let_figures_show

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class RedundancyStudy:
    """Which faults sets of redundant sensors find, and how soon: by theory, and by runs.

    Attributes
    ----------
    study : Study
    title : str
    runs : int
        Of the Monte Carlo.
    """

    def __init__(self, study: Study, title: str, runs: int) -> None:
        self.study, self.title, self.runs = study, title, runs

    @property
    def values(self) -> JsonObject:
        """All figures, as `rrins redundancy --json` prints them."""
        return self.study.values()

    @cached_property
    def smallest(self) -> pd.DataFrame:
        """The smallest step of a sensor that is found within a time, by theory: a row for each."""
        import pandas as pd

        rows = [
            {
                "geometry": survey["name"],
                "kind": kind,
                "unit": survey[kind]["unit"],
                "sensors": ", ".join(map(str, group["sensors"])),
                "way": way,
                "within_s": float(within.removesuffix("_s")),
                "half_of_faults": pair["half"],
                "95_percent_of_faults": pair["95_percent"],
            }
            for survey, kind, group in self._groups()
            for way, found in group["smallest"].items()
            for within, pair in found.items()
        ]
        return pd.DataFrame(rows)

    @cached_property
    def delays(self) -> pd.DataFrame:
        """After how many seconds a step is noticed or isolated, median and 95 %: a row for each."""
        import pandas as pd

        rows: list[dict[str, Any]] = []
        for survey, kind, group in self._groups():
            place = {
                "geometry": survey["name"],
                "kind": kind,
                "unit": survey[kind]["unit"],
                "sensors": ", ".join(map(str, group["sensors"])),
            }
            for one in group["delays_s"]:
                tried = one["monte_carlo"] or {}
                for way, pair in one["theory"].items():
                    rows.append(
                        place
                        | {"fault": one["fault"], "way": way}
                        | {f"theory_{name}_s": value for name, value in pair.items()}
                        | {f"runs_{name}_s": value for name, value in tried.get(way, {}).items()}
                    )
        return pd.DataFrame(rows)

    def _groups(self) -> list[tuple[JsonObject, str, JsonObject]]:
        return [
            (survey, kind, group)
            for survey in self.values["candidates"]
            for kind in ("gyros", "accelerometers")
            for group in survey[kind]["groups"]
        ]

    def plot(self) -> Figure:
        """Draw the delays over the size of the fault, theory and runs."""
        from rrins.host_tools.redundancy.pictures import delays_figure

        let_figures_show()
        return delays_figure(self.study.surveys)

    def save(self, folder: str | Path) -> list[Path]:
        """Write the report and its picture into a folder; return their paths."""
        from rrins.host_tools.redundancy.report import write

        place = Path(folder)
        place.mkdir(parents=True, exist_ok=True)
        return write(place, self.study, self.runs, self.title)

    def __repr__(self) -> str:
        names = ", ".join(survey.candidate.name for survey in self.study.surveys)
        return f"<rrins.RedundancyStudy {names}: {self.title}, {self.runs} runs>"

    def _repr_html_(self) -> str:
        return html_of(self, self.smallest, has_index=False)


def study_redundancy(
    scenario: str | Path | None = None,
    geometries: Sequence[str | Path] = (),
    preset: str | None = None,
    *,
    false_alarms_per_1000_h: float | None = None,
    gyro_steps_dph: Sequence[float] = (),
    accelerometer_steps_ug: Sequence[float] = (),
    runs: int = 20,
    seed: int = 1,
) -> RedundancyStudy:
    """Study which faults a set of redundant sensors finds, and how soon.

    Parameters
    ----------
    scenario : str or Path, optional
        Its sensors, noise, motion and promise; without it `preset` at rest on the turning table.
    geometries : sequence of str or Path
        Built in, or TOML files with the sensor axes; several are compared.
    preset : str, optional
        Sensors, as `sensors` of a scenario; the prototype's without it.
    false_alarms_per_1000_h : float, optional
        Promised.
    gyro_steps_dph, accelerometer_steps_ug : sequence of float
        Faults to try; round ones without them.
    runs : int
        Of the Monte Carlo beside the theory; at least 1.
    seed : int
        Of the first run.

    Raises
    ------
    RehearsalError
        One line: what is wrong.
    """
    if runs < 1:
        raise RehearsalError(f"redundancy: {runs} runs; theory takes at least one beside it")
    name = None if scenario is None else str(scenario)
    axes = tuple(str(geometry) for geometry in geometries)
    candidates = candidates_of(name, axes, preset, false_alarms_per_1000_h)
    sizes = {
        "gyros": sorted(set(gyro_steps_dph)),
        "accelerometers": sorted(set(accelerometer_steps_ug)),
    }
    study = Study(candidates, sizes)
    study.run(runs, seed, threading.Event())
    return RedundancyStudy(study, title_of(name, preset), runs)
