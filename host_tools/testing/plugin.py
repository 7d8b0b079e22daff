"""The pytest plugin: benches, buses and sides as fixtures. What is heavy is imported in them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import pytest

if TYPE_CHECKING:
    from collections.abc import Generator, Mapping

    import can

    from host_tools.testing.alone import HardwareAlone
    from host_tools.testing.bench import Bench

DEFAULT_SCENARIO = "rimu_rotating"
"""The scenario of `rrins_firmware` and `rrins_hardware` without a mark `rrins_scenario`."""

_MARK = "rrins_scenario"
_BENCHES: pytest.StashKey[list[Any]] = pytest.StashKey()
_LOGS: pytest.StashKey[list[str]] = pytest.StashKey()
_FOLDER: pytest.StashKey[Path] = pytest.StashKey()


class BenchFactory(Protocol):
    """What the fixture `rrins_bench` gives."""

    def __call__(
        self,
        scenario: str | Path | Mapping[str, Any] = DEFAULT_SCENARIO,
        *,
        way: str | None = None,
        **overrides: Any,
    ) -> Bench:
        """Return a bench, at power-on.

        Parameters
        ----------
        scenario : str, Path or mapping
            Name of a built-in scenario, path of a TOML file (looked for beside the test's file
            first), or its keys.
        way : {"direct", "lockstep", "realtime"}, optional
            By default what ``--rrins-way`` says.
        **overrides
            Top-level keys of the scenario; a dict is merged into the scenario's table.
        """


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of the plugin."""
    group = parser.getgroup("rrins", "rrins benches")
    group.addoption(
        "--rrins-way",
        choices=("direct", "lockstep", "realtime"),
        default="direct",
        help="how benches run that do not say themselves (default: direct)",
    )
    group.addoption(
        "--rrins-log-dir",
        type=Path,
        metavar="DIR",
        help="where the bus of a failing test is logged (default: the test's tmp_path)",
    )
    group.addoption(
        "--rrins-patience",
        type=float,
        default=60.0,
        metavar="SECONDS",
        help="longest silence of a process under test; 0 for a debugger (default: 60)",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Register the marks of the plugin."""
    config.addinivalue_line(
        "markers",
        f"{_MARK}(scenario, **overrides): the scenario of rrins_firmware and rrins_hardware",
    )


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Write the bus of a failing test to a log, and show where."""
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
    """Return the name of a channel of the embedded bus that nobody else uses."""
    from host_tools.testing.processes import fresh_channel

    return fresh_channel()


@pytest.fixture
def rrins_bus(rrins_channel: str) -> Iterator[can.BusABC]:
    """Give a python-can bus on `rrins_channel`, an embedded bus of the test's own."""
    from host_tools.bus.interface import RrinsBus

    with RrinsBus(rrins_channel, host="auto") as bus:
        yield bus


@pytest.fixture
def rrins_bench(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[BenchFactory]:
    """Give a function that makes benches, see `BenchFactory`; they are closed after the test."""
    from contextlib import ExitStack

    from host_tools.testing.bench import Bench
    from host_tools.testing.scenarios import prepare_scenario

    benches = request.node.stash.setdefault(_BENCHES, [])
    request.node.stash[_FOLDER] = tmp_path
    options = request.config.option

    def make(
        scenario: str | Path | Mapping[str, Any] = DEFAULT_SCENARIO,
        *,
        way: str | None = None,
        **overrides: Any,
    ) -> Bench:
        file = tmp_path / f"scenario-{len(benches) + 1}.toml"
        checked = prepare_scenario(scenario, overrides, file, request.path.parent)
        bench = Bench(checked, file, way or options.rrins_way, options.rrins_patience)
        benches.append(bench)
        ends.callback(bench.close)
        return bench

    with ExitStack() as ends:
        yield make


def _marked(request: pytest.FixtureRequest) -> tuple[Any, dict[str, Any]]:
    mark = request.node.get_closest_marker(_MARK)
    if mark is None:
        return DEFAULT_SCENARIO, {}
    return (mark.args[0] if mark.args else DEFAULT_SCENARIO), dict(mark.kwargs)


@pytest.fixture
def rrins_firmware(request: pytest.FixtureRequest, rrins_bench: BenchFactory) -> Bench:
    """Give a firmware process whose hardware is the test: a bench in lockstep.

    It has `channel`, `process` and `bus` (python-can, attached) beside all that a bench has.
    """
    scenario, overrides = _marked(request)
    return rrins_bench(scenario, way="lockstep", **overrides)


@pytest.fixture
def rrins_hardware(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[HardwareAlone]:
    """Give a hardware process in real time whose firmware is the test, by python-can.

    It has `channel`, `process` and `bus`.
    """
    from host_tools.testing.alone import HardwareAlone
    from host_tools.testing.scenarios import prepare_scenario

    scenario, overrides = _marked(request)
    file = tmp_path / "scenario-hardware.toml"
    prepare_scenario(scenario, overrides, file, request.path.parent)
    with HardwareAlone(file) as hardware:
        yield hardware
