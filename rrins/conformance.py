"""Conformance of a navigation computer, checked from Python."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from rrins.host_tools.conformance import report
from rrins.host_tools.conformance.check import Finding
from rrins.host_tools.conformance.suite import chosen
from rrins.host_tools.conformance.suite import conform as try_checks
from rrins.host_tools.runs.programs.program import Program
from rrins.notebook import html_of

if TYPE_CHECKING:
    import pandas as pd


class Conformance:
    """Results of the checks of a program.

    Attributes
    ----------
    program : str
        Its name.
    findings : list of Finding
    """

    def __init__(self, program: str, findings: list[Finding]) -> None:
        self.program, self.findings = program, findings

    @property
    def failed(self) -> list[str]:
        """Names of the checks that it does not pass."""
        return [one.check.name for one in self.findings if one.outcome == "failed"]

    @cached_property
    def checks(self) -> pd.DataFrame:
        """A row for each check: its name, `rule`, `page`, `requirements`, `outcome`, `text`, …."""
        import pandas as pd

        return pd.DataFrame([one.values() for one in self.findings])

    def write_page(self, path: str | Path) -> None:
        """Write the report as a page."""
        report.write_page(Path(path), self.program, self.findings)

    def write_junit(self, path: str | Path) -> None:
        """Write the report as JUnit XML."""
        report.write_junit(Path(path), self.program, self.findings)

    def __repr__(self) -> str:
        return f"<rrins.Conformance {self.program}: {report.words_of(self.findings)}>"

    def _repr_html_(self) -> str:
        return html_of(self, self.checks, has_index=False)


def conform(
    program: str | Path | None = None, only: Sequence[str] = (), is_long: bool = False
) -> Conformance:
    """Check that a program does what this bus demands of a navigation computer.

    Parameters
    ----------
    program : str or Path, optional
        Command line, as for `rehearse`; the project's own firmware without it.
    only : sequence of str
        Names of checks; all without them.
    is_long : bool
        Whether all includes those that take minutes.

    Raises
    ------
    RehearsalError
        When there is no such program or check.
    """
    line = None if program is None else str(program)
    checks = chosen(only, is_long)
    name = "rrins firmware" if line is None else Program.parse(line).name
    return Conformance(name, list(try_checks(line, checks)))
