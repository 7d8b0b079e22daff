"""Every command of the README, typed in a shell that has only what `make rehearsal` installs.

Runs are shorter than a reader's, and packages that are not dependencies of the project are hidden.
"""

from __future__ import annotations

import os
import pty
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path

import click
import pytest
from packaging.requirements import Requirement

from rrins.host_tools.cli.main import rrins

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```console\n(.*?)```", README, re.DOTALL)
MAKE, FIRST, MORE, RUNNING, BESIDE, VCAN, ALONE, BOARD = (
    [line.removeprefix("$ ").partition("#")[0].strip() for line in block.splitlines()]
    for block in BLOCKS
)

SHORT = {
    "rrins reproduce": "rrins reproduce scheme --seeds 1",
    "rrins motion export drive drive.pos": "rrins motion export drive drive.pos --duration 60",
    "rrins calibrate": "rrins calibrate --rate 20 --stand 1",
    "rrins scheme search": "rrins scheme search --positions 8",
}
"""Shorter forms of cases that take minutes."""

HIDE = """
import sys
from importlib.abc import MetaPathFinder


class Hidden(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {names}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)


sys.meta_path.insert(0, Hidden())
"""


def needed(names: set[str]) -> set[str]:
    """Return distributions and all that they need, without extras."""
    found: set[str] = set()
    left = {Requirement(name).name for name in names}
    while left:
        name = left.pop()
        key = name.lower().replace("_", "-")
        if key in found:
            continue
        found.add(key)
        try:
            wanted = map(Requirement, metadata.requires(name) or ())
        except metadata.PackageNotFoundError:
            continue
        left |= {one.name for one in wanted if one.marker is None or one.marker.evaluate()}
    return found


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Go where a reader would be, with the base install and the extra that the README installs."""
    assert "pip install -e '.[tables]'" in README
    kept = needed({"rrins", "pip", "pyarrow"})
    hidden = {
        module
        for module, owners in metadata.packages_distributions().items()
        if not {owner.lower().replace("_", "-") for owner in owners} & kept
    }
    assert {"pytest", "pandas", "asammdf", "mypy"} <= hidden
    assert not {"numpy", "can", "textual", "pyarrow"} & hidden
    hooks = tmp_path / "hooks"
    hooks.mkdir()
    (hooks / "sitecustomize.py").write_text(HIDE.format(names=repr(hidden)))
    programs = tmp_path / ".venv" / "bin"
    programs.mkdir(parents=True)
    (programs / "activate").write_text(f'PATH="{programs}:$PATH"\n')
    (programs / "rrins").write_text(f'#!/bin/sh\nexec {sys.executable} -m rrins "$@"\n')
    (programs / "rrins").chmod(0o755)
    runtime = tempfile.mkdtemp(prefix="rrins-")  # a socket's path is short
    monkeypatch.setenv("XDG_RUNTIME_DIR", runtime)
    monkeypatch.setenv("PYTHONPATH", str(hooks))
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    shutil.rmtree(runtime)


def shell(command: str) -> tuple[str, ...]:
    """Return how a reader's shell runs a command."""
    return ("bash", "-c", f". .venv/bin/activate && {command}")


def typed(command: str) -> str:
    """Type a command; return what it printed."""
    done = subprocess.run(
        shell(SHORT.get(command, command)), capture_output=True, text=True, check=False, timeout=200
    )
    assert done.returncode == 0, f"{command}: {done.stdout[-1000:]}{done.stderr[-2000:]}"
    return done.stdout


@contextmanager
def under_way(command: str, until: Path | str) -> Iterator[subprocess.Popen[str]]:
    """Run a command until the block ends, from when a file is there or a line was said."""
    process = subprocess.Popen(
        shell(f"exec {command}"), stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
    )
    assert process.stderr is not None
    try:
        if isinstance(until, str):
            said = iter(process.stderr.readline, "")
            assert any(until in line for line in said), f"{command}: {until!r} was never said"
        deadline = time.monotonic() + 60
        while isinstance(until, Path) and not until.exists() and time.monotonic() < deadline:
            assert process.poll() is None, process.stderr.read()
            time.sleep(0.05)
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            process.kill()
            raise


def in_terminal(command: str, shown: bytes, keys: bytes) -> None:
    """Type a command in a terminal, and keys when it shows something; it ends well."""
    number, end = pty.fork()
    if number == 0:
        os.environ["TERM"] = "xterm"
        os.execvp("bash", shell(f"exec {command}"))
    seen = b""
    try:
        while True:
            seen += os.read(end, 65536)
            if shown in seen and keys:
                os.write(end, keys)
                keys = b""
    except OSError:  # the terminal is closed
        pass
    status = os.waitstatus_to_exitcode(os.waitpid(number, 0)[1])
    assert status == 0, seen[-2000:]
    assert not keys, seen[-2000:]


def shorten(scenario: Path) -> None:
    """Change the copy of a scenario, as the README asks, so that a run takes seconds."""
    text, count = re.subn(
        r"^duration_s *=.*$", "duration_s = 3", scenario.read_text(), count=1, flags=re.MULTILINE
    )
    assert count == 1
    scenario.write_text(text)


@pytest.mark.typed
def test_the_commands_come_to_an_end_one_after_the_other(base):
    for command in (*FIRST, *MORE):
        typed(command)
        if command.endswith("> own.toml"):
            shorten(base / "own.toml")
    assert (base / "out" / "own" / "summary.json").is_file()
    assert list((base / "tables").glob("*.parquet"))


@pytest.mark.typed
def test_the_commands_of_the_second_terminal_work_beside_a_rehearsal(base):
    (command,) = RUNNING
    typed(next(line for line in FIRST if line.endswith("> own.toml")))
    activate, monitor, *beside, record = BESIDE
    assert activate == ". .venv/bin/activate"
    with under_way(command, "running"):
        assert (base / "nmea").exists()
        assert (base / "console").exists()
        in_terminal(monitor, b"SENSOR_1", b"q")
        for line in beside:
            typed(line)
        with under_way(record, base / record.split()[-1]):
            time.sleep(0.5)
    assert (base / record.split()[-1]).stat().st_size > 0


def test_the_targets_of_make_are_there():
    for command in MAKE:
        assert (
            subprocess.run([*command.split(), "-n"], cwd=ROOT, capture_output=True).returncode == 0
        )


@pytest.mark.parametrize("command", [line for line in (*VCAN, *ALONE) if "rrins" in line])
def test_commands_for_other_buses_have_options_that_there_are(command):
    name, *words = command.removeprefix("rrins ").split()
    found = rrins.get_command(click.Context(rrins), name)
    assert found is not None
    assert found.make_context(name, words).params["interface"] in ("socketcan", "pcan")


def test_the_commands_for_a_board_and_a_browser_are_those_of_the_guides():
    guides = "".join((ROOT / "docs" / name).read_text() for name in ("build.md", "dashboard.md"))
    typed_there = [line.partition("#")[0].strip() for line in guides.splitlines()]
    for command in BOARD[1:]:
        assert f"$ {command}" in typed_there


def test_its_python_runs(monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "Agg")
    (block,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    scope: dict[str, object] = {}
    exec(compile(block.replace("duration_s=1600", "duration_s=5"), "README.md", "exec"), scope)
    assert scope["run"].summary["completed"]


def test_packages_that_it_names_are_dependencies_of_an_extra():
    named = set(re.findall(r"pip install ([a-z]\w+)", README))
    extras = {Requirement(one).name for one in metadata.requires("rrins") or () if "extra" in one}
    assert named == {"asammdf"}
    assert named <= extras
