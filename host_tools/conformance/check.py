"""A check, what it found, and the program that it is tried on."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rrins.host_tools.closing import Closing
from rrins.host_tools.conformance.trial import PATIENCE_S
from rrins.host_tools.files import JsonObject
from rrins.host_tools.testing.bench import Bench
from rrins.host_tools.testing.scenarios import prepare_scenario

SCENARIO = "rimu_rotating"
_ALIGNMENT_S = 1.0


class NotApplicableError(Exception):
    """The program does not have what a check is about, and need not."""


class Subject(Closing):
    """The program under test, started anew for each bench.

    Parameters
    ----------
    program : str or None
        Command line of the program; None for the project's own firmware.
    folder : Path
        Where scenarios, set-ups and what the program prints go.
    """

    def __init__(self, program: str | None, folder: Path) -> None:
        self.program = program
        self.folder = folder
        self._ends = ExitStack()
        self._numbers = itertools.count(1)

    def bench(self, scenario: str = SCENARIO, **overrides: Any) -> Bench:
        """Return a bench in lockstep, at power-on; the one before ends."""
        return self._bench("lockstep", self.program, scenario, overrides)

    def reference(self, scenario: str = SCENARIO, **overrides: Any) -> Bench:
        """Return a bench with the project's firmware in this process, at power-on."""
        return self._bench("direct", None, scenario, overrides)

    def _bench(self, way: str, program: str | None, scenario: str, changes: JsonObject) -> Bench:
        self._ends.close()
        file = self.folder / f"scenario-{next(self._numbers)}.toml"
        changes = {"firmware": {"alignment_s": _ALIGNMENT_S}} | changes
        checked = prepare_scenario(scenario, changes, file, self.folder)
        bench = Bench(checked, file, way, PATIENCE_S, program=program)
        self._ends.callback(bench.close)
        return bench

    def navigating(self, scenario: str = SCENARIO, **overrides: Any) -> Bench:
        """Return a bench whose firmware navigates with rotation.

        Raises
        ------
        AssertionError
            If it does not come so far.
        """
        bench = self.bench(scenario, **overrides)
        expect_mode(bench, "NAVIGATION_ROTATING", 8)
        return bench

    def close(self) -> None:
        """End the program."""
        self._ends.close()


def expect_mode(bench: Bench, mode: str, within: float) -> None:
    """Let time pass until the firmware reports a mode.

    Raises
    ------
    AssertionError
        If it does not.
    """
    bench.expect("FIRMWARE_STATUS", within=within, where={"mode": mode})


@dataclass(frozen=True)
class Check:
    """One demand on a navigation computer."""

    name: str  #: short, of letters and hyphens
    rule: str  #: the demand, in sentences
    page: str  #: page and anchor in the docs that state it
    #: tries it on a `Subject`; raises AssertionError when it does not hold
    run: Callable[[Subject], None]
    requirements: tuple[str, ...] = ()  #: numbers; ``RX-*-1`` is that of every message


def check(page: str, requirements: str = "") -> Callable[[Callable[[Subject], None]], Check]:
    """Return a decorator that makes a check of a function: its name, and its docstring as rule."""

    def make(run: Callable[[Subject], None]) -> Check:
        return Check(
            run.__name__.replace("_", "-"),
            " ".join((run.__doc__ or "").split()),
            page,
            run,
            tuple(requirements.split()),
        )

    return make


@dataclass(frozen=True)
class Finding:
    """The result of a check."""

    check: Check
    outcome: Literal["passed", "failed", "skipped"]
    text: str  #: why it failed or was skipped, possibly several lines
    seconds: float

    @property
    def line(self) -> str:
        """The first line of `text`."""
        return self.text.partition("\n")[0]

    def values(self) -> JsonObject:
        """Return the finding as plain values."""
        named = {"check": self.check.name, "rule": self.check.rule, "page": self.check.page}
        return named | {
            "requirements": list(self.check.requirements),
            "outcome": self.outcome,
            "text": self.text,
            "seconds": round(self.seconds, 3),
        }
