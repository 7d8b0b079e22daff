"""Replays a log through the firmware and compares its output with the recording."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rrins.dbc.codec import load
from rrins.firmware_py.core.navigation.trace import NavigationTrace
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.files import JsonObject
from rrins.host_tools.logs.alignment import OnProgress, PendingFrames, compare_blocks, firmware_of
from rrins.host_tools.logs.comparison import Comparison, Sent
from rrins.host_tools.logs.epochs import EpochFinder, LogSteps
from rrins.host_tools.logs.frame_steps import NO_EPOCH, NO_STEP
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.logs.reference_truth import ReferenceTruth
from rrins.host_tools.logs.renavigation import Answers, Renavigation, check_rate
from rrins.host_tools.logs.truth import RecomputedTruth
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.runs.results.samples import keep_every, sample_files
from rrins.host_tools.runs.results.seconds_log import SecondsLog
from rrins.host_tools.runs.set_up.settings import firmware_settings
from rrins.host_tools.runs.sides.firmware_job import firmware_summary
from rrins.host_tools.scenario.scenario import Scenario


def firmware_messages() -> frozenset[str]:
    """Return the messages that the firmware sends."""
    messages = load().database.messages
    return frozenset(message.name for message in messages if "FIRMWARE" in message.senders)


@dataclass(frozen=True)
class Replayed:
    """Result of a replay through the firmware.

    Attributes
    ----------
    first_epoch, last_epoch : int
        Of the log; `NO_EPOCH` where it has no SYNC.
    """

    firmware: JsonObject  #: `rrins.host_tools.runs.sides.firmware_job.firmware_summary`.
    steps: int
    first_epoch: int
    last_epoch: int
    wall_s: float
    has_firmware: bool  #: whether the firmware's own frames are in the log
    comparison: Comparison | None
    why_no_truth: str | None
    #: how long the hardware keeps sending in the log after the firmware's last step
    unanswered_s: float


class _Run:
    """Runs the firmware and, if available, the truth over the steps of a log."""

    def __init__(
        self, log: Log, scenario: Scenario, folder: Path | None, on_progress: OnProgress
    ) -> None:
        log_every = keep_every(scenario.epochs, scenario.rate_hz)
        self._navigation_file, self._truth_file = sample_files(folder)
        self._log = log
        self._scenario = scenario
        self._on_progress = on_progress
        settings = firmware_settings(scenario)
        self.firmware = Firmware(settings, NavigationTrace(log_every, self._navigation_file.append))
        is_lockstep = log.note is not None and log.note.is_lockstep
        error_ppm = scenario.firmware.clock_error_ppm
        self._seconds = SecondsLog(self.firmware.ram, folder, scenario.duration_s)
        self.renavigation = Renavigation(self.firmware, error_ppm, is_lockstep, self._note_seconds)
        self.truth = None if folder is None else self._truth_of(log, log_every)
        self.finder = EpochFinder()
        self.first_epoch = self.last_epoch = NO_EPOCH
        self._answered_until_s = self._heard_until_s = 0.0

    def _truth_of(self, log: Log, log_every: int) -> RecomputedTruth | ReferenceTruth:
        """Return the truth of a rehearsal, repeated, or of a vehicle, as somebody else found it."""
        note = log.note
        if note is not None and note.origin == "vehicle":
            path = None if note.truth is None else log.path.with_name(note.truth)
            return ReferenceTruth(path, self._scenario, self._truth_file, log_every)
        recorded = None if note is None else note.loaded_scenario(log.path)
        return RecomputedTruth(recorded or self._scenario, self._truth_file, log_every)

    def _note_seconds(self) -> None:
        if self._seconds.every and self.renavigation.steps % self._seconds.every == 0:
            self._seconds.run()

    @property
    def unanswered_s(self) -> float:
        """How long the hardware keeps sending after the last step."""
        return max(0.0, self._heard_until_s - self._answered_until_s)

    def _update_times(self, steps: LogSteps) -> None:
        is_answered = steps.step != NO_STEP
        for mask in (is_answered, ~steps.is_sent):
            if mask.any():
                self._heard_until_s = float(steps.time_s[mask][-1])
        if is_answered.any():
            self._answered_until_s = float(steps.time_s[is_answered][-1])

    def answers(self) -> Iterator[tuple[LogSteps, Answers]]:
        """Yield steps and the firmware's answers to them."""
        for steps in self.finder.steps(check_rate(self._log.pieces(), self._scenario)):
            self._update_times(steps)
            answers = self.renavigation.answer(steps)
            if self.truth is not None:
                self.truth.follow(steps)
            known = steps.epochs[steps.epochs != NO_EPOCH]
            if len(known):
                self.first_epoch = int(known[0]) if self.first_epoch < 0 else self.first_epoch
                self.last_epoch = int(known[-1])
            self._on_progress(self._log.position)
            yield steps, answers
            if self.renavigation.has_ended:
                break

    def close(self) -> JsonObject:
        """Close the files; return the firmware's summary."""
        summary = firmware_summary(self.firmware)
        self._seconds.run()
        self._seconds.close()
        if self.truth is not None:
            self.truth.close()
        self._truth_file.close()
        self._navigation_file.close()
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
        Configures the firmware.
    folder : Path, optional
        Where the samples of navigation and truth go.
    with_comparison : bool
        Whether to compare the firmware's frames with the recorded ones.
    against : Log, optional
        Another log to compare with instead of `log`.
    on_progress : callable
        Called after every piece of the log.

    Raises
    ------
    RecordError
        If a log cannot be read, or does not match the scenario.
    """
    begun = time.monotonic()
    run = _Run(log, scenario, folder, on_progress)
    names = ("the log" if against is None else str(against.path), "the replay")
    comparison = Comparison(names, firmware_messages()) if with_comparison else None
    try:
        if comparison is not None and against is not None:
            pair = (firmware_of(against), PendingFrames(_answers_by_epoch(run)))
            compare_blocks(comparison, [pair])
        else:
            for steps, answers in run.answers():
                if comparison is not None:
                    comparison.add(_recorded(steps), _replayed(steps, answers))
    finally:
        summary = run.close()
    if comparison is not None and against is None and not run.finder.has_firmware:
        raise RecordError(f"{log.path}: nothing to compare with: it has no firmware frames")
    return Replayed(
        summary,
        run.renavigation.steps,
        run.first_epoch,
        run.last_epoch,
        time.monotonic() - begun,
        run.finder.has_firmware,
        comparison,
        "not asked for" if run.truth is None else run.truth.why_not,
        run.unanswered_s,
    )


def _answers_by_epoch(run: _Run) -> Iterator[Sent]:
    for steps, answers in run.answers():
        epoch = steps.epochs[answers.step - steps.first]
        yield Sent(answers.frames, epoch, epoch)


def _recorded(steps: LogSteps) -> Sent:
    mask = steps.is_sent & (steps.step != NO_STEP)
    step = steps.step[mask]
    return Sent(steps.frames[mask], step, steps.epochs[step - steps.first])


def _replayed(steps: LogSteps, answers: Answers) -> Sent:
    return Sent(answers.frames, answers.step, steps.epochs[answers.step - steps.first])
