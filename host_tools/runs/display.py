"""The progress of a run: a live line in a terminal, a line now and then elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import Self

from rich.console import Console

from rrins.host_tools.files import JsonObject
from rrins.host_tools.rounding import rounded, with_unit
from rrins.host_tools.runs.results.results import east_north_m
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.terminal import print_line, progress_line

_SPARSE_STEPS = 10


class RunDisplay:
    """The progress of a run: simulated time, speed, mode, position of the scheme, error so far.

    Parameters
    ----------
    console : rich.console.Console
        On standard error, so that standard output is free for results.
    quiet : bool
        Whether to show nothing.
    line : callable, optional
        Shows the progress as a line that it writes anew, where there is no terminal.
    """

    def __init__(
        self,
        scenario: Scenario,
        console: Console,
        quiet: bool = False,
        line: Callable[[str], None] | None = None,
    ) -> None:
        self._scenario = scenario
        self._console = console
        self._is_quiet = quiet
        self._line = None if quiet else line
        self._is_sparse = not console.is_terminal and not quiet and line is None
        self._shown = 0
        self._noted: set[str] = set()
        self._compiling: dict[str, int] = {}
        self._where: dict[str, JsonObject] = {}  # by side, its latest report
        self._error_m: float | None = None
        self._progress = progress_line(console, quiet or not console.is_terminal)
        self._task = self._progress.add_task(
            "starting", total=scenario.epochs, state=(), start=False
        )

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._progress.stop()

    def say(self, text: str) -> None:
        """Show a step without measurable progress."""
        self._progress.update(self._task, description=text)
        if self._line is not None:
            self._line(text)
        if self._is_sparse:
            print_line(self._console, text, highlight=False)

    def note(self, text: str) -> None:
        """Show a line that the user must not miss; once, though both sides may say it."""
        if text in self._noted:
            return
        self._noted.add(text)
        print_line(self._console, f"rrins: {text}", highlight=False, markup=False)

    def compiling(self, side: str, functions: int) -> None:
        """Show that a side compiles, and how many functions it has begun."""
        if not self._compiling and not self._is_quiet and self._line is None:
            most = "two minutes" if self._scenario.estimator.enabled else "half a minute"
            self._console.print(
                f"compiling, up to {most} on two cores; later starts load what is compiled"
            )
        self._compiling[side] = functions
        counts = ", ".join(f"{side} {count}" for side, count in sorted(self._compiling.items()))
        text = f"compiling functions: {counts}"
        self._progress.update(self._task, description=text)
        if self._line is not None:
            self._line(f"{text}; later starts load what is compiled now")

    def report(self, report: JsonObject) -> None:
        """Show a report of one of the sides (see `rrins.host_tools.runs.results.pipe`)."""
        kind = report["kind"]
        if kind == "preparing" and report["side"] == "firmware":
            self.say("preparing")
        elif kind == "compiling":
            self.compiling(report["side"], report["functions"])
        elif kind == "started":
            self._progress.start_task(self._task)
            self.say("running")
        elif kind == "note":
            self.note(report["text"])
        elif kind == "progress":
            self._follow(report)

    def progress(self, firmware: JsonObject, hardware: JsonObject) -> None:
        """Show where the firmware is, and its error by the hardware's truth."""
        self._note_error(firmware, hardware)
        self._show(firmware)

    def _follow(self, report: JsonObject) -> None:
        """Show a side's report; the error is known once both have reported an epoch."""
        self._where[report["side"]] = report
        firmware, hardware = self._where.get("firmware"), self._where.get("hardware")
        if firmware and hardware and firmware["epoch"] == hardware["epoch"]:
            self._note_error(firmware, hardware)
        if report["side"] == "firmware":
            self._show(report)

    def _note_error(self, firmware: JsonObject, hardware: JsonObject) -> None:
        if not firmware["navigating"]:
            return
        east, north = east_north_m(
            firmware["latitude"],
            firmware["longitude"],
            hardware["latitude"],
            hardware["longitude"],
            0.0,
        )
        self._error_m = float((east**2 + north**2) ** 0.5)

    def _show(self, firmware: JsonObject) -> None:
        epoch, mode, state = firmware["epoch"], _mode_of(firmware), self._state(firmware)
        self._progress.update(self._task, completed=epoch, description=mode, state=state)
        if self._line is not None:
            percent = epoch * 100 // self._scenario.epochs
            self._line(f"{percent:3d} %  {'  '.join((mode, *state))}")
        share = epoch * _SPARSE_STEPS // self._scenario.epochs
        if self._is_sparse and share > self._shown:
            self._shown = share
            text = f"{share * 100 // _SPARSE_STEPS:3d} %  {'  '.join((mode, *state))}"
            self._console.print(text, highlight=False, soft_wrap=True)

    def _state(self, firmware: JsonObject) -> list[str]:
        """Return where the run is, the most important first."""
        seconds = firmware["epoch"] / self._scenario.rate_hz
        parts = [f"{seconds:.0f} s"]
        if self._error_m is not None:
            parts.append(f"error {with_unit(self._error_m, 'm')}")
        elapsed_s = self._progress.tasks[0].elapsed
        if elapsed_s:
            parts.append(f"{rounded(seconds / elapsed_s)} × real time")
        if firmware["position"]:
            parts.append(f"position {firmware['position']}")
        return parts


def _mode_of(firmware: JsonObject) -> str:
    mode = str(firmware["mode"]).lower().replace("_", " ")
    if firmware["fault"] == "NONE":
        return mode
    return f"{mode} ({firmware['fault'].lower().replace('_', ' ')})"
