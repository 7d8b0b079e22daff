"""Runs one run of a campaign again, with everything kept; over the bus as well."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.row import Row
from rrins.host_tools.campaigns.store import RERUNS, Store
from rrins.host_tools.files import make_folder, write_text
from rrins.host_tools.runs.display import RunDisplay
from rrins.host_tools.runs.run import Plan, RunResult, rehearse, simulate
from rrins.host_tools.scenario.scenario import Scenario

SCENARIO = "scenario.toml"
_SAME = ("position_east_m", "position_north_m")


@dataclass(frozen=True)
class Rerun:
    """A run that was run again."""

    folder: Path  #: where everything of it is
    result: RunResult
    row: Row | None  #: the row that the campaign has of it; None if it has none yet
    #: whether it ended to the bit as the row says; None without a row that came to its end
    is_same: bool | None


def row_stored(store: Store, run: int) -> Row | None:
    """Return the row of a run; None if it is not stored."""
    import pyarrow.compute as pc

    if not store.parts():
        return None
    table = store.table(["status", *_SAME])
    found = table.filter(pc.equal(table["run"], run)).to_pylist()
    return found[0] if found else None


def rerun(
    store: Store,
    run: int,
    make_display: Callable[[Scenario], RunDisplay],
    on_bus: bool = False,
    record: Path | None = None,
    folder: Path | None = None,
) -> Rerun:
    """Run a run of a campaign again; write its scenario, errors, pictures and summary.

    Parameters
    ----------
    store : Store
    run : int
    make_display : callable
        Shows the progress of a scenario.
    on_bus : bool
        As two processes on the embedded bus, else in this process.
    record : Path, optional
        Log of the bus.
    folder : Path, optional
        By default that of the run in the campaign's folder.

    Raises
    ------
    RehearsalError
        When it cannot run; that the run ends in FAULT is a result.
    """
    runs = store.definition.runs
    if not 0 <= run < runs:
        raise CampaignError(f"rerun {run}: the runs are 0 to {runs - 1}")
    scenario = store.definition.scenario_of(run)
    folder = folder or store.folder / RERUNS / str(run)
    make_folder(folder)
    file = folder / SCENARIO
    write_text(file, scenario.toml())
    with make_display(scenario) as display:
        if on_bus or record is not None:
            result = rehearse(Plan(str(file), scenario), display, folder, record)
        else:
            result = simulate(str(file), scenario, display, folder)
    result.write(folder)
    if result.failure is not None:
        raise result.failure
    row = row_stored(store, run)
    return Rerun(folder, result, row, _is_same(row, result))


def _is_same(row: Row | None, result: RunResult) -> bool | None:
    if row is None or row["status"] != "ok" or not len(result.errors):
        return None
    errors = result.errors
    ours = (float(errors.position_east_m[-1]), float(errors.position_north_m[-1]))
    return ours == (row["position_east_m"], row["position_north_m"])
