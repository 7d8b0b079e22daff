"""`rrins diag` at a bench: the whole tool, its frames and its time, without processes."""

from __future__ import annotations

import json
from typing import Any

import pytest
from click.testing import CliRunner

from rrins.host_tools.cli.main import rrins
from rrins.host_tools.diag.connection import LibraryConnection
from rrins.host_tools.diag.target import Target
from rrins.host_tools.diag.tester import Tester
from rrins.host_tools.testing.diagnostics import BenchTransport


class ComputerMedium(BenchTransport):
    """A place on the bus of a bench; it keeps what was sent, and may be dead."""

    def __init__(self, bench: Any, ring: Any) -> None:
        super().__init__(bench, ring)
        self.is_dead = False
        self.requests: list[bytes] = []

    def send(self, data: bytes) -> None:
        self.requests.append(data)
        if not self.is_dead:
            super().send(data)


class Ended:
    """A command that has ended."""

    def __init__(self, result: Any) -> None:
        self.status = result.exit_code
        self.out = result.stdout
        self.err = result.stderr
        if result.exception and not isinstance(result.exception, SystemExit):
            raise result.exception

    @property
    def json(self) -> Any:
        assert self.status == 0, self.err
        return json.loads(self.out)

    @property
    def error(self) -> str:
        """The one line of an error."""
        (line,) = self.err.splitlines()
        assert line.startswith("rrins: ")
        return line.removeprefix("rrins: ")


class Computer:
    """A navigation computer at a bench, and somebody who types commands."""

    def __init__(self, bench: Any, medium: ComputerMedium) -> None:
        self.bench = bench
        self.medium = medium
        self.firmware = bench._execution.firmware

    def type(self, *words: str, **runner: Any) -> Ended:
        return Ended(CliRunner().invoke(rrins, ["diag", *words], prog_name="rrins", **runner))

    def tester(self, is_securing: bool = True) -> Tester:
        return Tester(Target(), is_securing)

    @property
    def stored(self) -> dict[int, Any]:
        return dict(self.firmware.diagnostics.parameters.stored)

    def to_standby(self) -> None:
        assert self.type("routine", "start", "standby", "--security").status == 0


@pytest.fixture
def computer(rrins_bench, monkeypatch):
    """A computer that navigates."""
    bench = rrins_bench("rimu_rotating", way="direct", duration_s=3600.0)
    bench.advance(6.0)
    medium = ComputerMedium(bench, bench._ring)
    monkeypatch.setattr(Target, "connect", lambda self: LibraryConnection(medium, "bench"))
    monkeypatch.setenv("COLUMNS", "80")
    return Computer(bench, medium)
