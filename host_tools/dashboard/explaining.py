"""Says why the error that the page shows is what it is: the run again, with its live faults."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from rrins.host_tools.dashboard.errors import DashboardError
from rrins.host_tools.dashboard.quantities import NAMES
from rrins.host_tools.dashboard.view import View
from rrins.host_tools.explanation import words
from rrins.host_tools.explanation.explain import Explanation, explain, runs_of
from rrins.host_tools.explanation.reruns import StoppedError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.rounding import labelled, rounded
from rrins.host_tools.scenario.scenario import Scenario

_ERRORS: Final = tuple(NAMES.index(name) for name in ("error_east_m", "error_north_m"))
_NEAR_S: Final = 1.0  # between the instant and a row of the history
_ALIKE_M: Final = 0.05
_ALIKE: Final = 0.02  # of the error


class Explainer:
    """Explains one error at a time; a new question ends the work on the one before."""

    def __init__(self) -> None:
        self._stop = threading.Event()
        self._asking = asyncio.Lock()
        self._view: View | None = None
        self._faults: list[JsonObject] = []  # live ones of the view's run, as keys of `[[faults]]`

    def note(self, report: list[JsonObject] | None, view: View) -> None:
        """Note which live faults the hardware reports as active."""
        if report is None:
            return
        if view is not self._view:
            self._view, self._faults = view, []
        active = [one["keys"] | {"at_s": one["at_s"]} for one in report]
        for fault in self._faults:
            if "for_s" not in fault and fault not in active:
                fault["for_s"] = max(view.time_s - fault["at_s"], 0.01)
        own = [] if view.scenario is None else view.scenario.faults
        planned = [fault.model_dump(exclude_unset=True) for fault in own]
        self._faults += [one for one in active if one not in self._faults + planned]

    async def explain(
        self, view: View, time_s: float, on_progress: Callable[[int, int], None]
    ) -> JsonObject:
        """Return the explanation of the error at an instant on the bus.

        Raises
        ------
        RehearsalError
            One line: why there is none.
        """
        if view.scenario is None:
            raise DashboardError("explain: needs the scenario; name what runs here")
        faults = self._faults if view is self._view else []
        scenario = _with_faults(view.scenario, faults)
        self._stop.set()  # the question before
        async with self._asking:
            self._stop = stop = threading.Event()
            runs = runs_of(scenario, "source")
            try:
                found = await asyncio.to_thread(
                    explain,
                    scenario,
                    time_s,
                    "source",
                    lambda done: on_progress(done, runs),
                    stop.is_set,
                    from_power_on=True,
                )
            except StoppedError:
                raise DashboardError("explain: another instant was asked about") from None
        return _told(found, view, scenario.title, time_s)


def _with_faults(scenario: Scenario, faults: list[JsonObject]) -> Scenario:
    if not faults:
        return scenario
    own = [fault.model_dump(exclude_unset=True) for fault in scenario.faults]
    return scenario.varied(faults=[*own, *faults])


def _told(found: Explanation, view: View, title: str, time_s: float) -> JsonObject:
    """Return what the page shows."""
    tables = []
    for of, components in words.COMPONENTS.items():
        unit, rows = words.table_rows(found, of)
        shares = [*(share for *_, share in found.rows(of)), 1.0]
        tables.append(
            {
                "of": of,
                "headings": [labelled(side, unit) for side in components],
                "headline": words.headline(found, title, of).partition(":")[0],
                "share_of": words.SHARE_OF[of],
                "rows": [
                    {"cells": row, "share": share} for row, share in zip(rows, shares, strict=True)
                ],
            }
        )
    note = _difference(found, view, time_s)
    return {"title": tables[0]["headline"], "tables": tables, "note": note}


def _difference(found: Explanation, view: View, time_s: float) -> str:
    """Return a line if the run that was watched had another error than its rerun."""
    times, rows = view.history.rows()
    if not len(times):
        return ""
    at = int(np.argmin(np.abs(times - time_s)))
    shown: Any = rows[at, list(_ERRORS)]
    if abs(times[at] - time_s) > _NEAR_S or not np.isfinite(shown).all():
        return ""
    seen, again = float(np.hypot(*shown)), float(np.hypot(*found.error[-1, :2]))
    if abs(seen - again) <= _ALIKE_M + _ALIKE * max(seen, again):
        return ""
    return (
        f"The run shown was off by {rounded(seen)} m: modes asked for, frames lost or faults given "
        "by others are not in the run that is explained"
    )
