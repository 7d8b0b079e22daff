"""The command as such: its table, its start and its end."""

from __future__ import annotations

import re
import subprocess
import sys

import click
import pytest
from click.shell_completion import ShellComplete
from click.testing import CliRunner

from rrins.dbc import codec
from rrins.host_tools.cli import main as cli
from rrins.host_tools.cli.options import DEFAULT_SCENARIO

CONTEXT = click.Context(cli.rrins)


def started(*arguments: str) -> set[str]:
    """Return the modules that a start of the command imports, taken from Python's own account."""
    said = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "rrins", *arguments],
        capture_output=True,
        text=True,
        check=True,
    )
    lines = (line.rpartition("|")[2].strip() for line in said.stderr.splitlines())
    return {name.partition(".")[0] for name in lines}


@pytest.mark.parametrize("name", cli.rrins.list_commands(CONTEXT))
def test_each_command_of_the_table_is_there_and_explains_itself(name):
    command = cli.rrins.get_command(CONTEXT, name)
    assert command is not None
    assert command.name == name
    assert command.help


def test_help_shows_each_command_in_one_line():
    said = CliRunner().invoke(cli.rrins, ["--help"]).output.splitlines()
    assert max(map(len, said)) <= 80
    for name in cli.rrins.list_commands(CONTEXT):
        (line,) = (line for line in said if line.startswith(f"  {name} "))
        assert line.endswith(".")


@pytest.mark.parametrize("words", [("diag",), ("diag", "calibration"), ("scheme",), ("xcp",)])
def test_help_of_a_group_cuts_no_sentence(words):
    said = CliRunner().invoke(cli.rrins, [*words, "--help"], env={"COLUMNS": "80"}).output
    assert "..." not in said.partition("Commands:")[2]
    assert max(map(len, said.splitlines())) <= 80


def test_help_and_completion_start_at_once():
    assert not started("--help") & {"numpy", "numba", "can", "cantools", "pydantic"}
    for name in ("rehearse", "campaign"):
        assert not started(name, "--help") & {"numpy", "numba", "can", "cantools", "pydantic"}
    assert not started("monitor", "--help") & {"numpy", "numba", "can", "cantools", "textual"}
    found = ShellComplete(cli.rrins, {}, "rrins", "_RRINS_COMPLETE").get_completions([], "re")
    assert [item.value for item in found] == [
        "record",
        "redundancy",
        "rehearse",
        "replay",
        "reproduce",
    ]


def test_both_sides_are_started_before_what_only_the_results_need_is_imported():
    command = "import rrins.host_tools.runs.run, sys; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.modules['asammdf'] = None; {command}"],
        capture_output=True,
        text=True,
        check=True,
    )
    results_only = {"scipy.spatial", "scipy.linalg", "matplotlib", "pandas", "pyarrow"}
    assert not results_only & set(done.stdout.split())


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("rehears", "rehearse"),
        ("scenarios shoow ideal", "show"),
        ("scenarios show idael", "ideal"),
        ("rehearse idael", "ideal"),
        ("rehearse --duraton 2", "--duration"),
        ("scheme analyze 16-position", "analyse"),
        ("scheme analyse 16-positon", "16-position"),
        ("motion chrck drive.csv", "check"),
        ("diag dct read", "dtc"),
        ("diag did reaad heading", "read"),
        ("diag memory listt", "list"),
        ("diag routine sttart", "start"),
        ("diag calibration pulll x", "pull"),
        ("inject axis_stal", "axis_stall"),
    ],
)
def test_a_mistyped_word_is_answered_with_the_one_that_was_meant(words, meant):
    ended = CliRunner().invoke(cli.rrins, words.split())
    assert ended.exit_code in (2, 3)
    assert re.search(rf"[Dd]id you mean[^?]*{meant}", ended.output), ended.output


def test_a_word_like_no_command_is_answered_without_a_guess():
    ended = CliRunner().invoke(cli.rrins, ["frobnicate"])
    assert ended.exit_code == 2
    assert ended.output.endswith("Error: No such command 'frobnicate'.\n")


@pytest.mark.parametrize("name", ["rehearse", "simulate", "firmware", "hardware"])
def test_help_names_the_default_scenario(name):
    said = CliRunner().invoke(cli.rrins, [name, "--help"]).output
    assert DEFAULT_SCENARIO in said


def test_scenarios_are_completed():
    found = ShellComplete(cli.rrins, {}, "rrins", "_RRINS_COMPLETE").get_completions(
        ["rehearse"], "rimu_r"
    )
    assert [(item.value, item.type) for item in found] == [
        ("rimu_rotating", "plain"),
        ("rimu_rotating_aligned", "plain"),
        ("rimu_r", "file"),
    ]


@pytest.mark.slow
def test_what_only_mf4_needs_is_imported_for_mf4_only(tmp_path):
    pytest.importorskip("asammdf")
    assert not started("scenarios") & {"pandas", "matplotlib"}
    log, copy = tmp_path / "bus.log", tmp_path / "bus.mf4"
    log.write_text("(0.000000) vcan0 010#0000000000000000\n")
    assert "pandas" not in started("replay", str(log), "--compare", str(log))
    record = ["rehearse", "ideal", "--duration", "1", "--out", str(tmp_path), "--record", str(copy)]
    assert "pandas" in started(*record)


@pytest.mark.parametrize(
    "arguments",
    [
        ("rehearse", "--limit", "nan"),
        ("rehearse", "--limit", "inf"),
        ("rehearse", "--bitrate", "9" * 400),
        ("monitor", "--bitrate", "9" * 400),
        ("scheme", "analyse", "16-position", "--latitude", "nan"),
        ("motion", "export", "drive", "out.csv", "--rate", "nan"),
        ("motion", "check", "x.csv", "--speed-limit", "1e-300"),
        ("replay", "x.log", "--speed", "1e-300"),
        ("conform", "--mutants", "5"),
    ],
)
def test_a_number_beyond_its_limits_or_without_its_option_is_wrong_use(arguments):
    assert CliRunner().invoke(cli.rrins, arguments).exit_code == 2


def test_a_dbc_that_cannot_serve_is_one_line(monkeypatch):
    def broken(*_, **__):
        raise codec.ContractError("the DBC has no message SYNC")

    monkeypatch.setattr("rrins.host_tools.scenario.scenario.load", broken)
    ended = CliRunner().invoke(cli.rrins, ["simulate"])
    assert ended.exit_code == 1
    assert ended.stderr == "rrins: the DBC has no message SYNC\n"


def test_a_missing_package_is_one_line_that_names_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.delitem(sys.modules, "rrins.host_tools.vehicle.navigator_files", raising=False)
    ended = CliRunner().invoke(cli.rrins, ["increments", "ideal", "out"])
    assert ended.exit_code == 1
    assert ended.stderr == "rrins: this needs pyarrow: pip install 'rrins[tables]'\n"
