"""The pytest plugin: benches, buses and sides as fixtures, which import heavy modules lazily."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import pytest

if TYPE_CHECKING:
    from collections.abc import Generator

    import can

    from rrins.host_tools.files import JsonObject
    from rrins.host_tools.testing.alone import HardwareAlone
    from rrins.host_tools.testing.bench import Bench
    from rrins.host_tools.testing.scenarios import ScenarioTable

DEFAULT_SCENARIO = "rimu_rotating"
"""The scenario of `rrins_firmware` and `rrins_hardware` without a marker `rrins_scenario`."""

_MARK = "rrins_scenario"
_BENCHES: pytest.StashKey[list[Bench]] = pytest.StashKey()
_LOGS: pytest.StashKey[list[str]] = pytest.StashKey()
_FOLDER: pytest.StashKey[Path] = pytest.StashKey()


class BenchFactory(Protocol):
    """The function that the fixture `rrins_bench` provides."""

    def __call__(
        self,
        scenario: str | Path | ScenarioTable = DEFAULT_SCENARIO,
        *,
        way: str | None = None,
        foreign_senders: bool = True,
        program: str | None = None,
        memory: Path | None = None,
        **overrides: Any,
    ) -> Bench:
        """Return a bench, at power-on.

        Parameters
        ----------
        scenario : str, Path or mapping
            Name of a built-in scenario, path of a TOML file (searched next to the test file first),
            or its keys.
        way : {"direct", "lockstep", "realtime"}, optional
            That of ``--rrins-way`` by default.
        foreign_senders : bool
            Whether clients that the test attaches may send what the contract gives to a side.
        program : str, optional
            Your own navigation computer, a program or its command line; that of
            ``--rrins-firmware`` by default. It runs in lockstep where the way is ``"direct"``.
        memory : Path, optional
            File of the firmware's parameter memory, which outlives `Bench.power_cycle`.
        **overrides
            Top-level keys of the scenario; a dict is merged into the scenario's table.
        """


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the plugin's options."""
    group = parser.getgroup("rrins", "rrins benches")
    group.addoption(
        "--rrins-way",
        choices=("direct", "lockstep", "realtime"),
        default="direct",
        help="how benches run unless a test sets it (default: direct)",
    )
    group.addoption(
        "--rrins-firmware",
        metavar="PROGRAM",
        help="your own program as the firmware of all benches (default: the project's)",
    )
    group.addoption(
        "--rrins-log-dir",
        type=Path,
        metavar="DIR",
        help="folder for the bus logs of failing tests (default: the test's tmp_path)",
    )
    group.addoption(
        "--rrins-patience",
        type=float,
        default=60.0,
        metavar="SECONDS",
        help="longest silence of a process under test; 0 for a debugger (default: 60)",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Register the plugin's markers."""
    config.addinivalue_line(
        "markers",
        f"{_MARK}(scenario, **overrides): the scenario of rrins_firmware and rrins_hardware",
    )


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Log the bus of a failing test, and show the path."""
    report = yield
    benches = item.stash.get(_BENCHES, [])
    if report.failed and benches:
        logs = item.stash.setdefault(_LOGS, [])
        if not logs:
            logs += _write_logs(item, benches)
        report.sections.append(("rrins bus", "\n".join(logs)))
    return report


def _write_logs(item: pytest.Item, benches: list[Bench]) -> list[str]:
    wished: Path | None = item.config.getoption("rrins_log_dir")
    folder = item.stash[_FOLDER] if wished is None else wished
    stem = "bus" if wished is None else re.sub(r"[^\w.-]+", "_", item.nodeid)
    lines = []
    for number, bench in enumerate(benches, start=1):
        path = folder / (f"{stem}.log" if number == 1 else f"{stem}-{number}.log")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            frames = bench.write_log(path)
        except OSError as error:
            lines.append(f"no log at {path}: {error}")
        else:
            words = f"{frames} frames, {bench.way}, to {bench.time_s:.3f} s"
            lines.append(f"{path.absolute()}: {words}")
    return lines


@pytest.fixture
def rrins_channel() -> str:
    """Return the name of an unused channel of the embedded bus."""
    from rrins.host_tools.testing.processes import fresh_channel

    return fresh_channel()


@pytest.fixture
def rrins_bus(rrins_channel: str) -> Iterator[can.BusABC]:
    """Yield a python-can bus on `rrins_channel`, an embedded bus for this test."""
    from rrins.host_tools.bus.interface import RrinsBus

    with RrinsBus(rrins_channel, host="auto") as bus:
        yield bus


@pytest.fixture
def rrins_bench(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[BenchFactory]:
    """Yield a function that makes benches, see `BenchFactory`; they are closed after the test."""
    from contextlib import ExitStack

    from rrins.host_tools.testing.bench import Bench
    from rrins.host_tools.testing.scenarios import prepare_scenario

    benches = request.node.stash.setdefault(_BENCHES, [])
    request.node.stash[_FOLDER] = tmp_path
    options = request.config.option

    def make(
        scenario: str | Path | ScenarioTable = DEFAULT_SCENARIO,
        *,
        way: str | None = None,
        foreign_senders: bool = True,
        program: str | None = None,
        memory: Path | None = None,
        **overrides: Any,
    ) -> Bench:
        file = tmp_path / f"scenario-{len(benches) + 1}.toml"
        checked = prepare_scenario(scenario, overrides, file, request.path.parent)
        bench = Bench(
            checked,
            file,
            way or options.rrins_way,
            options.rrins_patience,
            foreign_senders,
            program or options.rrins_firmware,
            memory,
        )
        benches.append(bench)
        ends.callback(bench.close)
        return bench

    with ExitStack() as ends:
        yield make


def _marked(request: pytest.FixtureRequest) -> tuple[str | Path | ScenarioTable, JsonObject]:
    mark = request.node.get_closest_marker(_MARK)
    if mark is None:
        return DEFAULT_SCENARIO, {}
    return (mark.args[0] if mark.args else DEFAULT_SCENARIO), dict(mark.kwargs)


@pytest.fixture
def rrins_firmware(request: pytest.FixtureRequest, rrins_bench: BenchFactory) -> Bench:
    """Return a firmware process with the test as its hardware: a bench in lockstep.

    Like any bench, plus `channel`, `process` and `bus` (python-can, attached).
    """
    scenario, overrides = _marked(request)
    return rrins_bench(scenario, way="lockstep", **overrides)


@pytest.fixture
def rrins_hardware(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[HardwareAlone]:
    """Yield a hardware process in real time with the test as its firmware, over python-can.

    It has `channel`, `process` and `bus`.
    """
    from rrins.host_tools.testing.alone import HardwareAlone
    from rrins.host_tools.testing.scenarios import prepare_scenario

    scenario, overrides = _marked(request)
    file = tmp_path / "scenario-hardware.toml"
    prepare_scenario(scenario, overrides, file, request.path.parent)
    with HardwareAlone(file) as hardware:
        yield hardware
