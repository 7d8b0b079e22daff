"""Recomputes the truth of a recorded rehearsal.

The emulated hardware of the recorded scenario receives the logged commands and so repeats its run.
Its frames are compared with the recorded ones. If they differ, the truth would not be that of the
recording, and none is reported.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rrins.dbc.codec import load
from rrins.dbc.frame import Frame, frame_array
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.logs.epochs import LogSteps
from rrins.host_tools.logs.frame_steps import IDENTIFIERS, NO_STEP
from rrins.host_tools.runs.results.samples import SampleBuffer, SampleFile
from rrins.host_tools.runs.set_up.settings import hardware_settings, scenario_wire
from rrins.host_tools.scenario.scenario import Scenario

# Sent by the hardware on his behalf.
_OPERATOR = ("MODE_COMMAND", "READMISSION_COMMAND", "ZERO_VELOCITY")
_MOST_AHEAD = 500  # frames


def hardware_identifiers() -> list[int]:
    """Return the identifiers that the emulated hardware sends."""
    return [
        message.frame_id
        for message in load().database.messages
        if message.name in _OPERATOR or "HARDWARE" in message.senders
    ]


class RecomputedTruth:
    """Runs the emulated hardware over the steps of a log.

    Parameters
    ----------
    scenario : Scenario
        The recorded scenario.
    file : SampleFile
        Receives the truth.
    log_every : int
        Epochs between rows.

    Attributes
    ----------
    why_not : str or None
        Why there is no truth; None if there is one.
    """

    def __init__(self, scenario: Scenario, file: SampleFile, log_every: int) -> None:
        self.why_not: str | None = None
        self._hardware = Hardware(
            hardware_settings(scenario), scenario_wire(scenario, is_live=True)
        )
        self._epochs = scenario.epochs
        self._samples = SampleBuffer(Truth, file)
        self._log_every = log_every
        self._is_hardwares = np.zeros(IDENTIFIERS, dtype=np.bool_)
        self._is_hardwares[hardware_identifiers()] = True
        self._epoch = 0
        self._inbox = frame_array(0)  # for the hardware, and the steps of its frames
        self._inbox_step = np.zeros(0, dtype=np.int64)
        self._begins: list[int] = []  # where the frames of each step begin
        self._computed = frame_array(0)  # hardware frames not compared yet
        self._computed_epoch: list[int] = []
        self._recorded = frame_array(0)

    def follow(self, steps: LogSteps) -> None:
        """Run the hardware over the closed steps."""
        if self.why_not is not None:
            return
        identifiers = np.minimum(steps.frames["can_id"], IDENTIFIERS - 1)
        is_hardwares = self._is_hardwares[identifiers] & (steps.step != NO_STEP)
        self._fill_inbox(steps, ~is_hardwares & (steps.step != NO_STEP))
        computed = bytearray(self._computed.tobytes())
        for k, epoch in enumerate(steps.epochs.tolist()):
            if epoch < 0:  # the hardware had not started
                continue
            if epoch != self._epoch or epoch > self._epochs:
                self.why_not = f"epoch {epoch} is out of step with the scenario's hardware"
                return
            frames = self._step(epoch, *self._begins[k : k + 2])
            computed += frames
            self._computed_epoch += [epoch] * (len(frames) // Frame.dtype.itemsize)
        self._computed = Frame.from_bytes(computed)
        self._recorded = Frame.joined([self._recorded, steps.frames[is_hardwares]])
        self._compare()
        is_left = self._inbox_step >= steps.first + len(steps.epochs) - 1
        self._inbox, self._inbox_step = self._inbox[is_left], self._inbox_step[is_left]

    def _fill_inbox(self, steps: LogSteps, mask: NDArray[np.bool_]) -> None:
        """Collect the hardware's next input: frames from others first, then the answer."""
        inbox = Frame.joined([self._inbox, steps.frames[mask]])
        step = np.concatenate([self._inbox_step, steps.step[mask]])
        is_sent = np.concatenate([np.zeros(len(self._inbox), np.bool_), steps.is_sent[mask]])
        order = np.argsort(2 * step + is_sent, kind="stable")
        self._inbox, self._inbox_step = inbox[order], step[order]
        numbers = np.arange(steps.first - 1, steps.first + len(steps.epochs))
        self._begins = np.searchsorted(self._inbox_step, numbers).tolist()

    def _step(self, epoch: int, begin: int, end: int) -> bytes:
        """Run an epoch on part of the inbox; return the frames that the hardware sends."""
        frames, count = self._hardware.open_epoch(epoch, self._inbox[begin:end], end - begin)
        if epoch % self._log_every == 0:
            self._samples.append(self._hardware.truth)
        self._epoch += 1
        return frames[:count].tobytes()

    def _compare(self) -> None:
        """Compare what both have so far; in real time one may be ahead of the other."""
        both = min(len(self._computed), len(self._recorded))
        ours, theirs = self._computed[:both], self._recorded[:both]
        same = np.ones(both, dtype=np.bool_)
        for name in ("can_id", "length", "data"):
            same &= ours[name] == theirs[name]
        if not same.all():
            epoch = self._computed_epoch[int(np.argmin(same))]
            self.why_not = f"from epoch {epoch} on, the scenario's hardware sends different frames"
        elif max(len(self._computed), len(self._recorded)) - both > _MOST_AHEAD:
            self.why_not = f"hardware frames are missing before epoch {self._epoch}"
        self._computed, self._recorded = self._computed[both:], self._recorded[both:]
        del self._computed_epoch[:both]

    def close(self) -> None:
        """Flush the truth to the file."""
        self._samples.flush()
