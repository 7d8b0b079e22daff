"""The linear covariance analysis from Python: σ of the navigation over time, and tolerances."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from rrins.campaign import Campaign
from rrins.host_tools.campaigns import covariance_report as report
from rrins.host_tools.campaigns import front, least_cost
from rrins.host_tools.campaigns.definition import Wishes
from rrins.host_tools.campaigns.store import Store, is_campaign
from rrins.host_tools.covariance.analysis import Analysis
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.rounding import rounded
from rrins.notebook import html_of, let_figures_show
from rrins.scenarios import load_scenario

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from rrins.host_tools.scenario.scenario import Scenario
    from rrins.host_tools.scenario.typed_keys import SharedKeys


class CovarianceAnalysis:
    """σ of the navigation over time, of all error sources and of each.

    Attributes
    ----------
    analysis : Analysis
        Arrays: `times_s`, `mean`, `sigma`, `sigmas`, `filter_sigmas`, and each of `sources`.
    runs : Beside or None
        What the runs of a campaign say, where it has some.
    """

    def __init__(self, analysis: Analysis, runs: report.Beside | None) -> None:
        self.analysis, self.runs = analysis, runs

    @cached_property
    def sources(self) -> pd.DataFrame:
        """σ at the end to the east and north, the largest on the way (m), and the share of each."""
        import pandas as pd

        rows = self.analysis.values()["sources"]
        return pd.DataFrame(rows).set_index("name")

    @cached_property
    def sigma(self) -> pd.DataFrame:
        """σ of the position over `time_s`, m: columns `east_m` and `north_m`."""
        import pandas as pd

        index = pd.Index(self.analysis.times_s, name="time_s")
        return pd.DataFrame(self.analysis.sigma, index, ["east_m", "north_m"])

    @cached_property
    def quantities(self) -> pd.DataFrame:
        """σ of each quantity at the end; with the estimator, its own σ, and true over filter."""
        import pandas as pd

        return pd.DataFrame.from_dict(self.analysis.told(), orient="index")

    def over_time(self, name: str) -> pd.DataFrame:
        """Return σ of a quantity, an index of `quantities`, over `time_s`: `true` and `filter`."""
        import pandas as pd

        true, told = self.analysis.quantity(name)
        columns = {"true": true} if told is None else {"true": true, "filter": told}
        return pd.DataFrame(columns, pd.Index(self.analysis.times_s, name="time_s"))

    @property
    def agrees(self) -> bool | None:
        """Whether the analysis lies in the intervals of the runs; None where there are none."""
        return None if self.runs is None else self.runs.agrees(self.analysis)

    def plot(self) -> Figure:
        """Draw σ over time: of all, of the largest sources, and of the runs."""
        let_figures_show()
        return report.draw(self.analysis, self.runs)

    def plot_filter(self) -> Figure:
        """Draw σ over time as it is, beside that of the estimator.

        Raises
        ------
        RehearsalError
            When the scenario has no estimator.
        """
        if self.analysis.filter_sigmas is None:
            raise RehearsalError("plot_filter: the scenario has no estimator")
        let_figures_show()
        return report.draw_filter(self.analysis)

    def save(self, folder: str | Path) -> list[Path]:
        """Write `covariance.csv` and the pictures into a folder; return their paths."""
        return report.write(self.analysis, Path(folder), self.runs)

    def __repr__(self) -> str:
        east, north = self.analysis.sigma[-1]
        end_s = self.analysis.times_s[-1]
        sigma = f"σ {rounded(east)} m east, {rounded(north)} m north"
        return f"<rrins.CovarianceAnalysis after {end_s:g} s: {sigma}>"

    def _repr_html_(self) -> str:
        return html_of(self, self.sources)


def analyse_covariance(
    source: str | Path | Mapping[str, Any] | Scenario | Campaign,
    *,
    vary: Mapping[str, str] | None = None,
    true: Mapping[str, Any] | None = None,
    duration_s: float | None = None,
    **changes: Unpack[SharedKeys],
) -> CovarianceAnalysis:
    """Return σ of the navigation over time and the share of each error source, without runs.

    Parameters
    ----------
    source
        A scenario as in `load_scenario`, a campaign's TOML file, its folder, or a `Campaign`; the
        last two with their runs beside the analysis.
    vary : mapping of str to str, optional
        As `Campaign` takes it.
    true : mapping, optional
        Keys of sensors and aids as they are, such as ``gnss.position_noise_m``, where the scenario
        has what the estimator is told of them.
    duration_s : float, optional
        Other than the scenario's or the file's.
    **changes
        Keys of the scenario, as in `load_scenario`.

    Raises
    ------
    RehearsalError
        One line: what is wrong, or what cannot be analysed.
    """
    if isinstance(source, str | Path) and is_campaign(Path(source)):
        source = Campaign.open(source)
    if isinstance(source, Campaign):
        analysis = report.analysis_of(source.store.definition, true)
        return CovarianceAnalysis(analysis, report.beside_runs(source.store))
    named = load_scenario(source, **changes) if changes else source
    campaign = Campaign(named, vary=vary, duration_s=duration_s, design="random")
    return CovarianceAnalysis(report.analysis_of(campaign.store.definition, true), None)


class Allocation:
    """Tolerances of least cost that meet a requirement.

    Attributes
    ----------
    allocation : Allocation of `rrins.host_tools.campaigns.allocation`
        `requirement`, `predicted_m`, `cost`, `choices`, and `chosen`.
    """

    def __init__(self, candidates: list[least_cost.Problem]) -> None:
        self._candidates = candidates
        self.allocation = least_cost.best(candidates)

    @cached_property
    def tolerances(self) -> pd.DataFrame:
        """σ, cost, share in the variance and limit of each tolerance, the dearest first."""
        import pandas as pd

        return pd.DataFrame(self.allocation.values()["tolerances"]).set_index("key")

    @cached_property
    def front(self) -> pd.DataFrame:
        """Cost against error near the requirement: choices, σ, `predicted_m`, `cost`, `is_best`."""
        import pandas as pd

        rows = [{**p.choices, **p.sigmas, **_figures(p)} for p in front.front(self._candidates)]
        return pd.DataFrame(rows)

    def plot(self) -> Figure:
        """Draw cost against error, a line for each set of choices."""
        let_figures_show()
        return front.draw(self._candidates, front.front(self._candidates))

    def campaign(self, runs: int = 400, out: str | Path | None = None) -> Campaign:
        """Return a campaign of units with these tolerances, to confirm it."""
        definition = self.allocation.definition.with_runs(runs)
        campaign = Campaign.__new__(Campaign)
        folder = Path("out/allocated") / definition.name if out is None else Path(out)
        campaign.store = Store(folder, definition)
        return campaign

    def __repr__(self) -> str:
        found = self.allocation
        return f"<rrins.Allocation: cost {rounded(found.cost)}, {rounded(found.predicted_m)} m>"

    def _repr_html_(self) -> str:
        return html_of(self, self.tolerances)


def allocate(
    source: str | Path | Mapping[str, Any], *, duration_s: float | None = None
) -> Allocation:
    """Return the tolerances of least cost that meet the requirement of a campaign's file.

    Parameters
    ----------
    source : str, Path or mapping
        A campaign's TOML file with a table ``[allocate]``, or its keys.
    duration_s : float, optional
        Other than the file's.

    Raises
    ------
    RehearsalError
        One line: what is wrong, or that no tolerances suffice.
    """
    named = str(source) if isinstance(source, Path) else source
    return Allocation(least_cost.problems(named, Wishes(duration_s=duration_s)))


def _figures(point: front.Point) -> dict[str, Any]:
    return {name: getattr(point, name) for name in ("predicted_m", "cost", "is_best")}
