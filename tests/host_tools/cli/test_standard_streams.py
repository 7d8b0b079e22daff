"""Standard output and standard error on a full disk, or closed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rrins.host_tools.cli.main import main

FULL = "rrins: standard output cannot be written: No space left on device\n"
SHORT = ("simulate", "ideal", "--duration", "2")


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Return a function that runs a command; returns its exit status and what it prints."""
    monkeypatch.chdir(tmp_path)

    def runner(*arguments, **full):
        with monkeypatch.context() as patch:
            patch.setattr(sys, "argv", ["rrins", *arguments])
            texts = {}
            for name in ("stdout", "stderr"):
                path = Path("/dev/full" if full.get(name) else name)
                texts[name] = path.open("w", encoding="utf-8")
                patch.setattr(sys, name, texts[name])
            with pytest.raises(SystemExit) as ended:
                main()
            for name, text in texts.items():
                if not full.get(name):
                    getattr(sys, name).flush()
                    text.close()
        return ended.value.code, *(
            None if full.get(name) else Path(name).read_text(errors="surrogateescape")
            for name in ("stdout", "stderr")
        )

    return runner


@pytest.mark.parametrize(
    "arguments",
    [
        ("--help",),
        ("--version",),
        ("scenarios",),
        ("scenarios", "schema"),
        ("scheme", "analyse", "16-position", "--help"),
        ("scheme", "analyse", "16-position"),  # a table of rich
        ("scheme", "analyse", "16-position", "--json"),
        (*SHORT, "--json"),
        SHORT,
    ],
    ids=" ".join,
)
def test_results_on_a_full_disk_are_one_line(run, arguments):
    status, _, said = run(*arguments, stdout=True)
    assert (status, said.splitlines()[-1] + "\n") == (1, FULL)
    assert "Traceback" not in said


def test_notes_on_a_full_disk_are_left_out_and_the_run_goes_on(run):
    status, result, _ = run(*SHORT, "--json", stderr=True)
    assert status == 0
    assert '"completed": true' in result
    assert Path("out/ideal/summary.json").exists()
    assert run("simulate", "nothing", stderr=True)[0] == 3
    assert run("simulate", "--nothing", stderr=True)[0] == 2
    assert run("scenarios", stdout=True, stderr=True)[0] == 1


def test_names_are_printed_as_they_stand(run):
    Path("own.toml").write_text('title = "[/b] :x: [red]"\nduration_s = 2\n', encoding="utf-8")
    status, shown, _ = run("simulate", "own.toml", "--out", "o[/b]:x:")
    assert (status, "o[/b]:x:/summary.json" in shown) == (0, True)
    Path("b\udcff.toml").write_text("duration_s = 2\n", encoding="utf-8")
    status, shown, said = run("simulate", "b\udcff.toml", "--seed", "-1")
    assert (status, said.count("\n")) == (3, 1)
    Path("b\udcff.log").write_text("(1.0) can0 010#00\n", encoding="utf-8")
    assert run("plot", "--list", "b\udcff.log")[1].startswith("b\udcff.log: 1 frame")


def started(*arguments, **streams):
    command = [sys.executable, "-m", "rrins", *arguments]
    return subprocess.run(command, stderr=subprocess.PIPE, check=False, text=True, **streams)


def test_the_interpreter_ends_quietly_too():
    with Path("/dev/full").open("w") as full:
        ended = started("scenarios", stdout=full)
    assert (ended.returncode, ended.stderr) == (1, FULL)
    ended = started("scenarios", preexec_fn=lambda: os.close(1))
    assert (ended.returncode, ended.stderr) == (0, "")
    there, here = os.pipe()
    os.close(there)
    ended = started("scenarios", stdout=here)
    os.close(here)
    assert (ended.returncode, ended.stderr) == (1, "")
