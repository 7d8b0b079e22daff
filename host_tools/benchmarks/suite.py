"""`rrins bench`: all benchmarks in one run, with progress and tables."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import statistics
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

import click
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

Result = JsonObject
"""The result, as printed by `rrins bench --json`."""


@dataclass(frozen=True)
class Effort:
    """Extent of the measurements.

    Attributes
    ----------
    rounds : int
        Rehearsals in lockstep.
    repetitions : int
        How often everything compared with lockstep runs before and after each of them.
    lockstep_s, direct_s : float
        Simulated seconds of one run.
    floor_epochs, message_epochs : int
        Epochs of one run.
    step_samples, frames, bus_frames : int
        Calls of a step; frames through cantools; frames through python-can's buses.
    pyins_s : float
        Simulated seconds through pyins' filter.
    realtime_s : float
        Duration at each rate.
    cold : bool
        Whether to measure a cold start, which compiles.
    """

    rounds: int
    repetitions: int
    lockstep_s: float
    direct_s: float
    floor_epochs: int
    message_epochs: int
    step_samples: int
    pyins_s: float
    frames: int
    bus_frames: int
    realtime_s: float
    cold: bool

    @property
    def steps(self) -> int:
        """Number of progress steps."""
        return 4 + self.rounds + len(RATES_HZ) + self.cold


NORMAL = Effort(
    rounds=3,
    repetitions=1,
    lockstep_s=150.0,
    direct_s=300.0,
    floor_epochs=20_000,
    message_epochs=1000,
    step_samples=40_000,
    pyins_s=10.0,
    frames=4000,
    bus_frames=4200,
    realtime_s=10.0,
    cold=True,
)
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


@dataclass
class _Rounds:
    """Every sample in epochs per second, and the frames lost in lockstep."""

    floor: list[float] = field(default_factory=list)
    lockstep: list[float] = field(default_factory=list)
    python_can: list[float] = field(default_factory=list)
    direct: list[float] = field(default_factory=list)
    frames_lost: int = 0

    def result(self) -> Result:
        rates = {
            "floor_epochs_per_s": self.floor,
            "lockstep_epochs_per_s": self.lockstep,
            "python_can_epochs_per_s": self.python_can,
            "direct_epochs_per_s": self.direct,
        }
        result: Result = {key: statistics.median(values) for key, values in rates.items()}
        ratio = result["floor_epochs_per_s"] / result["lockstep_epochs_per_s"]
        return result | {
            "lockstep_over_floor": ratio,
            "frames_lost": self.frames_lost,
            "samples": rates,
        }


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
    up, down = _datagram_bytes()
    direct = load(SCENARIO, duration_s=effort.direct_s)
    rounds = _Rounds()
    sections = 2 * effort.repetitions * effort.rounds
    with MessageLockstep(
        SCENARIO, f"{channel}-messages", effort.message_epochs, sections
    ) as messages:

        def compare() -> None:
            for _ in range(effort.repetitions):
                rounds.python_can.append(
                    messages.run_section()
                )  # the first one waits for the start
                rounds.floor.append(floor.measure(up, down, effort.floor_epochs))
                outcome = run_direct(direct)
                hardware, seconds = outcome.hardware, outcome.wall_s
                rounds.direct.append(hardware["epochs"] / seconds)

        for number in range(effort.rounds):
            display.step(f"floor, lockstep, python-can, direct: {number + 1} of {effort.rounds}")
            compare()
            rehearsed = rehearsals.lockstep(SCENARIO, effort.lockstep_s, channel, folder)
            rounds.lockstep += rehearsed.epochs_per_s
            rounds.frames_lost += rehearsed.frames_lost
            compare()
    return rounds.result() | {"floor_datagram_bytes": {"up": up, "down": down}}


def _run_compute(effort: Effort) -> Result:
    steps = compute.steps(load(SCENARIO), effort.step_samples)
    fast = fast_path.us_per_epoch(effort.step_samples)
    buses: Result = {}
    for interface in ("virtual", "udp_multicast"):
        figures, reason = compute.python_can(interface, steps.frames[: effort.bus_frames])
        buses |= {interface: figures, f"{interface}_reason": reason}
    return {
        "firmware_step_us": steps.firmware_us,
        "hardware_step_us": steps.hardware_us,
        "fast_path_us_per_epoch": fast.plain,
        "fast_path_comparing_us_per_epoch": fast.comparing,
        "navigation_step_us": fast_path.navigation_step_us(effort.step_samples),
        **estimator.measure(effort.step_samples, effort.pyins_s),
        "timer_overhead_us": timer_overhead_ns() / 1000,
        **compute.codec(steps.frames),
        "cantools_us_per_frame": compute.cantools(steps.frames[: effort.frames]),
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
            run = rehearsals.realtime(SCENARIO, rate_hz, effort.realtime_s, channel, folder)
            lateness[str(rate_hz)] = run.lateness_us
            result["machine"] |= {
                "sched_fifo": run.sched_fifo,
                "memory_locked": run.memory_locked,
            }
        result["lateness_us"] = lateness
        display.step(f"the same at {READ_RATE_HZ} Hz, reading every identifier repeatedly")
        run = rehearsals.realtime(
            SCENARIO, READ_RATE_HZ, effort.realtime_s, channel, folder, is_read=True
        )
        result["lateness_while_read_us"] = {str(READ_RATE_HZ): run.lateness_us}
        result["start_to_first_epoch_s"] = _run_starts(effort, channel, folder, display)
    result["wall_s"] = round(time.monotonic() - start_s, 1)
    return result


def measured(quick: bool) -> Result:
    """Measure everything, with progress on standard error."""
    effort = QUICK if quick else NORMAL
    with BenchDisplay(new_console(stderr=True), effort.steps) as display:
        return measure(effort, display)


def bench(quick: bool, as_json: bool) -> None:
    """Run `rrins bench`."""
    result = measured(quick)
    if as_json:
        click.echo(json.dumps(result))
    else:
        print_result(result, new_console())


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


def _table_of_speeds(result: Result) -> Table:
    table = Table(title="Epochs per second", title_justify="left")
    table.add_column("way", no_wrap=True)
    for heading in ("median", "slowest", "fastest", "samples", "floor / way"):
        table.add_column(heading, justify="right")
    for label, key in (
        ("floor: bare bytes", "floor_epochs_per_s"),
        ("lockstep", "lockstep_epochs_per_s"),
        ("lockstep, python-can", "python_can_epochs_per_s"),
        ("direct, no bus", "direct_epochs_per_s"),
    ):
        samples = result["samples"][key]
        table.add_row(
            label,
            *(f"{value:,.0f}" for value in (result[key], min(samples), max(samples))),
            str(len(samples)),
            f"{result['floor_epochs_per_s'] / result[key]:.2f}",
        )
    table.caption = f"{result['frames_lost']} frames lost in lockstep"
    return table


def _table_of_costs(result: Result) -> Table:
    table = Table(title="Microseconds", title_justify="left")
    table.add_column("what", no_wrap=True)
    table.add_column("µs", justify="right")
    table.add_column("")
    fast = result["fast_path_us_per_epoch"]
    table.add_row("fast path, per epoch of both sides", f"{fast:.2f}", "8 noisy sensors")
    comparing = result["fast_path_comparing_us_per_epoch"]
    table.add_row("the same, sensors compared", f"{comparing:.2f}", f"{comparing / fast:.2f} ×")
    table.add_row("navigation alone, per call", f"{result['navigation_step_us']:.2f}", "")
    for side in ("firmware", "hardware"):
        step = result[f"{side}_step_us"]
        table.add_row(f"{side}'s step, per call", f"{step['median']:.2f}", f"p99 {step['p99']:.2f}")
    for label, name in (
        ("step at 400 Hz, no filter", "plain"),
        ("with the filter", "filter"),
        ("with filter, bank and a fault", "filter_bank_faults"),
    ):
        step = result["estimator_step_us"][name]
        spread = f"p99 {step['p99']:.2f}, {step['overruns']} overruns"
        table.add_row(label, f"{step['median']:.2f}", spread)
    theirs = result["pyins_filter_us"]
    if theirs is None:
        table.add_row("pyins' filter, per epoch", "-", result["pyins_filter_reason"])
    else:
        ratio = f"{result['pyins_over_step']:.0f} × the step with the filter"
        table.add_row("pyins' filter, per epoch", f"{theirs:.0f}", ratio)
    for label, key in (("codec", "codec_us_per_frame"), ("cantools", "cantools_us_per_frame")):
        for way in ("decode", "encode"):
            table.add_row(f"{label}: {way} per sensor frame", f"{result[key][way]:.3f}", "")
    table.add_row("CRC check per sensor frame", f"{result['crc_us_per_frame']:.3f}", "")
    for interface in ("virtual", "udp_multicast"):
        figures = result[interface]
        label = f"python-can {interface}, per frame"
        if figures is None:
            table.add_row(label, "-", result[f"{interface}_reason"])
        else:
            lost = f"{100 * figures['lost_share']:.1f} % lost at full speed"
            table.add_row(label, f"{figures['us_per_frame']:.1f}", lost)
    return table


def _table_of_lateness(result: Result) -> Table:
    table = Table(title="Lateness of the firmware's loop in real time, µs", title_justify="left")
    for heading in ("rate", "p50", "p99", "p99.9", "max", "overruns", "epochs"):
        table.add_column(heading, justify="right")
    rows = [(f"{rate_hz} Hz", row) for rate_hz, row in result["lateness_us"].items()]
    rows += [
        (f"{rate_hz} Hz, every identifier read {row['times_read']} times", row)
        for rate_hz, row in result["lateness_while_read_us"].items()
    ]
    for what, lateness in rows:
        figures = [f"{lateness[key]:.0f}" for key in ("p50", "p99", "p999", "max")]
        counts = [str(lateness[key]) for key in ("overruns", "epochs")]
        table.add_row(what, *figures, *counts)
        if not lateness["completed"]:
            table.caption = "a run was aborted near its end (fewer epochs)"
    return table
