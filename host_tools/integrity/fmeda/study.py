"""The whole FMEDA of a scenario, from its rates to its files."""

from __future__ import annotations

import csv
import shlex
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from rrins.host_tools.campaigns.summary import shown
from rrins.host_tools.drawing.page import REPORT, write_report
from rrins.host_tools.errors import RehearsalError, ScenarioError
from rrins.host_tools.files import JsonObject, make_folder, write_text, write_whole
from rrins.host_tools.integrity.fmeda.rates import Rates
from rrins.host_tools.integrity.fmeda.table import DELAYS, HALF, MOST, SHARES, Cell, Table
from rrins.host_tools.integrity.fmeda.trials import Finding, run_trials, trials_of
from rrins.host_tools.integrity.words import percent
from rrins.host_tools.runs.set_up.settings import check_files, scenario_wire
from rrins.host_tools.scenario.scenario import Scenario

CSV = "fmeda.csv"
_WORST = "worst"
WINDOW_S = 300
"""For how long a failure is followed, s."""


@dataclass
class Fmeda:
    """Failure modes, effects and diagnostics of a scenario's unit."""

    name: str  #: of the scenario
    scenario: Scenario
    rates: Rates
    alert_m: float  #: horizontal; an error beyond is dangerous
    runs: int  #: of each mode, part and phase
    seed: int = 1  #: of the first run
    window_s: int = WINDOW_S
    findings: list[Finding] = field(default_factory=list)

    def __post_init__(self) -> None:
        plain = self.scenario.varied(faults=())
        check_files(plain)
        if scenario_wire(plain) is not None:
            raise ScenarioError(f"scenario {self.name}: bus.bitrate: an FMEDA runs without frames")
        self.scenario = plain
        self.trials = trials_of(plain, self.rates.modes, self.runs, self.seed)
        if not self.trials:
            raise ScenarioError(f"scenario {self.name}: has none of the parts that fail")

    @property
    def left_out(self) -> list[str]:
        """The modes of parts that the scenario does not have."""
        tried = {trial.mode.name for trial in self.trials}
        return [mode.name for mode in self.rates.modes if mode.name not in tried]

    def run(
        self,
        workers: int,
        stop: threading.Event,
        on_done: Callable[[], None] = lambda: None,
    ) -> None:
        """Run the trials; once stopped, `findings` has those that are done."""
        self.findings = run_trials(
            self.scenario, self.trials, self.window_s, self.alert_m, workers, stop, on_done
        )

    @property
    def table(self) -> Table:
        """The figures.

        Raises
        ------
        RehearsalError
            When no trial is done.
        """
        if not self.findings:
            raise RehearsalError("no run is done: nothing to report")
        return Table(self.rates, self.findings)

    def values(self) -> JsonObject:
        """Return all figures as plain values."""
        return {
            "scenario": self.name,
            "alert_m": self.alert_m,
            "window_s": self.window_s,
            "runs": self.runs,
            "seed": self.seed,
            "planned": len(self.trials),
            "done": len(self.findings),
            "left_out": self.left_out,
        } | self.table.values()

    def write(self, folder: Path) -> list[Path]:
        """Write page, CSV and the scenarios of the worst runs; return the paths of the first two.

        A page or a table of other content that is there is moved into the folder `previous`.

        Raises
        ------
        RehearsalError
            When they cannot be written.
        """
        table = self.table
        make_folder(folder / _WORST)
        commands = {}
        rows = table.csv_rows()
        for (cell, row), values in zip(table.cells.items(), rows, strict=True):
            path = folder / _WORST / f"{cell.mode}-{cell.part}-{cell.phase}.toml"
            write_text(path, row.worst.trial.scenario(self.scenario, self.window_s).toml())
            commands[cell] = f"rrins simulate {shlex.quote(str(path))}"
            values["repeat"] = commands[cell]
        modes = table.by(lambda cell: f"{cell.mode}, {cell.phase}")
        pages = write_report(
            folder,
            "rrins.host_tools.integrity.fmeda",
            {},
            keeps=(REPORT, CSV),
            filters={"shown": shown, "percent": percent},
            study=self,
            table=table,
            modes=modes,
            commands={name: commands[_cell_of(row.worst)] for name, row in modes.items()},
            shares=tuple(SHARES),
            delays=DELAYS,
            quantiles=(HALF, MOST),
        )

        def write(file: IO[str]) -> None:
            writer = csv.DictWriter(file, rows[0])
            writer.writeheader()
            writer.writerows(rows)

        write_whole(folder / CSV, write)
        return [*pages, folder / CSV]


def _cell_of(finding: Finding) -> Cell:
    trial = finding.trial
    return Cell(trial.mode.name, trial.part, trial.phase)
