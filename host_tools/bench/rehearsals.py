"""What is measured by whole rehearsals: lockstep speed, lateness in real time, time to start."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from host_tools import scenario as scenarios
from host_tools.bench.reading import reading
from host_tools.errors import RehearsalError
from host_tools.port import EMBEDDED, Address
from host_tools.rehearsal import OnReport, Outcome, Rehearsal
from host_tools.scenario import Scenario
from host_tools.sides import REALTIME
from host_tools.summary import frames_lost

_FIRST_EPOCH = "running"  # what `rrins rehearse` says when the hardware opens the first epoch
_SELF_TEST_S = 1.0
_ALIGNMENT_S = 0.2
_ENOUGH = 0.9  # of the epochs: a run that a busy machine breaks off at its end is measured, too


def _rehearse(
    name: str, scenario: Scenario, channel: str, speed: float | None, folder: Path, watch: OnReport
) -> Outcome:
    options = (f"--duration={scenario.duration_s!r}",)
    address = Address(EMBEDDED, channel)
    return Rehearsal(name, scenario, options, address, speed, folder).run(watch)


class _Sections:
    """Notes when the hardware reports an epoch, from the first to the last."""

    def __init__(self) -> None:
        self._marks: list[tuple[int, int]] = []

    def take(self, report: dict[str, Any]) -> None:
        if report["kind"] == "progress" and report["side"] == "hardware":
            self._marks.append((report["epoch"], time.monotonic_ns()))

    def per_s(self) -> list[float]:
        return [
            (last - first) / ((end_ns - start_ns) * 1e-9)
            for (first, start_ns), (last, end_ns) in pairwise(self._marks)
        ]


@dataclass(frozen=True)
class Lockstep:
    """A rehearsal in lockstep.

    Attributes
    ----------
    epochs_per_s : list of float
        Of each section between two reports of the hardware, from the first epoch to the last.
    frames_lost : int
    """

    epochs_per_s: list[float]
    frames_lost: int


def lockstep(name: str, duration_s: float, channel: str, folder: Path) -> Lockstep:
    """Rehearse as fast as it goes; `duration_s` is simulated, and longer than a section (10 s).

    Raises
    ------
    RehearsalError
        When the rehearsal fails.
    """
    sections = _Sections()
    scenario = scenarios.load(name, duration_s=duration_s)
    outcome = _rehearse(name, scenario, channel, None, folder, sections.take)
    if outcome.failure is not None:
        raise outcome.failure
    lost = frames_lost(outcome.firmware, outcome.hardware)
    assert lost is not None
    return Lockstep(sections.per_s(), lost)


@dataclass(frozen=True)
class Realtime:
    """A rehearsal in real time: lateness of the firmware's loop (µs), what the system permitted."""

    lateness_us: dict[str, Any]
    sched_fifo: bool
    memory_locked: bool


def realtime(
    name: str, rate_hz: int, seconds: float, channel: str, folder: Path, is_read: bool = False
) -> Realtime:
    """Rehearse in real time for `seconds` at `rate_hz`.

    With `is_read` a diagnostic tool reads every identifier meanwhile, again and again.

    Raises
    ------
    RehearsalError
        When the rehearsal fails.
    """
    permitted: dict[str, Any] = {}

    def watch(report: dict[str, Any]) -> None:
        if report["kind"] == "ready" and report["side"] == "firmware":
            permitted.update(report)

    text = scenarios.text_of(name)
    for key, value in (("rate_hz", rate_hz), ("alignment_s", _ALIGNMENT_S)):
        text, replaced = re.subn(rf"(?m)^{key} *= *[\d.]+", f"{key} = {value}", text)
        assert replaced == 1, f"{name} has no {key} to replace"
    path = folder / f"{name}-{rate_hz}.toml"
    path.write_text(text, encoding="utf-8")
    scenario = scenarios.load(str(path), duration_s=seconds - _SELF_TEST_S - _ALIGNMENT_S)
    with reading(channel) if is_read else nullcontext() as count:
        outcome = _rehearse(str(path), scenario, channel, REALTIME, folder, watch)
    lateness = outcome.firmware.get("lateness_us", {"epochs": 0})
    if count is not None:
        lateness |= {"times_read": count.times}
    if outcome.failure is not None and lateness["epochs"] < _ENOUGH * scenario.epochs:
        raise outcome.failure
    return Realtime(
        lateness | {"completed": outcome.failure is None},
        bool(permitted.get("sched_fifo")),
        bool(permitted.get("memory_locked")),
    )


def start_s(name: str, channel: str, folder: Path, cache: Path | None) -> float:
    """Return the seconds from starting `rrins rehearse` to its first epoch.

    Parameters
    ----------
    name : str
        Scenario.
    channel : str
    folder : Path
        For what the rehearsal writes.
    cache : Path or None
        Where compiled code is kept; None for where it is always kept.

    Raises
    ------
    RehearsalError
        When there never is a first epoch.
    """
    # Into a pipe the command shows its progress line by line, unless it is told to use colours.
    hidden = ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE")
    environment = {key: value for key, value in os.environ.items() if key not in hidden}
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    command = [sys.executable, "-m", "host_tools", "rehearse", name, "--duration", "1"]
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
    raise RehearsalError(f"the rehearsal never began: {said}")
