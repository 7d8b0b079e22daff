"""The truth of a recorded rehearsal, computed anew.

The hardware of the recorded scenario gets the commands of the log and so goes the same way again.
Its frames are compared with the recorded ones: where they are not the same, the truth would not be
that of the recording, and there is none.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dbc.codec import load
from dbc.frame import FRAME, frame_array
from host_tools.hardware.loop import Hardware
from host_tools.hardware.memory import TRUTH
from host_tools.logs.cut import IDENTIFIERS
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
        self._is_hardwares = np.zeros(IDENTIFIERS, dtype=np.bool_)
        self._is_hardwares[hardware_identifiers()] = True
        self._epoch = 0
        self._inbox = frame_array(0)  # for the hardware, and the steps in which it came
        self._inbox_step = np.zeros(0, dtype=np.int64)
        self._begins: list[int] = []  # where those of each step begin
        self._computed = frame_array(0)  # of the hardware's frames, those not compared yet
        self._computed_epoch: list[int] = []
        self._recorded = frame_array(0)

    def follow(self, steps: Steps) -> None:
        """Run the hardware over the steps that are closed."""
        if self.why_not is not None:
            return
        identifiers = np.minimum(steps.frames["can_id"], IDENTIFIERS - 1)
        is_hardwares = self._is_hardwares[identifiers] & (steps.step != NO_STEP)
        self._take_inbox(steps, ~is_hardwares & (steps.step != NO_STEP))
        computed = bytearray(self._computed.tobytes())
        for k, epoch in enumerate(steps.epochs.tolist()):
            if epoch < 0:  # the hardware was not there yet
                continue
            if epoch != self._epoch or epoch > self._epochs:
                self.why_not = f"epoch {epoch} comes where the scenario's hardware is elsewhere"
                return
            frames = self._step(epoch, *self._begins[k : k + 2])
            computed += frames
            self._computed_epoch += [epoch] * (len(frames) // FRAME.itemsize)
        self._computed = np.frombuffer(bytes(computed), dtype=FRAME)
        self._recorded = np.concatenate([self._recorded, steps.frames[is_hardwares]])
        self._compare()
        is_left = self._inbox_step >= steps.first + len(steps.epochs) - 1
        self._inbox, self._inbox_step = self._inbox[is_left], self._inbox_step[is_left]

    def _take_inbox(self, steps: Steps, mask: NDArray[np.bool_]) -> None:
        """Take what the hardware has in the epoch after: first others' frames, then the answer."""
        inbox = np.concatenate([self._inbox, steps.frames[mask]])
        step = np.concatenate([self._inbox_step, steps.step[mask]])
        is_sent = np.concatenate([np.zeros(len(self._inbox), np.bool_), steps.is_sent[mask]])
        order = np.argsort(2 * step + is_sent, kind="stable")
        self._inbox, self._inbox_step = inbox[order], step[order]
        numbers = np.arange(steps.first - 1, steps.first + len(steps.epochs))
        self._begins = np.searchsorted(self._inbox_step, numbers).tolist()

    def _step(self, epoch: int, begin: int, end: int) -> bytes:
        """Run an epoch on a part of the inbox; return the frames that the hardware sends."""
        frames, count = self._hardware.open_epoch(epoch, self._inbox[begin:end], end - begin)
        if epoch % self._log_every == 0:
            self._rows.take(self._hardware.plant["truth"])
        self._epoch += 1
        return frames[:count].tobytes()

    def _compare(self) -> None:
        """Compare what there is of both; in real time one may be ahead of the other."""
        both = min(len(self._computed), len(self._recorded))
        ours, theirs = self._computed[:both], self._recorded[:both]
        same = np.ones(both, dtype=np.bool_)
        for name in ("can_id", "length", "data"):
            same &= ours[name] == theirs[name]
        if not same.all():
            epoch = self._computed_epoch[int(np.argmin(same))]
            self.why_not = f"from epoch {epoch} on, the scenario's hardware sends other frames"
        elif max(len(self._computed), len(self._recorded)) - both > _MOST_AHEAD:
            self.why_not = f"frames of the hardware are missing before epoch {self._epoch}"
        self._computed, self._recorded = self._computed[both:], self._recorded[both:]
        del self._computed_epoch[:both]

    def close(self) -> None:
        """Write what was taken."""
        self._rows.flush()
