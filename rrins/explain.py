"""The error of a run at an instant, split by its sources: what `Run.explain` returns."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.explanation import words
from rrins.host_tools.explanation.check import Check, check
from rrins.host_tools.explanation.explain import By, explain, runs_of
from rrins.host_tools.explanation.explain import Explanation as _Explanation
from rrins.host_tools.explanation.picture import draw
from rrins.host_tools.explanation.reruns import QUANTITIES
from rrins.host_tools.explanation.results import write
from rrins.host_tools.rounding import rounded
from rrins.host_tools.terminal import new_console, progress_line
from rrins.notebook import html_of, is_notebook, let_figures_show

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from rrins.compiled.record import Floats
    from rrins.host_tools.runs.run import RunResult


class Explanation:
    """The error of a run at an instant, and what each source contributes to it.

    Attributes
    ----------
    name : str
        Of the scenario.
    time_s : float
        Since navigation began.
    found : rrins.host_tools.explanation.explain.Explanation
        Arrays: the error and the parts over time until then.
    check : Check or None
        The comparison with the linear error equations, if it was asked for.
    """

    def __init__(self, name: str, found: _Explanation, checked: Check | None) -> None:
        self.name, self.found, self.check = name, found, checked
        self.time_s = found.time_s

    @property
    def error(self) -> pd.Series:
        """The error: `east_m` to `heading_arcsec`."""
        return _series(self.found.error[-1])

    @property
    def rest(self) -> pd.Series:
        """The error of a unit without any of the sources: counts, computing, motion."""
        return _series(self.found.rest[-1])

    @property
    def together(self) -> pd.Series:
        """The part that only three and more sources give together."""
        return _series(self.found.together)

    @property
    def parts(self) -> pd.DataFrame:
        """The contributions by `source` and `part`, the largest first; `share` of the position.

        With `rest` and `together` they add up to `error`.
        """
        import pandas as pd

        parts = [one for _, of_source in self.found.by_size() for one in of_source]
        names = [(one.source, one.part) for one in parts]
        index = pd.MultiIndex.from_tuples(names, names=["source", "part"])
        values = np.array([one.value for one in parts]).reshape(-1, len(QUANTITIES))
        table = pd.DataFrame(values, index, list(QUANTITIES))
        return table.assign(share=[self.found.share(one.value, "position") for one in parts])

    def plot(self, of: str = "position") -> Figure:
        """Draw what contributes to the error of "position", "velocity" or "attitude"."""
        let_figures_show()
        return draw(self.found, words.headline(self.found, self.name, of), of)

    def save(self, folder: str | Path, of: str = "position") -> list[Path]:
        """Write `explain.csv` and `explain.png` into a folder; return their paths."""
        return write(self.found, Path(folder), words.headline(self.found, self.name, of), of)

    def __repr__(self) -> str:
        headline = words.headline(self.found, self.name, "position")
        sources = self.found.by_size()
        largest = f"; first of all by {sources[0][0]}" if sources else ""
        return f"<rrins.Explanation: {headline}{largest}>"

    def _repr_html_(self) -> str:
        return html_of(self, self.parts)


def _series(values: Floats) -> pd.Series:
    import pandas as pd

    return pd.Series(values, list(QUANTITIES))


def explain_run(
    result: RunResult, time_s: float, by: By, is_checked: bool, progress: bool | None
) -> Explanation:
    """Split the error of a run; see `Run.explain`."""
    if not np.isfinite(time_s) or time_s < 0:
        raise RehearsalError(f"explain: {time_s} s is not an instant after navigation began")
    console = new_console(stderr=not is_notebook())
    shown = console.is_terminal or console.is_jupyter if progress is None else progress
    with progress_line(console, quiet=not shown) as line:
        task = line.add_task("running", total=runs_of(result.scenario, by))
        found = explain(
            result.scenario, time_s, by, lambda done: line.update(task, completed=done), workers=0
        )
    _check_same(result, found)
    return Explanation(result.name, found, check(result.scenario, found) if is_checked else None)


def _check_same(result: RunResult, found: _Explanation) -> None:
    """Raise RehearsalError unless the rerun has the run's error, to the bit."""
    errors = result.errors
    at = int(np.argmin(np.abs(errors.time_s - found.time_s)))
    ours = np.array([errors.position_east_m[at], errors.position_north_m[at]])
    if not np.array_equal(ours, found.error[-1, :2]):
        here, there = (float(np.hypot(*pair)) for pair in (ours, found.error[-1, :2]))
        raise RehearsalError(
            f"explain: run again, the scenario gives {rounded(there, 4)} m instead of this run's "
            f"{rounded(here, 4)} m: it had live faults, frames that came late, or a program of "
            "your own"
        )
