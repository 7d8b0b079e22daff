"""Reports of a suite: JUnit XML, and one self-contained page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree

from rrins.host_tools.conformance.check import Finding
from rrins.host_tools.conformance.requirements import covered_by
from rrins.host_tools.drawing.page import environment
from rrins.host_tools.files import write_text

_OUTCOMES = ("passed", "failed", "skipped")


def words_of(findings: Sequence[Finding]) -> str:
    """Return how many checks had which outcome."""
    counts = Counter[str](one.outcome for one in findings)
    return ", ".join(f"{counts[one]} {one}" for one in _OUTCOMES if counts[one])


def _printable(text: str) -> str:
    return "".join(one if one.isprintable() or one == "\n" else "?" for one in text)


def write_junit(path: Path, name: str, findings: Sequence[Finding]) -> None:
    """Write the findings as JUnit XML."""
    counts = Counter[str](one.outcome for one in findings)
    root = ElementTree.Element("testsuites")
    suite = ElementTree.SubElement(
        root,
        "testsuite",
        name=f"rrins conform {name}",
        tests=str(len(findings)),
        failures=str(counts["failed"]),
        errors="0",
        skipped=str(counts["skipped"]),
        time=f"{sum(one.seconds for one in findings):.3f}",
    )
    for one in findings:
        names = {"classname": f"rrins.conform.{name}", "name": one.check.name}
        case = ElementTree.SubElement(suite, "testcase", names, time=f"{one.seconds:.3f}")
        properties = ElementTree.SubElement(case, "properties")
        for number in covered_by(one.check):
            ElementTree.SubElement(properties, "property", name="requirement", value=number)
        if one.outcome == "failed":
            failure = ElementTree.SubElement(case, "failure", message=_printable(one.line))
            failure.text = _printable(f"{one.text}\nRule: {one.check.rule} (docs/{one.check.page})")
        elif one.outcome == "skipped":
            ElementTree.SubElement(case, "skipped", message=_printable(one.text))
    ElementTree.indent(root)
    write_text(path, ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n")


def write_page(path: Path, name: str, findings: Sequence[Finding]) -> None:
    """Write the findings as one HTML page."""
    template = environment("rrins.host_tools.conformance").get_template("report.html.j2")
    version = f"rrins {metadata.version('rrins')}"
    page = template.render(name=name, findings=findings, words=words_of(findings), version=version)
    write_text(path, page)
