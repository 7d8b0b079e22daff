"""The truth of a recorded rehearsal, computed anew.

The hardware of the recorded scenario gets the commands of the log and so goes the same way again.
Its frames are compared with the recorded ones: where they are not the same, the truth would not be
that of the recording, and there is none.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dbc.codec import load
from dbc.frame import FrameArray, frame_array
from host_tools.hardware.loop import Hardware
from host_tools.hardware.memory import TRUTH
from host_tools.logs.epochs import NO_STEP, Steps
from host_tools.outfit import hardware_settings, scenario_wire
from host_tools.rows import RowBuffer, RowFile
from host_tools.scenario import Scenario

_OPERATOR = ("MODE_COMMAND",)  # the emulated hardware sends it for the operator
_MOST_AHEAD = 500  # frames


def hardware_identifiers() -> list[int]:
    """Return the identifiers that the emulated hardware sends."""
    return [
        message.frame_id
        for message in load().database.messages
        if message.name in _OPERATOR or "HARDWARE" in message.senders
    ]


class Truth:
    """The emulated hardware, run over the steps of a log.

    Parameters
    ----------
    scenario : Scenario
        The one that was recorded.
    file : RowFile
        Takes the truth.
    log_every : int
        Epochs from one row to the next.

    Attributes
    ----------
    why_not : str or None
        Why there is no truth; None while there is.
    """

    def __init__(self, scenario: Scenario, file: RowFile, log_every: int) -> None:
        self.why_not: str | None = None
        self._hardware = Hardware(
            hardware_settings(scenario), scenario_wire(scenario, is_live=True)
        )
        self._epochs = scenario.epochs
        self._rows = RowBuffer(TRUTH, file)
        self._log_every = log_every
        self._identifiers = hardware_identifiers()
        self._epoch = 0
        self._inbox = frame_array(0)
        self._computed = frame_array(0)  # of the hardware's frames, those not compared yet
        self._recorded = frame_array(0)
        self._waiting = frame_array(0)  # had by the firmware in a step that is not closed yet
        self._waiting_step = np.zeros(0, dtype=np.int64)

    def follow(self, steps: Steps) -> None:
        """Run the hardware over the steps that are closed."""
        if self.why_not is not None:
            return
        known = steps.step != NO_STEP
        received = known & ~steps.is_sent
        frames = np.concatenate([self._waiting, steps.frames[received]])
        step = np.concatenate([self._waiting_step, steps.step[received]])
        sent, sent_step = steps.frames[known & steps.is_sent], steps.step[known & steps.is_sent]
        numbers = np.arange(steps.first, steps.first + len(steps.epochs))
        ends = np.searchsorted(step, numbers, side="right").tolist()
        sent_ends = np.searchsorted(sent_step, numbers, side="right").tolist()
        start = sent_start = 0
        for k, (end, sent_end) in enumerate(zip(ends, sent_ends, strict=True)):
            self.why_not = self._step(int(steps.epochs[k]), frames[start:end])
            if self.why_not is not None:
                break
            self._inbox = np.concatenate([self._inbox, sent[sent_start:sent_end]])
            start, sent_start = end, sent_end
        self._waiting, self._waiting_step = frames[start:].copy(), step[start:].copy()

    def _step(self, epoch: int, received: FrameArray) -> str | None:
        """Run an epoch; return why it is not the recorded one, if so."""
        if epoch < 0:  # the hardware was not there yet
            self._inbox = frame_array(0)
            return None
        if epoch != self._epoch:
            return f"epoch {epoch} of the log follows epoch {self._epoch - 1}"
        if epoch > self._epochs:
            return f"the scenario ends at epoch {self._epochs}"
        is_ours = np.isin(received["can_id"], self._identifiers)
        frames, count = self._hardware.open_epoch(epoch, self._inbox, len(self._inbox))
        self._computed = np.concatenate([self._computed, frames[:count]])
        self._recorded = np.concatenate([self._recorded, received[is_ours]])
        if not self._agree():
            return f"from epoch {epoch} on, the scenario's hardware would send other frames"
        self._inbox = received[~is_ours].copy()
        if epoch % self._log_every == 0:
            self._rows.take(self._hardware.plant["truth"])
        self._epoch += 1
        return None

    def _agree(self) -> bool:
        """Compare what there is of both; in real time one may be ahead of the other."""
        both = min(len(self._computed), len(self._recorded))
        same = _same(self._computed[:both], self._recorded[:both])
        self._computed, self._recorded = self._computed[both:], self._recorded[both:]
        return same and max(len(self._computed), len(self._recorded)) <= _MOST_AHEAD

    def close(self) -> None:
        """Write what was taken."""
        self._rows.flush()


def _same(ours: FrameArray, theirs: NDArray[np.void]) -> bool:
    return bool(
        np.array_equal(ours["can_id"], theirs["can_id"])
        and np.array_equal(ours["data"], theirs["data"])
        and np.array_equal(ours["length"], theirs["length"])
    )
