"""Campaigns from Python: thousands of runs as a table, their figures, each run again."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, Unpack

from rrins.host_tools.campaigns import running
from rrins.host_tools.campaigns.comparison import Comparison, compare
from rrins.host_tools.campaigns.definition import Wishes, load
from rrins.host_tools.campaigns.rerun import rerun as rerun_run
from rrins.host_tools.campaigns.row import MAIN
from rrins.host_tools.campaigns.statistics import PERCENTILES
from rrins.host_tools.campaigns.store import Store
from rrins.host_tools.campaigns.summary import SHOWN, Outcomes, circles, far
from rrins.host_tools.campaigns.until import Until
from rrins.host_tools.rounding import rounded
from rrins.host_tools.runs.display import RunDisplay
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.terminal import new_console, progress_line
from rrins.notebook import NotebookLine, is_notebook
from rrins.run import Run
from rrins.scenarios import load_scenario

if TYPE_CHECKING:
    import pandas as pd

    from rrins.host_tools.campaigns.conduct import Progress
    from rrins.host_tools.scenario.typed_keys import SharedKeys


class Campaign:
    """Runs of a scenario that differ; what is stored in its folder is not run again.

    Parameters
    ----------
    source : str, Path, mapping or Scenario
        A campaign's TOML file, or a scenario as in `load_scenario`.
    runs, seed : int, optional
        100 runs and 1, or what the file says.
    vary : mapping of str to str, optional
        Keys of the scenario, and what each is drawn from:
        ``{"gyros.bias_dph": "normal(0, 0.1)"}``.
    faults : sequence of mapping
        Faults in every run; their values may be distributions.
    correlate : sequence of (str, str, float)
    design : str, optional
        ``random``, ``lhs``, ``sobol``, ``saltelli``, ``grid`` or ``one-at-a-time``.
    out : str or Path, optional
        Folder; ``out/campaigns/NAME`` without it.
    duration_s : float, optional
        Other than the scenario's or the file's.
    **changes
        Keys that all runs have, as in `load_scenario`; not for a campaign's file.

    Raises
    ------
    RehearsalError
        One line: what is wrong.

    Examples
    --------
    >>> campaign = Campaign("rimu_rotating", runs=200, vary={"gyros.bias_dph": "normal(0, 0.1)"})
    >>> campaign.store.definition.runs
    200
    """

    def __init__(
        self,
        source: str | Path | Mapping[str, Any] | Scenario,
        *,
        runs: int | None = None,
        seed: int | None = None,
        vary: Mapping[str, str] | None = None,
        faults: Sequence[Mapping[str, Any]] = (),
        correlate: Sequence[tuple[str, str, float]] = (),
        design: str | None = None,
        out: str | Path | None = None,
        duration_s: float | None = None,
        **changes: Unpack[SharedKeys],
    ) -> None:
        named: str | Mapping[str, Any] | Scenario = (
            str(source) if isinstance(source, Path) else source
        )
        wishes = Wishes(
            runs=runs,
            seed=seed,
            design=design,
            duration_s=duration_s,
            vary=vary or {},
            correlate=correlate,
            faults=faults,
        )
        if changes:
            named = load_scenario(named, **changes)
        definition = load(named, wishes)
        name = str(source) if isinstance(source, str | Path) else definition.name
        folder = Path("out/campaigns") / Path(name).stem if out is None else Path(out)
        self.store = Store(folder, definition)

    @classmethod
    def open(cls, folder: str | Path) -> Self:
        """Return the campaign that a folder has.

        Raises
        ------
        RehearsalError
        """
        campaign = cls.__new__(cls)
        campaign.store = Store.open(Path(folder))
        return campaign

    @property
    def folder(self) -> Path:
        """Where its rows are."""
        return self.store.folder

    def run(
        self,
        workers: int | str | None = None,
        *,
        engine: str | None = None,
        scheduler_file: str | Path | None = None,
        until: str | None = None,
        progress: bool | None = None,
    ) -> Self:
        """Run what is left of it; return itself.

        Parameters
        ----------
        workers : int or str, optional
            Number, or the address of a Dask scheduler; by default one for each processor.
        engine : {"threads", "processes", "dask"}, optional
        scheduler_file : str or Path, optional
            That a Dask scheduler wrote.
        until : str, optional
            Enough: ``"p95 of horizontal_error_m within 10 %"``.
        progress : bool, optional
            Whether to show progress; in a terminal or notebook by default.

        Raises
        ------
        RehearsalError
            When it cannot begin or go on; what is stored stays.
        """
        file = None if scheduler_file is None else Path(scheduler_file)
        chosen = running.Workers.of(workers, engine, file)
        criterion = None if until is None else Until.parse(until)
        self.store = Store.create(self.store.folder, self.store.definition)
        console = new_console(stderr=True)
        runs = self.store.definition.runs
        note = NotebookLine().show if is_notebook() and progress is not False else None
        with progress_line(console, quiet=progress is False) as line:
            task = line.add_task("campaign", total=runs)

            def show(now: Progress) -> None:
                rate = f"{rounded(now.rate)} runs/s"
                line.update(task, completed=now.stored, state=(rate,))
                if note is not None:
                    note(f"{now.stored} of {runs} runs  {rate}")

            stop = threading.Event()
            running.run(self.store, chosen, criterion, on_progress=show, stop=stop)
        return self

    def table(self, *columns: str) -> pd.DataFrame:
        """Return the rows, one a run: inputs, outputs, status, error, seed; or some columns."""
        found = self.store.table(columns or None).to_pandas()
        return found.set_index("run")

    def percentiles(
        self, percents: Sequence[float] = PERCENTILES, columns: Sequence[str] = SHOWN
    ) -> pd.DataFrame:
        """Return percentiles of outputs with their intervals of 95 % confidence.

        A row for each output and percentile: `value`, `low`, `high`.
        """
        import pandas as pd

        outcomes = Outcomes(self.store, columns)
        rows = {
            (name, percent): outcomes.sample(name).percentile(percent).values()
            for name in outcomes.known()
            for percent in percents
        }
        index = pd.MultiIndex.from_tuples(list(rows), names=["output", "percent"])
        return pd.DataFrame(list(rows.values()), index=index)

    def cep(self) -> pd.DataFrame:
        """Return CEP50 and R95 of the horizontal error at the end, m, with their intervals."""
        import pandas as pd

        found = circles(Outcomes(self.store))
        return pd.DataFrame({name: one.values() for name, one in found.items()}).T

    def far_percentile(self, percent: float = 99.9, output: str = MAIN) -> dict[str, float | None]:
        """Return a percentile that few runs exceed, by a fitted tail, with its interval of 95 %.

        `value`, `low`, `high`; None each for fewer than 400 runs, and for runs with noise in
        common. See `rrins.host_tools.campaigns.tail`.

        Raises
        ------
        RehearsalError
            For a percentile that is not between 90 and 100.
        """
        return far(Outcomes(self.store, (output,)), output, percent).values()

    def sensitivity(self, output: str | None = None) -> pd.DataFrame:
        """Return which input matters: a row for each input, the largest first.

        For a campaign of design ``saltelli`` Sobol's indices of an output, by default the
        horizontal error: `first` and `total`. Else linear shares in the variance of an output, by
        default the position to the east: `share`, `low`, `high`, `sigma`.

        Raises
        ------
        RehearsalError
        """
        import pandas as pd

        from rrins.host_tools.campaigns import sensitivity

        if self.store.definition.design == "saltelli":
            indices = sensitivity.sobol_indices(self.store, output or MAIN)
            rows = {one.name: (one.first.value, one.total.value) for one in indices}
            return pd.DataFrame.from_dict(rows, orient="index", columns=["first", "total"])
        shares = sensitivity.linear_shares(self.store, output or sensitivity.LINEAR_OUTPUTS[0])
        found = {one.name: one.share.values() | {"sigma": one.sigma} for one in shares}
        return pd.DataFrame.from_dict(found, orient="index").rename(columns={"value": "share"})

    def compare(self, other: Campaign, output: str = MAIN) -> Comparison:
        """Return how an output differs from that of another campaign, with a test."""
        return compare(self.store, other.store, output)

    def report(self, out: str | Path | None = None) -> list[Path]:
        """Write the HTML report and its pictures; return their paths, the report first."""
        from rrins.host_tools.campaigns.report import write

        return write(self.store, None if out is None else Path(out))

    def rerun(self, run: int, *, bus: bool = False, record: str | Path | None = None) -> Run:
        """Run one of its runs again, with everything kept; as two processes on a bus if wanted.

        Raises
        ------
        RehearsalError
        """
        console = new_console(stderr=True)
        quiet = not console.is_terminal
        path = None if record is None else Path(record)
        again = rerun_run(
            self.store, run, lambda one: RunDisplay(one, console, quiet=quiet), bus, path
        )
        return Run(again.result)

    def __repr__(self) -> str:
        definition = self.store.definition
        return f"<rrins.Campaign {definition.name}: {definition.runs} runs, {self.folder}>"
