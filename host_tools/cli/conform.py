"""`rrins conform`: check a program against what this bus demands of a navigation computer."""

from __future__ import annotations

from pathlib import Path

import click

from rrins.host_tools.cli.options import FILE, flag, json_option, many, option
from rrins.host_tools.cli.output import print_results
from rrins.host_tools.errors import ConformanceError

_MARKS = {"passed": "ok", "failed": "FAILED", "skipped": "-"}


@click.command()
@click.argument("program", required=False)
@many("--only", "Run only this check; repeatable.", "CHECK")
@flag("--list is_list", "List the checks with their rules.")
@option("--junit", "Write JUnit XML to this file.", FILE)
@option("--html", "Write a page to this file.", FILE)
@json_option
def conform(
    program: str | None,
    only: tuple[str, ...],
    is_list: bool,
    junit: Path | None,
    html: Path | None,
    as_json: bool,
) -> None:
    """Check that PROGRAM does what this bus demands of a navigation computer.

    PROGRAM is called as `rrins rehearse --firmware` calls it. Without PROGRAM, the project's own
    firmware is checked.
    """
    from rrins.host_tools.conformance import report
    from rrins.host_tools.conformance.suite import chosen, conform
    from rrins.host_tools.runs.programs.program import Program

    checks = chosen(only)
    if is_list:
        for check in checks:
            click.echo(f"{check.name}\n    {check.rule} docs/{check.page}")
        return
    name = "rrins firmware" if program is None else Program.parse(program).name
    findings = []
    for finding in conform(program, checks):
        findings.append(finding)
        if not as_json:
            mark = _MARKS[finding.outcome]
            click.echo(f"{mark:>6}  {finding.check.name}  ({finding.seconds:.1f} s)")
            for line in finding.text.splitlines():
                click.echo(f"          {line}")
            if finding.outcome == "failed":
                click.echo(f"          rule: {finding.check.rule} docs/{finding.check.page}")
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
