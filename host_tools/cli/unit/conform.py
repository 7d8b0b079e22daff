"""`rrins conform`: check a program against what this bus demands of a navigation computer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from rrins.host_tools.cli.options import (
    FILE,
    FOLDER,
    flag,
    gathered,
    json_option,
    many,
    option,
    together,
)
from rrins.host_tools.cli.output import print_results
from rrins.host_tools.errors import ConformanceError, RehearsalError
from rrins.host_tools.interruption import heed_sigterm

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rrins.host_tools.conformance.check import Check, Finding

_MARKS = {"passed": "ok", "failed": "FAILED", "skipped": "-"}


@dataclass(frozen=True)
class _Mutation:
    """A folder of sources, how they are built, and how many changes are tried."""

    mutate: Path | None
    build: str
    mutants: int
    seed: int


_OPTIONS = together(
    many("--only", "Run only this check; repeatable.", "CHECK"),
    flag("--long is_long", "Run the checks that take minutes, too."),
    flag("--list is_list", "List the checks with their rules."),
    flag("--matrix is_matrix", "List the requirements with the checks that try them."),
    option("--junit", "Write JUnit XML to this file.", FILE),
    option("--html", "Write a page to this file.", FILE),
    json_option,
)
_MUTATION_OPTIONS = gathered(
    "mutation",
    _Mutation,
    option("--mutate", "Change the C sources of this folder; count what is found.", FOLDER),
    option("--build", "Command that builds PROGRAM in that folder.", str, "make"),
    option("--mutants", "Try at most so many changes, drawn at random.", click.IntRange(1), 100),
    option("--seed", "Seed of that draw.", click.IntRange(0), 1),
)


@click.command()
@click.argument("program", required=False)
@_OPTIONS
@_MUTATION_OPTIONS
def conform(
    program: str | None,
    only: tuple[str, ...],
    is_long: bool,
    is_list: bool,
    is_matrix: bool,
    junit: Path | None,
    html: Path | None,
    as_json: bool,
    mutation: _Mutation,
) -> None:
    """Check that PROGRAM does what this bus demands of a navigation computer.

    PROGRAM is called as `rrins rehearse --firmware` calls it. Without PROGRAM, the project's own
    firmware is checked. With --mutate, small bugs are put into a copy of its sources, one at a
    time, and the checks are measured by how many they find.
    """
    from rrins.host_tools.conformance import report
    from rrins.host_tools.conformance.suite import chosen, conform
    from rrins.host_tools.runs.programs.program import Program

    heed_sigterm()
    for path in (junit, html):
        if path is not None and not path.absolute().parent.is_dir():  # told before all is run
            raise RehearsalError(f"{path}: cannot be written: there is no such folder")
    checks = chosen(only, is_long)
    if is_list or is_matrix:
        _print_list(checks, is_matrix, as_json)
        return
    if mutation.mutate is not None:
        _mutate(program, mutation, checks, as_json)
        return
    context = click.get_current_context()
    for word in ("build", "mutants", "seed"):
        if context.get_parameter_source(word) is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"--{word} goes with --mutate")
    name = "rrins firmware" if program is None else Program.parse(program).name
    findings = []
    for finding in conform(program, checks):
        findings.append(finding)
        if not as_json:
            _print_finding(finding)
    words = report.words_of(findings)
    if junit is not None:
        report.write_junit(junit, name, findings)
    if html is not None:
        report.write_page(html, name, findings)
    result = {"program": name, "checks": [one.values() for one in findings]}
    seconds = sum(one.seconds for one in findings)
    print_results(as_json, result, [f"{name}: {words} in {seconds:.0f} s"])
    failed = [one.check.name for one in findings if one.outcome == "failed"]
    if failed:
        raise ConformanceError(f"{name} does not conform: {', '.join(failed)}")


def _print_finding(finding: Finding) -> None:
    mark = _MARKS[finding.outcome]
    click.echo(f"{mark:>6}  {finding.check.name}  ({finding.seconds:.1f} s)")
    for line in finding.text.splitlines():
        click.echo(f"          {line}")
    if finding.outcome == "failed":
        click.echo(f"          rule: {finding.check.rule} docs/{finding.check.page}")


def _print_list(checks: Sequence[Check], is_matrix: bool, as_json: bool) -> None:
    from rrins.host_tools.conformance.requirements import covered_by, matrix

    if is_matrix:
        rows = matrix(checks)
        lines = [
            f"{row['requirement']}  {row['text']} docs/{row['page']}\n"
            f"    {', '.join(row['checks']) or 'no check'}"
            for row in rows
        ]
        print_results(as_json, {"requirements": rows}, lines)
        return
    listed = [
        {
            "check": check.name,
            "rule": check.rule,
            "page": check.page,
            "requirements": list(covered_by(check)),
        }
        for check in checks
    ]
    lines = [f"{check.name}\n    {check.rule} docs/{check.page}" for check in checks]
    print_results(as_json, {"checks": listed}, lines)


def _mutate(
    program: str | None, mutation: _Mutation, checks: Sequence[Check], as_json: bool
) -> None:
    from rrins.host_tools.conformance.mutation import Workshop, sample, words_of

    if program is None:
        raise RehearsalError("--mutate needs PROGRAM: what --build makes in the folder")
    assert mutation.mutate is not None
    verdicts = []
    with Workshop(mutation.mutate, mutation.build, Path(program)) as workshop:
        mutants = sample(workshop.mutants(), mutation.mutants, mutation.seed)
        for mutant in mutants:
            verdict = workshop.judge(mutant, checks)
            verdicts.append(verdict)
            if not as_json:
                found = f"  {verdict.by}" if verdict.by else ""
                click.echo(f"{verdict.outcome:>9}  {mutant}{found}")
    result = {"mutants": [one.values() for one in verdicts]}
    survivors = [f"  {one.mutant}" for one in verdicts if one.outcome == "survived"]
    lines = ["survivors:", *survivors] if survivors else []
    print_results(as_json, result, [*lines, words_of(verdicts)])
