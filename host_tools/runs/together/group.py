"""A group of runs: as long as they can, all go through one loop."""

from __future__ import annotations

import mmap
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.lanes import LANES
from rrins.compiled.record import Floats, Records
from rrins.firmware_py.core.records.memory import NavigationOutput, Ram
from rrins.firmware_py.core.redundancy.parity import LEARNED_S
from rrins.host_tools.hardware.memory import Plant, Sensors, Truth
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.together import loop, rows

AT_ONCE = 8 * LANES
"""Runs for which a leading run is worth its time; more would need more memory."""

_PART_S = 300
"""Simulated seconds between two looks at whether to stop."""

_CLOSE_RAD, _CLOSE_MPS = 1e-12, 1e-6
"""By how much the leading run may differ when it goes through the loop as the others do."""

_PAGE = 4096
_KINDS = ("gyros", "accelerometers")


@dataclass(frozen=True)
class Shared:
    """A run that went through the loop of a group.

    Attributes
    ----------
    ram : Records[Ram]
        Its firmware's memory; `navigation` is that of the last sample.
    samples : array, shape (n, 4)
        Latitude and longitude (rad), velocity to the east and north (m/s).
    truth : Records[Truth]
        In the same epochs.
    """

    ram: Records[Ram]
    samples: Floats
    truth: Records[Truth]

    @property
    def navigation(self) -> Records[NavigationOutput]:
        """The navigation of the last sample."""
        return cast("Records[NavigationOutput]", self.ram["navigation"])


class Group:
    """Runs that share a loop.

    Parameters
    ----------
    runs : sequence of FastRun
        Just switched on, alike in what `conditions.shared_of` returns. The first one leads.
    epochs, every : int
        As `FastRun` takes them.

    Attributes
    ----------
    memory : array, shape (n, `rows.ROWS`, `LANES`)
        Of the runs, eight side by side.
    """

    def __init__(self, runs: Sequence[FastRun], epochs: int, every: int) -> None:
        first = runs[0]
        self._first, self._count, self._epochs, self._every = first, len(runs), epochs, every
        self._rate_hz = 1_000_000_000 // int(first.plant[0].period_ns)
        self._rams, self._plants = _joined([run.ram for run in runs]), Plant.zeros(len(runs))
        for k, run in enumerate(runs):
            self._plants[k] = run.plant[0]
        self._samples = np.zeros((1 + self._count, epochs // every + 1, 4))
        self._truth = Truth.zeros(epochs // every + 1)
        self._lost = np.zeros(self._count, np.uint8)
        self._row = self._done = 0
        sensors = int(first.plant[0].gyros.count) + int(first.plant[0].accelerometers.count)
        blocks = -(-self._count // LANES)
        self._felt = _felt_by(first.plant)
        self.memory = np.zeros((blocks, rows.ROWS, LANES))
        self._phases = np.zeros((blocks, 2, LANES), np.int64)
        self._alike = np.zeros((blocks, 2), np.int64)
        self._second = np.zeros((blocks, 3))
        self._longitude = np.zeros(self._count)
        self._shared = np.zeros((loop.AHEAD, rows.COLUMNS))
        self._noise = np.zeros((loop.SPAN, sensors, LANES))
        self._work = np.zeros((5, loop.SPAN))

    def run(self, should_stop: Callable[[], bool] = lambda: False) -> list[Shared | None] | None:
        """Run all; return the runs that shared the loop, None for each that could not.

        Returns
        -------
        list, or None
            None if `should_stop` said so before the end.
        """
        left, after = self.begin(), (self._epochs - 1) % self._every
        while left > 0:
            if should_stop():
                return None
            part = min(left, _PART_S * self._rate_hz)
            part = left - after if part > left - after > 0 else part
            left -= part
            goes_on = self.go_on(part)
            is_over = not goes_on and left >= after  # after the last sample it may have ended
            if is_over or 2 * np.count_nonzero(self._lost) > self._count:
                return [None] * self._count
            if left == after:
                loop.write_navigation(self._first.ram, self._rams, self.memory, self._longitude)
        loop.note_lost(self._plants, self._rams, self._first.contract, self.memory, self._lost)
        return self._results()

    def begin(self) -> int:
        """Run until lanes can take over; return the epochs that are left, none if they cannot."""
        first, rate_hz = self._first, self._rate_hz
        nobody, nothing = self._plants[:0], self._rams[:0]
        while self._done + rate_hz < self._epochs:
            # A second ends with a multiple of its epochs.
            part = rate_hz if self._done else rate_hz + 1
            self._run_on(part, nobody, nothing)
            if self._is_ready(first.ram):
                break
        else:
            self._lost[:] = True
            return 0
        for k in range(self._count):
            run = FastRun(self._rams[k : k + 1], self._plants[k : k + 1], first.pieces, self._every)
            navigation = run.run(self._done).navigation
            self._lost[k] = not self._is_ready(run.ram) or len(navigation) != self._row
            if not self._lost[k]:
                samples = self._samples[1 + k, : self._row]
                samples[:, 0], samples[:, 1] = navigation["latitude"], navigation["longitude"]
                samples[:, 2:] = navigation["velocity_n"][:, :2]
        self._longitude[:] = self._rams["ins"]["longitude"]
        loop.begin(self._plants, self._rams, self.memory, self._phases, self._alike)
        return self._epochs - self._done

    def _is_ready(self, ram: Records[Ram]) -> bool:
        """Return whether a run navigates, and its sensors are compared as they will be."""
        state, compares = ram[0], self._first.compares
        if not loop.is_sound_array(ram, compares) or state.ins.first:
            return False
        if compares is None:
            return True
        return all(
            bool(parity.is_single and parity.parity.seconds >= LEARNED_S and not parity.corrected)
            for parity in (state.redundancy[kind] for kind in _KINDS)
        )

    def go_on(self, epochs: int) -> bool:
        """Run all on; return whether the leading run is still sound.

        Raises
        ------
        ValueError
            When there is no room for so many epochs.
        """
        if self._done + epochs > self._epochs:
            left = self._epochs - self._done
            raise ValueError(f"a group of {self._epochs} epochs has {left} left, not {epochs}")
        return self._run_on(epochs, self._plants, self._rams)

    def _run_on(self, epochs: int, plants: Records[Plant], rams: Records[Ram]) -> bool:
        first = self._first
        self._done += epochs
        written = loop.run_together(
            first.plant,
            first.pieces,
            first.ram,
            first.contract,
            first.compares,
            epochs,
            self._every,
            self._felt,
            plants,
            rams,
            self.memory,
            self._phases,
            self._alike,
            self._second,
            self._lost,
            self._longitude,
            self._shared,
            self._noise,
            self._work,
            self._work[4].view(np.int64),
            self._samples[:, self._row :],
            self._truth[self._row :],
        )
        self._row += written if written >= 0 else -1 - written
        return written >= 0

    def _results(self) -> list[Shared | None]:
        samples, truth = self._samples[:, : self._row], self._truth[: self._row]
        off = np.abs(samples[1] - samples[0]).max(axis=0, initial=0.0)
        is_close = bool(np.all(off < (_CLOSE_RAD, _CLOSE_RAD, _CLOSE_MPS, _CLOSE_MPS)))
        found: list[Shared | None] = [Shared(self._first.ram, samples[0], truth)]
        for k in range(1, self._count):
            is_lost = self._lost[k] or not is_close
            shared = Shared(self._rams[k : k + 1], samples[1 + k], truth)
            found.append(None if is_lost else shared)
        return found


def _joined(rams: Sequence[Records[Ram]]) -> Records[Ram]:
    """Return an array of RAM images; of each only what is not blank takes memory.

    numpy would have large arrays in pages of 2 MB.
    """
    private = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS
    memory = mmap.mmap(-1, len(rams) * Ram.dtype.itemsize, flags=private)
    with suppress(OSError):  # a kernel that has none
        memory.madvise(mmap.MADV_NOHUGEPAGE)
    joined = Ram.from_bytes(memory)
    for k, ram in enumerate(rams):
        image, own = (each.view(np.uint8).reshape(-1) for each in (ram, joined[k : k + 1]))
        whole = len(image) // _PAGE * _PAGE
        pages: NDArray[np.uint8] = image[:whole].reshape(-1, _PAGE)
        used = pages.any(axis=1)
        own[:whole].reshape(-1, _PAGE)[used] = pages[used]
        own[whole:] = image[whole:]
    return joined


def _felt_by(plants: Records[Plant]) -> Records[Sensors]:
    """Return sensors along the frame's axes with the bandwidth and latency of a plant's."""
    felt = Sensors.zeros(len(_KINDS))
    for k, kind in enumerate(_KINDS):
        for name in ("lags", "lag_share", "lag_mean", "latency_epochs", "latency_fraction"):
            felt[name][k] = plants[kind][name][0]
    return felt
