"""Reports of a suite: JUnit XML, and one self-contained page."""

from __future__ import annotations

import html
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import IO
from xml.etree import ElementTree

from rrins.host_tools.conformance.check import Finding
from rrins.host_tools.files import JsonObject, write_whole

_STYLE = """
body { font-family: sans-serif; margin: 2em auto; max-width: 60em; color: #222; }
table { border-collapse: collapse; width: 100%; }
td, th { border-bottom: 1px solid #ccc; padding: 0.4em 0.6em; text-align: left;
  vertical-align: top; }
.passed { color: #176117; } .failed { color: #a11212; font-weight: bold; } .skipped { color: #666; }
pre { white-space: pre-wrap; margin: 0.3em 0 0; }
"""


def words_of(findings: Sequence[Finding]) -> str:
    """Return how many checks came to what."""
    counts = {
        outcome: sum(one.outcome == outcome for one in findings)
        for outcome in ("passed", "failed", "skipped")
    }
    return ", ".join(f"{count} {outcome}" for outcome, count in counts.items() if count)


def _printable(text: str) -> str:
    return "".join(one if one.isprintable() or one == "\n" else "?" for one in text)


def rows_of(findings: Sequence[Finding]) -> list[JsonObject]:
    """Return the findings as plain values, an object each."""
    return [
        {
            "check": one.check.name,
            "rule": one.check.rule,
            "page": one.check.page,
            "outcome": one.outcome,
            "text": one.text,
            "seconds": round(one.seconds, 3),
        }
        for one in findings
    ]


def write_junit(path: Path, name: str, findings: Sequence[Finding]) -> None:
    """Write the findings as JUnit XML."""
    suite = ElementTree.Element(
        "testsuite",
        name=f"rrins conform {name}",
        tests=str(len(findings)),
        failures=str(sum(one.outcome == "failed" for one in findings)),
        errors="0",
        skipped=str(sum(one.outcome == "skipped" for one in findings)),
        time=f"{sum(one.seconds for one in findings):.3f}",
    )
    for one in findings:
        case = ElementTree.SubElement(
            suite,
            "testcase",
            classname=f"rrins.conform.{name}",
            name=one.check.name,
            time=f"{one.seconds:.3f}",
        )
        if one.outcome == "failed":
            failure = ElementTree.SubElement(case, "failure", message=_printable(one.line))
            failure.text = _printable(f"{one.text}\nRule: {one.check.rule} (docs/{one.check.page})")
        elif one.outcome == "skipped":
            ElementTree.SubElement(case, "skipped", message=_printable(one.text))
    root = ElementTree.Element("testsuites")
    root.append(suite)
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"

    def write(file: IO[str]) -> None:
        file.write(text)

    write_whole(path, write)


def write_page(path: Path, name: str, findings: Sequence[Finding]) -> None:
    """Write the findings as one HTML page."""
    rows = []
    for one in findings:
        why = f"<pre>{html.escape(one.text)}</pre>" if one.text else ""
        rows.append(
            f'<tr><td class="{one.outcome}">{one.outcome}</td><td>{html.escape(one.check.name)}'
            f"</td><td>{html.escape(one.check.rule)}{why}</td><td>{html.escape(one.check.page)}"
            f"</td><td>{one.seconds:.1f} s</td></tr>"
        )
    text = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>rrins conform {html.escape(name)}</title><style>{_STYLE}</style></head><body>\n"
        f"<h1>{html.escape(name)}</h1>\n<p>{words_of(findings)}; rrins "
        f"{metadata.version('rrins')}. The rules are in the pages of its documentation.</p>\n"
        "<table><tr><th></th><th>check</th><th>rule</th><th>page</th><th>took</th></tr>\n"
        + "\n".join(rows)
        + "\n</table></body></html>\n"
    )

    def write(file: IO[str]) -> None:
        file.write(text)

    write_whole(path, write)
