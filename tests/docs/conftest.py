"""Somebody who types a guide's commands at a rehearsal in virtual time."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from rrins.host_tools.cli.main import rrins
from rrins.host_tools.diag.connection import LibraryConnection
from rrins.host_tools.diag.target import Target
from rrins.host_tools.injection import client
from rrins.host_tools.testing.diagnostics import BenchTransport


class Desk:
    """A terminal beside a rehearsal that somebody has started, in an empty folder."""

    def __init__(self, rrins_bench: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        self._make = rrins_bench
        self._patch = monkeypatch
        monkeypatch.setenv("COLUMNS", "80")
        self.bench: Any = None
        self._record: str | None = None

    def type(self, command: str) -> str:
        """Type a command; return what is said."""
        match shlex.split(command, comments=True):
            case ["rrins", "rehearse", scenario, *rest]:
                self._rehearse(scenario)
                self._record = rest[rest.index("--record") + 1] if "--record" in rest else None
                return ""
            case ["sleep", seconds]:
                self.bench.advance(float(seconds))
                return ""
            case ["rrins", ("allocate" | "campaign" | "covariance" | "explain") as tool, *rest]:
                ended = CliRunner().invoke(rrins, [tool, *rest], prog_name="rrins")
                assert ended.exit_code == 0, ended.output
                return "" if "rerun" in rest else ended.stdout  # of a run: how fast it was
            case ["rrins", "export", *rest]:
                if self._record is not None:
                    self.bench.write_log(Path(self._record))
                ended = CliRunner().invoke(rrins, ["export", *rest], prog_name="rrins")
                return ended.output
            case ["python", *rest]:
                done = subprocess.run(
                    [sys.executable, *rest], capture_output=True, text=True, check=True, timeout=60
                )
                return done.stdout
            case ["rrins", ("diag" | "inject" | "redundancy") as tool, *rest]:
                ended = CliRunner().invoke(rrins, [tool, *rest], prog_name="rrins")
                if ended.exception and not isinstance(ended.exception, SystemExit):
                    raise ended.exception
                return ended.output
        raise AssertionError(f"nobody types {command!r}")

    def _rehearse(self, scenario: str) -> None:
        """Start a rehearsal; wait until it navigates."""
        bench = self.bench = self._make(scenario, way="direct", duration_s=3600.0)
        bench.expect("FIRMWARE_STATUS", within=10, where={"mode": "NAVIGATION_ROTATING"})
        medium = BenchTransport(bench, bench._ring)
        self._patch.setattr(Target, "connect", lambda self: LibraryConnection(medium, "bench"))
        self._patch.setattr(client, "open_bus", lambda address, **wishes: bench.attach())


@pytest.fixture
def desk(rrins_bench, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    return Desk(rrins_bench, monkeypatch)
