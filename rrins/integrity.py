"""Trust in the navigation under faults, from Python: random cases, and the FMEDA of a unit."""

from __future__ import annotations

import threading
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from rrins.host_tools.campaigns.engines import processors
from rrins.host_tools.files import JsonObject
from rrins.host_tools.integrity.fmeda.rates import load
from rrins.host_tools.integrity.fmeda.study import WINDOW_S, Fmeda
from rrins.host_tools.integrity.study import Study
from rrins.notebook import html_of, let_figures_show
from rrins.run import Source
from rrins.scenarios import load_scenario

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from rrins.host_tools.scenario.typed_keys import TimedKeys


class IntegrityStudy:
    """Random cases: the error against the bound that the unit states.

    Attributes
    ----------
    study : Study
    """

    def __init__(self, study: Study) -> None:
        self.study = study

    @property
    def values(self) -> JsonObject:
        """All figures, as `rrins integrity --json` prints them."""
        return self.study.values()

    @cached_property
    def cases(self) -> pd.DataFrame:
        """A row for each case: its faults, seconds misleading, sound sensors left out."""
        import pandas as pd

        rows = [
            {
                "case": one.case.number,
                "kind": one.case.kind,
                "faults": one.case.words,
                "seconds": one.seconds,
                "available": one.available,
                "degraded": one.degraded,
                "misleading": sum(one.misleading),
                "error_over_bound": one.excess,
                "to_alert_s": one.to_alert_s,
                "sound_left_out": ", ".join(one.sound_left_out),
                "ended": one.ended,
            }
            for one in self.study.results
        ]
        return pd.DataFrame(rows).set_index("case")

    def plot(self) -> Figure:
        """Draw the Stanford diagrams: seconds by error and bound."""
        from rrins.host_tools.integrity.pictures import stanford_figure

        let_figures_show()
        return stanford_figure(self.study.counts, self.study.alerts)

    def save(self, folder: str | Path) -> list[Path]:
        """Write page, picture and the scenarios of the cases to look at; return the first two."""
        place = Path(folder)
        place.mkdir(parents=True, exist_ok=True)
        paths, _ = self.study.write(place)
        return paths

    def __repr__(self) -> str:
        misleading = len(self.study.misleading)
        return f"<rrins.IntegrityStudy {misleading} of {len(self.study.results)} cases misleading>"

    def _repr_html_(self) -> str:
        return html_of(self, self.cases)


def study_integrity(
    *scenarios: Source,
    cases: int = 200,
    seed: int = 1,
    workers: int | None = None,
    **changes: Unpack[TimedKeys],
) -> IntegrityStudy:
    """Compare the error with its protection level in random cases, faults included.

    Parameters
    ----------
    *scenarios : str, Path, mapping or Scenario
        As in `load_scenario`: seed and faults are drawn, and they take turns. Without any, sites,
        motions, sensors and aids are drawn, too.
    cases : int
    seed : int
    workers : int, optional
        Threads; one for each processor without.
    **changes
        Keys of the scenarios, as in `load_scenario`.

    Raises
    ------
    RehearsalError
        One line: what is wrong. A case that misleads is a result.
    """
    bases = [(_name_of(one), load_scenario(one, **changes)) for one in scenarios]
    study = Study(cases, seed, bases)
    study.run(workers or processors(), threading.Event())
    return IntegrityStudy(study)


def _name_of(scenario: Source) -> str:
    return str(scenario) if isinstance(scenario, str | Path) else "scenario"


class FmedaStudy:
    """A unit's failures and their consequences, weighted by their rates.

    Attributes
    ----------
    study : Fmeda
    """

    def __init__(self, study: Fmeda) -> None:
        self.study = study

    @property
    def values(self) -> JsonObject:
        """All figures, as `rrins fmeda --json` prints them."""
        return self.study.values()

    @cached_property
    def cells(self) -> pd.DataFrame:
        """A row for each mode of each part in each phase, as in the CSV file."""
        import pandas as pd

        return pd.DataFrame(self.study.table.csv_rows())

    @cached_property
    def parts(self) -> pd.DataFrame:
        """Failures in 1e9 h: all, safe, dangerous detected and undetected; a row for each part."""
        import pandas as pd

        table = self.study.table
        rows = {**table.by_part, "unit": table.unit}
        return pd.DataFrame(
            {name: {"all": row.fit} | row.rates_fit() for name, row in rows.items()}
        ).T

    def save(self, folder: str | Path) -> list[Path]:
        """Write page, CSV and the scenarios of the worst runs; return the first two."""
        place = Path(folder)
        place.mkdir(parents=True, exist_ok=True)
        return self.study.write(place)

    def __repr__(self) -> str:
        return f"<rrins.FmedaStudy {self.study.name}: {len(self.study.findings)} runs>"

    def _repr_html_(self) -> str:
        return html_of(self, self.parts)


def fmeda(
    scenario: Source = "drive_outage",
    *,
    rates: str | Path | None = None,
    runs: int = 3,
    seed: int = 1,
    window_s: int = WINDOW_S,
    alert_m: float | None = None,
    workers: int | None = None,
    **changes: Unpack[TimedKeys],
) -> FmedaStudy:
    """Let each failure mode befall each part in each phase; return what becomes of it.

    Parameters
    ----------
    scenario : str, Path, mapping or Scenario
        As in `load_scenario`.
    rates : str or Path, optional
        TOML file with failure modes and rates; the example of `rrins fmeda --show-rates` without.
    runs : int
        Of each mode, part and phase.
    seed : int
        Of the first run.
    window_s : int
        For how long a failure is followed, at most.
    alert_m : float, optional
        Horizontal error that is dangerous; the scenario's alert limit without.
    workers : int, optional
        Threads; one for each processor without.
    **changes
        Keys of the scenario, as in `load_scenario`.

    Raises
    ------
    RehearsalError
        One line: what is wrong.
    """
    loaded = load_scenario(scenario, **changes)
    known = load(None if rates is None else Path(rates))
    limit_m = loaded.integrity.horizontal_alert_m if alert_m is None else alert_m
    study = Fmeda(_name_of(scenario), loaded, known, limit_m, runs, seed, window_s)
    study.run(workers or processors(), threading.Event())
    return FmedaStudy(study)
