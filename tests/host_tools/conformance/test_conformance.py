"""The suite passes what conforms, and finds each planted bug by name. All: RRINS_CONFORM=1."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner

from rrins.host_tools.cli.main import rrins
from rrins.host_tools.conformance.suite import CHECKS, chosen, conform

IS_FULL = "RRINS_CONFORM" in os.environ
MUTANTS = Path(__file__).with_name("mutants")
STRANGE = Path(__file__).parents[1] / "runs" / "programs" / "strange_firmware.py"
SOURCES = Path(__file__).parents[3] / "examples" / "own_firmware"
FOUND_BY = {
    "axes-held-at-shutdown": "shutdown",
    "axis-not-watched": "axis-fault",
    "clock-free-running": "clock-error",
    "commands-of-the-epoch-before": "commands",
    "counter-not-checked": "late-frames",
    "crc-not-checked": "wrong-crc",
    "gap-without-end": "gap-too-long",
    "no-coriolis": "navigation-drive-strapdown",
    "second-sender-believed": "disagreeing-frames",
    "sync-loss-not-told": "sync-lost",
}
QUICK = ("crc-not-checked", "no-coriolis")


def outcomes(program: str | None, *names: str) -> dict[str, str]:
    return {one.check.name: one.outcome for one in conform(program, chosen(names))}


def test_every_mutant_has_its_check() -> None:
    assert sorted(path.stem for path in MUTANTS.glob("*.patch")) == sorted(FOUND_BY)
    assert set(FOUND_BY.values()) <= {check.name for check in CHECKS}


def test_every_rule_is_on_a_page() -> None:
    docs = Path(__file__).parents[3] / "docs"
    for check in CHECKS:
        page, _, anchor = check.page.partition("#")
        headings = [
            line.lstrip("# ").lower().replace(" ", "-")
            for line in (docs / page).read_text(encoding="utf-8").splitlines()
            if line.startswith("#")
        ]
        assert not anchor or anchor in headings, check.page


@pytest.mark.parametrize("name", FOUND_BY if IS_FULL else QUICK)
def test_a_planted_bug_is_found_by_name(
    name: str, own_firmware: Path, make_firmware: Callable[..., str], tmp_path: Path
) -> None:
    if shutil.which("patch") is None:
        pytest.skip("patch is not installed")
    sources = tmp_path / "sources"
    shutil.copytree(SOURCES, sources)
    shutil.copytree(own_firmware.parent / "build", tmp_path / "build")
    subprocess.run(["patch", "-p1", "-s", "-i", MUTANTS / f"{name}.patch"], cwd=sources, check=True)
    make_firmware(tmp_path, sources=sources)
    found = outcomes(str(tmp_path / "own_firmware"), FOUND_BY[name])
    assert found == {FOUND_BY[name]: "failed"}


def test_the_c_firmware_conforms(own_firmware: Path) -> None:
    names = () if IS_FULL else ("start-up", "modes", *(FOUND_BY[name] for name in QUICK), "uds")
    found = outcomes(str(own_firmware), *names)
    of_uds = [found.pop(name) for name in list(found) if name.startswith("uds")]
    assert set(of_uds) == {"skipped"}
    assert set(found.values()) == {"passed"}


def test_ours_conforms() -> None:
    of_uds = [check.name for check in CHECKS if check.name.startswith("uds")]
    names = () if IS_FULL else ("start-up", *of_uds)
    assert set(outcomes(None, *names).values()) == {"passed"}


def test_one_that_only_answers_gets_a_useful_report(tmp_path: Path) -> None:
    program = f"{sys.executable} -S {STRANGE} idle"
    files = [tmp_path / "report.xml", tmp_path / "report.html"]
    done = CliRunner().invoke(
        rrins,
        [
            *("conform", program, "--only", "start-up", "--only", "wrong-crc"),
            *("--junit", str(files[0]), "--html", str(files[1])),
        ],
    )
    assert done.exit_code == 13
    assert "no HEARTBEAT_FIRMWARE within 1.5 s" in done.stdout
    assert "docs/firmware.md#modes" in done.stdout
    suite = ElementTree.parse(files[0]).getroot()[0]
    assert (suite.get("tests"), suite.get("failures")) == ("2", "2")
    assert "no HEARTBEAT_FIRMWARE" in files[1].read_text()


def test_one_that_dies_is_not_tried_further() -> None:
    program = f"{sys.executable} -S {STRANGE} ends"
    first, second = conform(program, chosen(["start-up", "modes"]))
    assert first.outcome == "failed"
    assert "no licence" in first.text
    assert second.outcome == "skipped"
    assert second.text.startswith("not tried: ")
