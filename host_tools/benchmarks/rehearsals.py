"""Measurements of complete rehearsals: lockstep speed, real-time lateness, start-up time."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from contextlib import nullcontext
from itertools import pairwise
from pathlib import Path

from rrins.host_tools.benchmarks.reading import reading
from rrins.host_tools.bus.address import EMBEDDED, Address
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.runs.rehearsal import OnReport, Rehearsal
from rrins.host_tools.runs.results.outcome import Outcome
from rrins.host_tools.runs.results.summary import frames_lost
from rrins.host_tools.runs.sides.job import REALTIME
from rrins.host_tools.scenario.scenario import Scenario, load, text_of

_FIRST_EPOCH = "running"  # printed by `rrins rehearse` when the hardware opens the first epoch
_SELF_TEST_S = 1.0
_ALIGNMENT_S = 0.2
_ENOUGH = 0.9  # share of the epochs: a run that a busy machine aborts near its end still counts


def _rehearse(
    name: str, scenario: Scenario, channel: str, speed: float | None, folder: Path, watch: OnReport
) -> Outcome:
    options = (f"--duration={scenario.duration_s!r}",)
    address = Address(EMBEDDED, channel)
    return Rehearsal(name, scenario, options, address, speed, folder).run(watch)


def lockstep(name: str, duration_s: float, channel: str, folder: Path) -> tuple[list[float], int]:
    """Rehearse as fast as possible; `duration_s` is simulated time, longer than a section (10 s).

    Returns
    -------
    list of float
        Epochs per second of each section between two hardware reports, from the first epoch on.
    int
        Frames lost.

    Raises
    ------
    RehearsalError
        If the rehearsal fails.
    """
    marks: list[tuple[int, int]] = []

    def watch(report: JsonObject) -> None:
        if report["kind"] == "progress" and report["side"] == "hardware":
            marks.append((report["epoch"], time.monotonic_ns()))

    scenario = load(name, duration_s=duration_s)
    outcome = _rehearse(name, scenario, channel, None, folder, watch)
    if outcome.failure is not None:
        raise outcome.failure
    lost = frames_lost(outcome.firmware, outcome.hardware)
    assert lost is not None
    speeds = [
        (last - first) / ((end_ns - start_ns) * 1e-9)
        for (first, start_ns), (last, end_ns) in pairwise(marks)
    ]
    return speeds, lost


def realtime(
    name: str, rate_hz: int, seconds: float, channel: str, folder: Path, is_read: bool = False
) -> tuple[JsonObject, JsonObject]:
    """Rehearse in real time for `seconds` at `rate_hz`.

    With `is_read` a diagnostic tool repeatedly reads every identifier meanwhile.

    Returns
    -------
    dict
        Lateness of the firmware's loop, µs.
    dict
        Whether ``sched_fifo`` and ``memory_locked`` were permitted.

    Raises
    ------
    RehearsalError
        If the rehearsal fails.
    """
    permitted: JsonObject = dict.fromkeys(("sched_fifo", "memory_locked"), False)

    def watch(report: JsonObject) -> None:
        if report["kind"] == "ready" and report["side"] == "firmware":
            permitted.update({key: bool(report.get(key)) for key in permitted})

    text = text_of(name)
    for key, value in (("rate_hz", rate_hz), ("alignment_s", _ALIGNMENT_S)):
        text, replaced = re.subn(rf"(?m)^{key} *= *[\d.]+", f"{key} = {value}", text)
        assert replaced == 1, f"{name} has no {key} to replace"
    path = folder / f"{name}-{rate_hz}.toml"
    path.write_text(text, encoding="utf-8")
    scenario = load(str(path), duration_s=seconds - _SELF_TEST_S - _ALIGNMENT_S)
    with reading(channel) if is_read else nullcontext() as count:
        outcome = _rehearse(str(path), scenario, channel, REALTIME, folder, watch)
    lateness = outcome.firmware.get("lateness_us", {"epochs": 0})
    if count is not None:
        lateness |= {"times_read": count.times}
    if outcome.failure is not None and lateness["epochs"] < _ENOUGH * scenario.epochs:
        raise outcome.failure
    return lateness | {"completed": outcome.failure is None}, permitted


def start_s(name: str, channel: str, folder: Path, cache: Path | None) -> float:
    """Return the seconds from starting `rrins rehearse` to its first epoch.

    Parameters
    ----------
    name : str
        Scenario.
    channel : str
    folder : Path
        Output folder of the rehearsal.
    cache : Path or None
        Cache folder for compiled code; None for the usual one.

    Raises
    ------
    RehearsalError
        If the first epoch is never reached.
    """
    # Into a pipe the command prints its progress line by line, unless colours are forced.
    hidden = ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE")
    environment = {key: value for key, value in os.environ.items() if key not in hidden}
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    command = [sys.executable, "-m", "rrins", "rehearse", name, "--duration", "1"]
    command += ["--channel", channel, "--out", str(folder)]
    said = ""
    start_ns = time.monotonic_ns()
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        start_new_session=True,
    ) as process:
        assert process.stderr is not None
        try:
            for line in process.stderr:
                said = line.strip()
                if said == _FIRST_EPOCH:
                    return (time.monotonic_ns() - start_ns) * 1e-9
        finally:
            process.terminate()
            process.communicate()
    raise RehearsalError(f"the rehearsal did not reach its first epoch: {said}")
