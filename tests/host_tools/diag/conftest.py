"""`rrins diag` at a bench: the whole tool, its frames and its time, without processes."""

from __future__ import annotations

import json
from typing import Any

import can
import pytest
from click.testing import CliRunner

from firmware_py.diagnostics import table
from host_tools.cli import rrins
from host_tools.diag.connection import LibraryConnection
from host_tools.diag.target import Target
from host_tools.diag.tester import Tester


class BenchMedium:
    """A place on the bus of a bench, whose time goes on by an epoch each time it receives."""

    keeps_pace = True

    def __init__(self, bench: Any) -> None:
        self.bench = bench
        self.is_dead = False
        self.requests: list[bytes] = []

    @property
    def now_ns(self) -> int:
        return self.bench._world.now_ns

    def send(self, data: bytes) -> None:
        self.requests.append(data)
        if not self.is_dead:
            self.bench.send_frame(
                can.Message(arbitration_id=table.request_id(), is_extended_id=False, data=data)
            )

    def receive(self, wait_s: float) -> list[bytes]:
        ring = self.bench._ring
        first = ring.total
        self.bench.advance(self.bench.scenario.period_ns / 1e9)
        frames, _ = ring.find(table.response_id(), first)
        return [int(f["data"]).to_bytes(8, "little")[: int(f["length"])] for f in frames]

    def hears_others(self, wait_s: float) -> bool:
        return True

    def close(self) -> None: ...


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

    def __init__(self, bench: Any, medium: BenchMedium) -> None:
        self.bench = bench
        self.medium = medium
        self.firmware = bench._world.firmware

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
    medium = BenchMedium(bench)
    monkeypatch.setattr(Target, "connect", lambda self: LibraryConnection(medium, "bench"))
    monkeypatch.setenv("COLUMNS", "80")
    return Computer(bench, medium)
