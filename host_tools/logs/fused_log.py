"""The fused increments of a log: its frames go through the firmware again, beside its truth."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import cast

import numpy as np

from rrins.compiled.record import Record, Records
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.records.memory import NavigationOutput
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.logs.epochs import EpochFinder
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.logs.renavigation import Renavigation, check_rate
from rrins.host_tools.logs.truth import RecomputedTruth
from rrins.host_tools.runs.results.samples import SampleBuffer, SampleFile
from rrins.host_tools.runs.set_up.settings import firmware_settings
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.vehicle.fused import PIECE_S, FusedIncrements, FusedTrack, note_increments

_NAVIGATING = (int(Mode.NAVIGATION_STRAPDOWN), int(Mode.NAVIGATION_ROTATING))
_NAMES = ("increments", "navigation", "truth")


class FusedLog:
    """Navigates a log again and keeps each epoch's fused increments.

    Parameters
    ----------
    log : Log
    scenario : Scenario
        Configures the firmware; its hardware repeats the truth if the log's note has no scenario.
    on_progress : callable
        Called with the bytes of the log read so far.

    Attributes
    ----------
    why_no_truth : str or None
        Why there is no truth, once read.
    """

    def __init__(
        self, log: Log, scenario: Scenario, on_progress: Callable[[int], None] = lambda at: None
    ) -> None:
        self.why_no_truth: str | None = None
        self._log, self._scenario, self._on_progress = log, scenario, on_progress

    def tracks(self) -> Iterator[FusedTrack]:
        """Yield the epochs navigated, some seconds at a time.

        Raises
        ------
        RecordError
            When the log cannot be read, or does not match the scenario.
        """
        with tempfile.TemporaryDirectory(prefix="rrins-") as name:
            paths = tuple(Path(name) / one for one in _NAMES)
            self._navigate(paths)
            yield from self._joined(paths)

    def _navigate(self, paths: tuple[Path, ...]) -> None:
        """Run firmware and truth over the log; leave their samples in files."""
        log, scenario = self._log, self._scenario
        files = [SampleFile(path) for path in paths]
        rows = SampleBuffer(FusedIncrements, files[0])
        navigation = SampleBuffer(NavigationOutput, files[1])
        firmware = Firmware(firmware_settings(scenario))
        ram, row = firmware.ram, FusedIncrements.zeros()
        mode = ram["modes"]["mode"]

        def note() -> None:
            if int(mode[0]) in _NAVIGATING:
                note_increments(row[0], ram[0])
                rows.append(row)
                navigation.append(cast(Records[NavigationOutput], ram["navigation"]))

        is_lockstep = log.note is not None and log.note.is_lockstep
        error_ppm = scenario.firmware.clock_error_ppm
        again = Renavigation(firmware, error_ppm, is_lockstep, on_step=note)
        recorded = None if log.note is None else log.note.loaded_scenario(log.path)
        truth = RecomputedTruth(recorded or scenario, files[2], log_every=1)
        try:
            for steps in EpochFinder().steps(check_rate(log.pieces(), scenario)):
                again.answer(steps)
                truth.follow(steps)
                self._on_progress(log.position)
                if again.has_ended:
                    break
            rows.flush()
            navigation.flush()
            truth.close()
        finally:
            for file in files:
                file.close()
        self.why_no_truth = truth.why_not

    def _joined(self, paths: tuple[Path, ...]) -> Iterator[FusedTrack]:
        kinds: tuple[type[Record], ...] = (FusedIncrements, NavigationOutput, Truth)
        increments, navigation, truth = (
            _mapped(path, kind) for path, kind in zip(paths, kinds, strict=True)
        )
        known = self.why_no_truth is None
        if known and len(increments) and not np.isin(increments["epoch"], truth["epoch"]).all():
            self.why_no_truth, known = "epochs of it are missing", False
        size = PIECE_S * self._scenario.rate_hz
        for begin in range(0, len(increments), size):
            part = slice(begin, begin + size)
            rows = np.array(increments[part])
            places = np.searchsorted(truth["epoch"], rows["epoch"]) if known else None
            yield FusedTrack(
                cast(Records[FusedIncrements], rows),
                cast(Records[NavigationOutput], np.array(navigation[part])),
                None if places is None else cast(Records[Truth], np.array(truth[places])),
            )


def _mapped(path: Path, kind: type[Record]) -> Records[Record]:
    """Return the records of a file, read from the disk as they are used."""
    count = path.stat().st_size // kind.dtype.itemsize
    if count == 0:
        return kind.zeros(0)
    return cast(Records[Record], np.memmap(path, kind.dtype, mode="r", shape=(count,)))
