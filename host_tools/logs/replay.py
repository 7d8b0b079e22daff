"""Replays a log through the firmware, and compares what it sends with what was recorded."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dbc.codec import load
from firmware_py.loop import Firmware
from firmware_py.trace import NavigationTrace
from host_tools.logs.alignment import Ahead, OnProgress, compare_blocks, firmware_of
from host_tools.logs.comparison import Comparison, Sent
from host_tools.logs.epochs import NO_EPOCH, NO_STEP, Cutter, Steps
from host_tools.logs.errors import RecordError
from host_tools.logs.reader import Log
from host_tools.logs.renavigation import Answers, Renavigation, check_rate
from host_tools.logs.truth import Truth
from host_tools.outfit import firmware_settings
from host_tools.rows import RowFile, keep_every
from host_tools.scenario import Scenario
from host_tools.sides import NAVIGATION_ROWS, TRUTH_ROWS, firmware_summary


def firmware_messages() -> frozenset[str]:
    """Return the messages that the firmware sends."""
    messages = load().database.messages
    return frozenset(message.name for message in messages if "FIRMWARE" in message.senders)


@dataclass(frozen=True)
class Replayed:
    """What a replay through the firmware came to.

    Attributes
    ----------
    firmware : dict
        `host_tools.sides.firmware_summary`.
    steps : int
    first_epoch, last_epoch : int
        Of the log; `NO_EPOCH` where it has no SYNC.
    wall_s : float
    has_firmware : bool
        Whether the firmware's own frames are in the log.
    comparison : Comparison or None
    why_no_truth : str or None
    unanswered_s : float
        How long the hardware is heard in the log after the firmware's last step.
    """

    firmware: dict[str, Any]
    steps: int
    first_epoch: int
    last_epoch: int
    wall_s: float
    has_firmware: bool
    comparison: Comparison | None
    why_no_truth: str | None
    unanswered_s: float


class _Run:
    """The firmware and, where there is one, the truth, over the steps of a log."""

    def __init__(
        self, log: Log, scenario: Scenario, folder: Path | None, on_progress: OnProgress
    ) -> None:
        log_every = keep_every(scenario.epochs, scenario.rate_hz)
        self._rows = RowFile(None if folder is None else folder / NAVIGATION_ROWS)
        self._truth_rows = RowFile(None if folder is None else folder / TRUTH_ROWS)
        self._log = log
        self._scenario = scenario
        self._on_progress = on_progress
        settings = firmware_settings(scenario)
        self.firmware = Firmware(settings, NavigationTrace(log_every, self._rows.append))
        is_lockstep = log.note is not None and log.note.is_lockstep
        error_ppm = scenario.firmware.clock_error_ppm
        self.again = Renavigation(self.firmware, error_ppm, is_lockstep)
        recorded = None if log.note is None else log.note.loaded_scenario(log.path)
        self.truth = (
            None if folder is None else Truth(recorded or scenario, self._truth_rows, log_every)
        )
        self.cutter = Cutter()
        self.first_epoch = self.last_epoch = NO_EPOCH
        self._answered_until_s = self._heard_until_s = 0.0

    @property
    def unanswered_s(self) -> float:
        """How long the hardware is heard after the last step."""
        return max(0.0, self._heard_until_s - self._answered_until_s)

    def _note_times(self, steps: Steps) -> None:
        is_answered = steps.step != NO_STEP
        for mask in (is_answered, ~steps.is_sent):
            if mask.any():
                self._heard_until_s = float(steps.time_s[mask][-1])
        if is_answered.any():
            self._answered_until_s = float(steps.time_s[is_answered][-1])

    def answers(self) -> Iterator[tuple[Steps, Answers]]:
        """Yield steps, and what the firmware sends in them."""
        for steps in self.cutter.steps(check_rate(self._log.pieces(), self._scenario)):
            self._note_times(steps)
            answers = self.again.answer(steps)
            if self.truth is not None:
                self.truth.follow(steps)
            known = steps.epochs[steps.epochs != NO_EPOCH]
            if len(known):
                self.first_epoch = int(known[0]) if self.first_epoch < 0 else self.first_epoch
                self.last_epoch = int(known[-1])
            self._on_progress(self._log.position)
            yield steps, answers
            if self.again.has_ended:
                break

    def close(self) -> dict[str, Any]:
        """Close the files; return the firmware's summary."""
        summary = firmware_summary(self.firmware)
        if self.truth is not None:
            self.truth.close()
        self._truth_rows.close()
        self._rows.close()
        return summary


def replay(
    log: Log,
    scenario: Scenario,
    folder: Path | None = None,
    with_comparison: bool = False,
    against: Log | None = None,
    on_progress: OnProgress = lambda position: None,
) -> Replayed:
    """Navigate a log again.

    Parameters
    ----------
    log : Log
    scenario : Scenario
        What the firmware is set up with.
    folder : Path, optional
        Where the rows of navigation and truth go.
    with_comparison : bool
        Whether to compare what the firmware sends with what it sent when the log was recorded.
    against : Log, optional
        Another log to compare with instead.
    on_progress : callable
        Called for every piece of the log.

    Raises
    ------
    RecordError
        When a log cannot be read, or does not fit the scenario.
    """
    begun = time.monotonic()
    run = _Run(log, scenario, folder, on_progress)
    names = ("the log" if against is None else str(against.path), "the replay")
    comparison = Comparison(names, firmware_messages()) if with_comparison else None
    try:
        if comparison is not None and against is not None:
            pair = (firmware_of(against), Ahead(_answers_by_epoch(run)))
            compare_blocks(comparison, [pair])
        else:
            for steps, answers in run.answers():
                if comparison is not None:
                    comparison.add(_recorded(steps), _replayed(steps, answers))
    finally:
        summary = run.close()
    if comparison is not None and against is None and not run.cutter.has_firmware:
        raise RecordError(f"{log.path}: nothing to compare with: the firmware is not in it")
    return Replayed(
        summary,
        run.again.steps,
        run.first_epoch,
        run.last_epoch,
        time.monotonic() - begun,
        run.cutter.has_firmware,
        comparison,
        "not asked for" if run.truth is None else run.truth.why_not,
        run.unanswered_s,
    )


def _answers_by_epoch(run: _Run) -> Iterator[Sent]:
    for steps, answers in run.answers():
        epoch = steps.epochs[answers.step - steps.first]
        yield Sent(answers.frames, epoch, epoch)


def _recorded(steps: Steps) -> Sent:
    mask = steps.is_sent & (steps.step != NO_STEP)
    step = steps.step[mask]
    return Sent(steps.frames[mask], step, steps.epochs[step - steps.first])


def _replayed(steps: Steps, answers: Answers) -> Sent:
    return Sent(answers.frames, answers.step, steps.epochs[answers.step - steps.first])
