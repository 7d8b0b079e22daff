"""Renavigation: feeds the frames of a log through the firmware, without a bus."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Integers
from rrins.dbc.codec import unpack
from rrins.dbc.contract import load_contract
from rrins.dbc.e2e import crc_holds
from rrins.dbc.frame import Frame, FrameArray, frame_array
from rrins.firmware_py.core.frames_in.clock import own_clock_ns
from rrins.firmware_py.core.frames_out.transmit import OUTBOX_CAPACITY
from rrins.firmware_py.loop import INBOX_CAPACITY, Firmware
from rrins.host_tools.logs.epochs import LogSteps
from rrins.host_tools.logs.frame_steps import NO_STEP
from rrins.host_tools.logs.reader import Piece
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.scenario.scenario import Scenario


@dataclass(frozen=True)
class Answers:
    """Frames that the firmware sent, and the step of each."""

    frames: FrameArray
    step: Integers


class Renavigation:
    """Runs the firmware over the steps of a log.

    Parameters
    ----------
    firmware : Firmware
        At power-on.
    clock_error_ppm : float
        Error of the firmware's own clock, which does not affect the navigation.
    on_step : callable
        Called after each step.
    in_lockstep : bool
        Whether the firmware is known to have run in lockstep. If so, a SYNC of a later epoch is
        spurious and is dropped with what follows; otherwise it is left for the next step.

    Attributes
    ----------
    steps : int
        Steps run so far.
    """

    def __init__(
        self,
        firmware: Firmware,
        clock_error_ppm: float = 0.0,
        in_lockstep: bool = False,
        on_step: Callable[[], None] = lambda: None,
    ) -> None:
        self.firmware = firmware
        self.steps = 0
        self._clock_error_ppm = clock_error_ppm
        self._in_lockstep = in_lockstep
        self._on_step = on_step
        self._frames = frame_array(0)  # not yet received by the firmware, and their steps
        self._step = np.zeros(0, dtype=np.int64)

    @property
    def has_ended(self) -> bool:
        """Whether the operator has shut down the computer."""
        return self.firmware.is_shut_down

    def answer(self, steps: LogSteps) -> Answers:
        """Run the closed steps; return what the firmware sent in them."""
        is_received = ~steps.is_sent & (steps.step != NO_STEP)
        frames = Frame.joined([self._frames, steps.frames[is_received]])
        step = np.concatenate([self._step, steps.step[is_received]])
        numbers = np.arange(steps.first, steps.first + len(steps.epochs))
        out = frame_array(len(numbers) * OUTBOX_CAPACITY)
        sent = np.zeros(len(numbers), dtype=np.int64)
        at = 0
        start = 0
        ends = np.searchsorted(step, numbers, side="right").tolist()
        for k, end in enumerate(ends):
            if self.has_ended:
                break
            count, start = self._run(frames, start, end)
            self._on_step()
            out[at : at + count] = self.firmware.outbox[:count]
            sent[k] = count
            at += count
        self._frames, self._step = frames[start:].copy(), step[start:].copy()
        return Answers(out[:at], np.repeat(numbers, sent))

    def _run(self, frames: FrameArray, start: int, end: int) -> tuple[int, int]:
        """Run a step on ``frames[start:end]``; return what it sent and the next step's start."""
        firmware = self.firmware
        arrival_ns = own_clock_ns(self.steps * firmware.period_ns, self._clock_error_ppm)
        self.steps += 1
        if self._in_lockstep:
            return firmware.step_whole(frames[start:end], end - start, arrival_ns), end
        sent, start = firmware.step(frames, start, end, arrival_ns)
        while end - start > INBOX_CAPACITY:  # the log lacks steps: catch up
            _, start = firmware.step(frames, start, end, arrival_ns)
        return sent, start


def check_rate(pieces: Iterator[Piece], scenario: Scenario) -> Iterator[Piece]:
    """Pass pieces on; check that SYNC arrives at the scenario's rate.

    Raises
    ------
    RecordError
        If it does not, or if there is no SYNC at all.
    """
    sync = load_contract()[0]["sync"]
    identifier = int(sync.message.can_id)
    known: list[tuple[int, int]] = []
    for piece in pieces:
        if len(known) < 2:
            for k in np.flatnonzero(piece.frames["can_id"] == identifier)[:1000]:
                frame = piece.frames[k]
                if len(known) < 2 and crc_holds(frame, sync.message):
                    found = (
                        int(unpack(frame["data"], sync["epoch"])),
                        int(unpack(frame["data"], sync["time_us"])),
                    )
                    if not known or found[0] > known[0][0]:
                        known.append(found)
            if len(known) == 2:
                _compare_rates(known, scenario)
        yield piece
    if not known:
        raise RecordError("the log has no SYNC: it cannot be navigated")


def _compare_rates(known: list[tuple[int, int]], scenario: Scenario) -> None:
    (first, first_us), (second, second_us) = known
    period_us = (second_us - first_us) / (second - first)
    if second_us > first_us and abs(period_us - scenario.period_ns / 1000) > 1.0:
        raise RecordError(
            f"the log runs at {1e6 / period_us:.0f} Hz, the scenario at {scenario.rate_hz} Hz"
        )
