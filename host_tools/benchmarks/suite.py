"""`rrins bench`: all benchmarks in one run, with progress and tables."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import statistics
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from rich.console import Console
from rich.table import Table

from rrins.host_tools.benchmarks import compute, estimator, fast_path, floor, rehearsals
from rrins.host_tools.benchmarks.messages import MessageLockstep
from rrins.host_tools.benchmarks.timed_epochs import timer_overhead_ns
from rrins.host_tools.bus.datagram import FRAME_SIZE, HEADER_SIZE
from rrins.host_tools.closing import Closing
from rrins.host_tools.files import JsonObject
from rrins.host_tools.runs.direct import run_direct
from rrins.host_tools.runs.sides.job import prepare_firmware, prepare_hardware
from rrins.host_tools.scenario.scenario import load
from rrins.host_tools.terminal import new_console, print_table, progress_line

SCENARIO = "rimu_rotating"
RATES_HZ = (200, 400, 1000)
"""Rates of the real-time rehearsals."""

READ_RATE_HZ = 400
"""Rate of the rehearsal that a diagnostic tool reads meanwhile."""

_WAYS = {
    "floor": "floor: bare bytes",
    "lockstep": "lockstep",
    "python_can": "lockstep, python-can",
    "direct": "direct, no bus",
}
"""Ways to exchange epochs: key of the result, and label."""

Result = JsonObject
"""The result, as printed by `rrins bench --json`."""


@dataclass(frozen=True)
class Effort:
    """Extent of the measurements."""

    rounds: int = 3  # rehearsals in lockstep
    repetitions: int = 1  # of everything compared with lockstep, before and after each of them
    lockstep_s: float = 150.0  # simulated, of one run
    direct_s: float = 300.0
    floor_epochs: int = 20_000  # of one run
    message_epochs: int = 1000
    step_samples: int = 40_000  # calls of a step
    pyins_s: float = 10.0  # simulated, through pyins' filter
    frames: int = 4000  # through cantools
    bus_frames: int = 4200  # through python-can's buses
    realtime_s: float = 10.0  # at each rate
    cold: bool = True  # whether to measure a cold start, which compiles

    @property
    def steps(self) -> int:
        """Number of progress steps."""
        return 4 + self.rounds + len(RATES_HZ) + self.cold


NORMAL = Effort()
QUICK = Effort(
    rounds=1,
    repetitions=2,
    lockstep_s=60.0,
    direct_s=60.0,
    floor_epochs=8000,
    message_epochs=300,
    step_samples=8000,
    pyins_s=3.0,
    frames=800,
    bus_frames=1400,
    realtime_s=2.0,
    cold=False,
)


class BenchDisplay(Closing):
    """Progress of a benchmark: a live line in a terminal, otherwise a line per step."""

    def __init__(self, console: Console, steps: int) -> None:
        self._console = console
        self._progress = progress_line(console, refresh_hz=2)  # drawing disturbs the measurement
        self._steps, self._begun = steps, 0
        self._task = self._progress.add_task("starting", total=steps)

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def close(self) -> None:
        """Remove the progress from the terminal."""
        self._progress.stop()

    def step(self, text: str) -> None:
        """Begin the next step."""
        done, self._begun = self._begun, self._begun + 1
        state = (f"{self._begun} of {self._steps}",)
        self._progress.update(self._task, description=text, completed=done, state=state)
        if not self._console.is_terminal:
            self._console.print(text, highlight=False, soft_wrap=True)


def _machine() -> Result:
    return {
        "python": platform.python_version(),
        "numba": importlib.metadata.version("numba"),
        "python_can": importlib.metadata.version("python-can"),
        "cpus": os.cpu_count(),
        "cpus_permitted": len(os.sched_getaffinity(0)),
        "load_average": round(os.getloadavg()[0], 2),
    }


def _datagram_bytes() -> tuple[int, int]:
    """Return the bytes of an epoch's datagrams up and down, for the mean number of frames."""
    outcome = run_direct(load(SCENARIO, duration_s=60.0))
    firmware, hardware = outcome.firmware, outcome.hardware
    sizes = [
        HEADER_SIZE + FRAME_SIZE * round(side["frames_sent"] / hardware["epochs"])
        for side in (hardware, firmware)
    ]
    return sizes[0], sizes[1]


def _run_rounds(effort: Effort, channel: str, folder: Path, display: BenchDisplay) -> Result:
    """Measure the ways that exchange epochs, in turn, so that all see the same load."""
    up, down = _datagram_bytes()
    direct = load(SCENARIO, duration_s=effort.direct_s)
    samples: dict[str, list[float]] = {f"{way}_epochs_per_s": [] for way in _WAYS}
    of_floor, of_lockstep, of_python_can, of_direct = samples.values()
    frames_lost = 0
    sections = 2 * effort.repetitions * effort.rounds
    with MessageLockstep(
        SCENARIO, f"{channel}-messages", effort.message_epochs, sections
    ) as messages:

        def compare() -> None:
            for _ in range(effort.repetitions):
                of_python_can.append(messages.run_section())  # the first one waits for the start
                of_floor.append(floor.measure(up, down, effort.floor_epochs))
                outcome = run_direct(direct)
                of_direct.append(outcome.hardware["epochs"] / outcome.wall_s)

        for number in range(effort.rounds):
            display.step(f"floor, lockstep, python-can, direct: {number + 1} of {effort.rounds}")
            compare()
            speeds, lost = rehearsals.lockstep(SCENARIO, effort.lockstep_s, channel, folder)
            of_lockstep += speeds
            frames_lost += lost
            compare()
    medians = {key: statistics.median(values) for key, values in samples.items()}
    return medians | {
        "lockstep_over_floor": medians["floor_epochs_per_s"] / medians["lockstep_epochs_per_s"],
        "frames_lost": frames_lost,
        "samples": samples,
        "floor_datagram_bytes": {"up": up, "down": down},
    }


def _run_compute(effort: Effort) -> Result:
    steps, frames = compute.steps(load(SCENARIO), effort.step_samples)
    buses: Result = {}
    for interface in ("virtual", "udp_multicast"):
        figures, reason = compute.python_can(interface, frames[: effort.bus_frames])
        buses |= {interface: figures, f"{interface}_reason": reason}
    return {
        **steps,
        **fast_path.us_per_epoch(effort.step_samples),
        "navigation_step_us": fast_path.navigation_step_us(effort.step_samples),
        **estimator.measure(effort.step_samples, effort.pyins_s),
        "timer_overhead_us": timer_overhead_ns() / 1000,
        **compute.codec(frames),
        "cantools_us_per_frame": compute.cantools(frames[: effort.frames]),
        **buses,
    }


def _run_starts(effort: Effort, channel: str, folder: Path, display: BenchDisplay) -> Result:
    cold: float | None = None
    cache: Path | None = None
    if effort.cold:
        display.step("cold start: compiles, about 30 s")
        cache = folder / "cache"
        cold = rehearsals.start_s(SCENARIO, channel, folder, cache)
    display.step("warm start")
    return {"cold": cold, "warm": rehearsals.start_s(SCENARIO, channel, folder, cache)}


def measure(effort: Effort, display: BenchDisplay) -> Result:
    """Measure everything; return the object of `rrins bench --json` (see docs/bench.md).

    Raises
    ------
    RehearsalError
        If a rehearsal fails.
    """
    start_s = time.monotonic()
    channel = f"bench-{os.getpid()}"
    result: Result = {"quick": effort is QUICK, "wall_s": 0.0, "machine": _machine()}
    with tempfile.TemporaryDirectory(prefix="rrins-bench-") as name:
        folder = Path(name)
        display.step("preparing (compiles the first time, about 30 s)")
        prepare_firmware(load(SCENARIO))
        prepare_hardware(load(SCENARIO))
        result |= _run_rounds(effort, channel, folder, display)
        display.step("steps, codecs, python-can's buses")
        result |= _run_compute(effort)
        lateness: Result = {}
        for rate_hz in RATES_HZ:
            display.step(f"real time at {rate_hz} Hz, {effort.realtime_s:g} s")
            lateness[str(rate_hz)], _ = rehearsals.realtime(
                SCENARIO, rate_hz, effort.realtime_s, channel, folder
            )
        result["lateness_us"] = lateness
        display.step(f"the same at {READ_RATE_HZ} Hz, reading every identifier repeatedly")
        while_read, permitted = rehearsals.realtime(
            SCENARIO, READ_RATE_HZ, effort.realtime_s, channel, folder, is_read=True
        )
        result["machine"] |= permitted
        result["lateness_while_read_us"] = {str(READ_RATE_HZ): while_read}
        result["start_to_first_epoch_s"] = _run_starts(effort, channel, folder, display)
    result["wall_s"] = round(time.monotonic() - start_s, 1)
    return result


def measured(quick: bool) -> Result:
    """Measure everything, with progress on standard error."""
    effort = QUICK if quick else NORMAL
    with BenchDisplay(new_console(stderr=True), effort.steps) as display:
        return measure(effort, display)


def print_result(result: Result, console: Console) -> None:
    """Show the result as tables."""
    machine = result["machine"]
    permitted = "permitted" if machine["sched_fifo"] else "refused"
    print_table(_table_of_speeds(result), console)
    print_table(_table_of_costs(result), console)
    print_table(_table_of_lateness(result), console)
    start = result["start_to_first_epoch_s"]
    cold = "not measured" if start["cold"] is None else f"{start['cold']:.1f} s"
    for line in (
        f"start to first epoch: cold (compiles) {cold}, warm {start['warm']:.1f} s",
        f"Python {machine['python']}, numba {machine['numba']}, python-can "
        f"{machine['python_can']}, {machine['cpus_permitted']} of {machine['cpus']} processors, "
        f"SCHED_FIFO {permitted}, load {machine['load_average']:.1f} at the start",
        f"{'quick; ' if result['quick'] else ''}measured in {result['wall_s']:.0f} s",
    ):
        console.print(line, highlight=False, soft_wrap=True)


def _table(title: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """Return a table: words in the first column, numbers in the others."""
    table = Table(title=title, title_justify="left")
    for heading in headings:
        is_first = heading == headings[0]
        table.add_column(heading, no_wrap=is_first, justify="left" if is_first else "right")
    for row in rows:
        table.add_row(*row)
    return table


def _table_of_speeds(result: Result) -> Table:
    rows = []
    for way, label in _WAYS.items():
        samples, median = result["samples"][f"{way}_epochs_per_s"], result[f"{way}_epochs_per_s"]
        figures = [f"{value:,.0f}" for value in (median, min(samples), max(samples))]
        ratio = f"{result['floor_epochs_per_s'] / median:.2f}"
        rows.append([label, *figures, str(len(samples)), ratio])
    headings = ("way", "median", "slowest", "fastest", "samples", "floor / way")
    table = _table("Epochs per second", headings, rows)
    table.caption = f"{result['frames_lost']} frames lost in lockstep"
    return table


def _table_of_costs(result: Result) -> Table:
    table = Table(title="Microseconds", title_justify="left")
    table.add_column("what", no_wrap=True)
    table.add_column("µs", justify="right")
    table.add_column("")
    for what, value, digits, note in _costs(result):
        table.add_row(what, "-" if value is None else f"{value:.{digits}f}", note)
    return table


def _costs(result: Result) -> Iterator[tuple[str, float | None, int, str]]:
    """Yield the rows of the costs: what, µs, digits behind the point, a note."""
    ways = ("", "_comparing", "_limit")
    fast, comparing, limit = (result[f"fast_path{one}_us_per_epoch"] for one in ways)
    yield "fast path, per epoch of both sides", fast, 2, f"{fast / limit:.2f} × its limit"
    yield "the same, sensors compared", comparing, 2, f"{comparing / limit:.2f} × its limit"
    yield "its limit: a loop written by hand", limit, 2, "8 noisy sensors"
    shared = result["fast_path_shared_us_per_epoch"]
    yield "runs that share a loop, compared", shared, 2, f"1/{comparing / shared:.1f} of one alone"
    yield "navigation alone, per call", result["navigation_step_us"], 2, ""
    for side in ("firmware", "hardware"):
        step = result[f"{side}_step_us"]
        yield f"{side}'s step, per call", step["median"], 2, f"p99 {step['p99']:.2f}"
    for case in estimator.CASES:
        step = result["estimator_step_us"][case.name]
        yield case.label, step["median"], 2, f"p99 {step['p99']:.2f}, {step['overruns']} overruns"
    ratio = result["pyins_over_step"]
    note = result["pyins_filter_reason"] or f"{ratio:.0f} × the step with the filter"
    yield "pyins' filter, per epoch", result["pyins_filter_us"], 0, note
    for codec in ("codec", "cantools"):
        for way, value in result[f"{codec}_us_per_frame"].items():
            yield f"{codec}: {way} per sensor frame", value, 3, ""
    yield "CRC check per sensor frame", result["crc_us_per_frame"], 3, ""
    for interface in ("virtual", "udp_multicast"):
        figures, label = result[interface], f"python-can {interface}, per frame"
        if figures is None:
            yield label, None, 0, result[f"{interface}_reason"]
        else:
            lost = f"{100 * figures['lost_share']:.1f} % lost at full speed"
            yield label, figures["us_per_frame"], 1, lost


def _table_of_lateness(result: Result) -> Table:
    named = [(f"{rate_hz} Hz", one) for rate_hz, one in result["lateness_us"].items()]
    named += [
        (f"{rate_hz} Hz, every identifier read {one['times_read']} times", one)
        for rate_hz, one in result["lateness_while_read_us"].items()
    ]
    keys = ("p50", "p99", "p999", "max", "overruns", "epochs")
    rows = [[what, *(f"{one[key]:.0f}" for key in keys)] for what, one in named]
    headings = ("rate", "p50", "p99", "p99.9", "max", "overruns", "epochs")
    table = _table("Lateness of the firmware's loop in real time, µs", headings, rows)
    if not all(one["completed"] for _, one in named):
        table.caption = "a run was aborted near its end (fewer epochs)"
    return table
