"""The suite passes what conforms, and finds each planted bug by name. All: RRINS_CONFORM=1."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner

from rrins.host_tools.cli.main import rrins
from rrins.host_tools.conformance.mutation import Mutant, Workshop, mutants_of, words_of
from rrins.host_tools.conformance.requirements import covered_by, matrix, requirements
from rrins.host_tools.conformance.suite import CHECKS, LONG, chosen, conform

IS_FULL = "RRINS_CONFORM" in os.environ
HERE = Path(__file__).parent
STRANGE = HERE.parent / "runs" / "programs" / "strange_firmware.py"
SOURCES = HERE.parents[2] / "examples" / "own_firmware"
MUTANTS = tomllib.loads((HERE / "mutants.toml").read_text(encoding="utf-8"))
IN_C = [(name, *one) for name, every in MUTANTS["c"].items() for one in every]
IN_UDS = [(name, *one) for name, every in MUTANTS["uds"].items() for one in every]
QUICK = ("every-crc", "shaken", "requests", "shutdown")
"""Of each the first mutant, in the quick tests."""


def outcomes(program: str | None, *names: str) -> dict[str, str]:
    return {one.check.name: one.outcome for one in conform(program, chosen(names))}


def test_every_mutant_has_its_check() -> None:
    known = {check.name for check in LONG}
    assert {check for *_, check in (*IN_C, *IN_UDS)} <= known
    for name, old, *_ in IN_C:
        assert (SOURCES / name).read_text(encoding="utf-8").count(old) == 1, (name, old)
    for module, old, *_ in IN_UDS:  # a program that does not start would be found, too
        source = HERE.parents[2] / f"{module.removeprefix('rrins.').replace('.', '/')}.py"
        assert source.read_text(encoding="utf-8").count(old) == 1, (module, old)
    unexplained = [one for every in MUTANTS["not_found"].values() for one in every if not one[2]]
    assert not unexplained
    assert len(IN_C) >= 110


def test_every_rule_is_on_a_page() -> None:
    docs = HERE.parents[2] / "docs"
    for page, _, anchor in {one.page.partition("#") for one in (*LONG, *requirements())}:
        headings = [
            line.lstrip("# ").lower().replace(" ", "-")
            for line in (docs / page).read_text(encoding="utf-8").splitlines()
            if line.startswith("#")
        ]
        assert not anchor or anchor in headings, f"{page}#{anchor}"


def test_every_requirement_is_tried_by_a_check_and_every_check_tries_one() -> None:
    assert [row["requirement"] for row in matrix(CHECKS) if not row["checks"]] == []
    assert [check.name for check in LONG if not covered_by(check)] == []
    numbers = [one.number for one in requirements()]
    assert len(numbers) == len(set(numbers))


@pytest.fixture(scope="module")
def workshop(
    make_firmware: Callable[..., str], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Workshop]:
    """Return where mutants of the C firmware are built; skip without gcc and make."""
    folder = tmp_path_factory.mktemp("mutants") / "own_firmware"
    shutil.copytree(SOURCES, folder, ignore=shutil.ignore_patterns("build", "own_firmware"))
    root = SOURCES.parents[1]
    words = (
        *("make", f"PYTHON={sys.executable}", "CFLAGS=-O0"),
        *(f"DBC={root / 'dbc' / 'rrins.dbc'}", f"CLIENT={root / 'clients' / 'c'}"),
    )
    with Workshop(folder, shlex.join(words), folder / "own_firmware") as workshop:
        yield workshop


@pytest.mark.parametrize("check", QUICK)
def test_a_planted_bug_is_found_by_name(check: str, workshop: Workshop) -> None:
    name, old, new, _ = next(one for one in IN_C if one[3] == check)
    start = (SOURCES / name).read_text(encoding="utf-8").index(old)
    verdict = workshop.judge(Mutant(name, 1, start, old, new), chosen([check]))
    assert (verdict.outcome, verdict.by) == ("killed", check), verdict


@pytest.mark.soak
def test_every_planted_bug_in_c_is_found_by_name(workshop: Workshop) -> None:
    missed = []
    for name, old, new, check in IN_C:
        start = (SOURCES / name).read_text(encoding="utf-8").index(old)
        verdict = workshop.judge(Mutant(name, 1, start, old, new), chosen([check]))
        if verdict.outcome != "killed":
            missed.append((name, old, new, verdict.outcome, verdict.why))
    assert not missed


@pytest.mark.soak
def test_every_planted_bug_in_the_uds_server_is_found_by_name() -> None:
    missed = []
    for module, old, new, check in IN_UDS:
        words = (sys.executable, str(HERE / "mutated_firmware.py"), module, old, new)
        if outcomes(shlex.join(words), check) != {check: "failed"}:
            missed.append((module, old, new, check))
    assert not missed


def test_mutants_leave_comments_strings_and_preprocessor_alone() -> None:
    text = '#include <a.h>\n/* a < b */\nint f(int a)\n{\n    g("a < b");\n    return a < 2;\n}\n'
    found = sorted(str(one) for one in mutants_of(text, "a.c"))
    assert found == [
        'a.c:5: g("a < b"); -> ;',
        "a.c:6: 2 -> 3",
        "a.c:6: < -> <=",
        "a.c:6: < -> >=",
    ]
    mutant = next(one for one in mutants_of(text, "a.c") if one.new == "<=")
    assert mutant.applied(text) == text.replace("a < 2", "a <= 2")


def test_a_users_sources_are_mutated_in_a_copy(tmp_path: Path) -> None:
    """A program that no check can pass: every mutant is killed by the first check."""
    folder = tmp_path / "mine"
    folder.mkdir()
    source = "int main(void)\n{\n    int kept = 3;\n    return kept < 2 ? 1 : 4;\n}\n"
    (folder / "a.c").write_text(source)
    (tmp_path / ".mine-mutants-999999999-left").mkdir()  # a killed run's
    words = ["conform", str(folder / "a"), "--mutate", str(folder), "--only", "start-up"]
    done = CliRunner().invoke(rrins, [*words, "--build", "make a", "--mutants", "3", "--json"])
    assert done.exit_code == 0, done.output
    verdicts = json.loads(done.stdout)["mutants"]
    assert len(verdicts) == 3
    assert {one["outcome"] for one in verdicts} <= {"killed", "same"}
    assert (folder / "a.c").read_text() == source
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    done = CliRunner().invoke(rrins, [*words, "--build", "make nothing"])
    assert done.exit_code == 1
    assert "make nothing does not build" in done.stderr
    assert words_of([]).startswith("0 of 0 mutants killed")


@pytest.mark.parametrize("language", ["own", "rust"])
def test_the_examples_conform(language: str, request: pytest.FixtureRequest) -> None:
    names = () if IS_FULL else ("start-up", "modes", "ends", *QUICK, "uds")
    found = outcomes(str(request.getfixturevalue(f"{language}_firmware")), *names)
    of_uds = [found.pop(name) for name in list(found) if name.startswith("uds")]
    assert set(of_uds) == {"skipped"}
    assert set(found.values()) == {"passed"}


def test_ours_conforms() -> None:
    names = () if IS_FULL else ("start-up", "uds", "uds-access", "uds-reset")
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
    assert suite[0].find("properties/property").attrib == {  # type: ignore[union-attr]  # it is there
        "name": "requirement",
        "value": "MODE-1",
    }
    assert "no HEARTBEAT_FIRMWARE" in files[1].read_text()


def test_one_that_dies_is_not_tried_further() -> None:
    program = f"{sys.executable} -S {STRANGE} ends"
    first, second = conform(program, chosen(["start-up", "modes"]))
    assert first.outcome == "failed"
    assert "no licence" in first.text
    assert second.outcome == "skipped"
    assert second.text.startswith("not tried: ")
