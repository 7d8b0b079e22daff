"""A run that a program has to answer as our own firmware does: every frame of every epoch."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rrins.dbc.frame import Frame, FrameArray
from rrins.host_tools.conformance.answers import Answer, difference
from rrins.host_tools.conformance.stimuli import Sent, Stimulus, Tap
from rrins.host_tools.runs.programs.program import Program
from rrins.host_tools.testing.errors import BenchError
from rrins.host_tools.testing.processes import OwnProgram
from rrins.host_tools.testing.recording import FrameRing
from rrins.host_tools.testing.scenarios import merged, prepare_scenario
from rrins.host_tools.testing.virtual_time import DirectExecution, LockstepExecution

BASE: Final[dict[str, Any]] = {
    "duration_s": 7200.0,
    "redundancy": {"enabled": False},
    "firmware": {"alignment_s": 1.0},
}
PATIENCE_S: Final = 10.0
"""Longest silence of a program in lockstep, in wall clock time."""

_RING: Final = 256  # frames; nothing here looks at them

Stimuli = Sequence[Stimulus]


@dataclass(frozen=True)
class Trial:
    """A scenario and what is done to its frames."""

    name: str
    seconds: float  #: of simulated time, from power-on
    overrides: dict[str, Any] = field(default_factory=dict)  #: of `BASE`
    stimuli: Callable[[], Stimuli] = tuple  #: made anew for each run
    scenario: str = "rimu_rotating"
    late_s: float = 0.0  #: how long the hardware has run when the program comes
    position_steps: int = 3  #: of the frames, permitted for latitude and longitude

    def answers(self, program: str | None, is_reference: bool, folder: Path) -> Iterator[Answer]:
        """Run it; yield the frames of the firmware, epoch by epoch.

        Parameters
        ----------
        program : str or None
            Command line; None for our own firmware.
        is_reference : bool
            Whether our own firmware runs in this process.
        folder : Path
            Where the scenario goes.
        """
        file = folder / f"{self.name}.toml"
        scenario = prepare_scenario(self.scenario, merged(BASE, self.overrides), file, folder)
        stand: _Direct | _Lockstep
        if is_reference:
            stand = _Direct(scenario, FrameRing(_RING))
        else:
            own = None if program is None else OwnProgram(Program.parse(program), scenario)
            stand = _Lockstep(scenario, FrameRing(_RING), file, PATIENCE_S, own=own)
        stand.tap = Tap(self.stimuli(), scenario.rate_hz)
        stand.silent_epochs = round(self.late_s * scenario.rate_hz)
        try:
            for epoch in range(round(self.seconds * scenario.rate_hz)):
                stand.pump(stand.now_ns + scenario.period_ns)
                if epoch >= stand.silent_epochs:
                    yield stand.answer
        finally:
            stand.close()

    def compare(self, program: str | None, folder: Path) -> None:
        """Raise AssertionError at the first frame that differs from our own firmware's."""
        wanted, rate_hz = reference(self)
        first = round(self.late_s * rate_hz)
        for epoch, answer in enumerate(self.answers(program, False, folder), first):
            ours = wanted[epoch - first]
            if answer == ours:
                continue
            what = difference(answer, ours, self.position_steps)
            if what:
                done = Tap(self.stimuli(), rate_hz).words(epoch)
                context = f"\n  to the frames: {done}" if done else ""
                raise AssertionError(f"at {epoch / rate_hz:.3f} s: {what}{context}")


_references: dict[str, tuple[list[Answer], int]] = {}


def reference(trial: Trial) -> tuple[list[Answer], int]:
    """Return the answers of our own firmware, found once in a process, and the rate."""
    if trial.name not in _references:
        with tempfile.TemporaryDirectory(prefix="rrins-conform-") as folder:
            file = Path(folder) / "scenario.toml"
            rate = prepare_scenario(
                trial.scenario, merged(BASE, trial.overrides), file, Path(folder)
            ).rate_hz
            answers = list(trial.answers(None, True, Path(folder)))
        _references[trial.name] = (answers, rate)
    return _references[trial.name]


class _Tapped:
    """The part of an execution between the hardware and the firmware."""

    tap: Tap
    silent_epochs = 0
    answer: Answer = b""

    def tapped(self, frames: FrameArray, count: int, epoch: int) -> tuple[FrameArray, int]:
        """Return the frames as the tap leaves them."""
        columns = (frames[name][:count].tolist() for name in ("can_id", "length", "data"))
        before = [Sent(*values) for values in zip(*columns, strict=True)]
        after = self.tap.apply(before, epoch)
        if after is before:
            return frames, count
        rows: list[tuple[object, ...]] = [(*one[:2], 0, 0, 0, one.data) for one in after]
        return Frame.array(rows), len(rows)


class _Direct(_Tapped, DirectExecution):
    def _exchange(self, frames: FrameArray, count: int, epoch: int) -> None:
        if epoch < self.silent_epochs:
            return
        super()._exchange(*self.tapped(frames, count, epoch), epoch)
        self.answer = self._inbox[: self._count].tobytes()


class _Lockstep(_Tapped, LockstepExecution):
    def _exchange(self, frames: FrameArray, count: int, epoch: int) -> None:
        if epoch < self.silent_epochs:
            return
        super()._exchange(*self.tapped(frames, count, epoch), epoch)
        self.answer = self._inbox[: self._count].tobytes()
        if self.failure:
            raise BenchError(self.failure)
