"""What the estimator knows, second by second of a run, written as it comes."""

from __future__ import annotations

from pathlib import Path

from rrins.compiled.record import Records
from rrins.firmware_py.core.records.estimator_records import ESTIMATOR_HISTORY_S, EstimatorSecond
from rrins.firmware_py.core.records.memory import Ram
from rrins.host_tools.runs.results.samples import LARGEST_LOG, RingReader, SampleFile, read_samples

_SAMPLES = "estimator.samples"


class EstimatorLog:
    """Writes down what the firmware keeps of its estimator, before it forgets it.

    Parameters
    ----------
    ram : Records[Ram]
    folder : Path or None
        Where the samples go; with None they are dropped.
    duration_s : float
        Of the run; a very long one is thinned.

    Attributes
    ----------
    every : int
        Epochs after which `run` must be called again; 0 where nothing is estimated.

    Raises
    ------
    SamplesError
        When the file cannot be made.
    """

    def __init__(self, ram: Records[Ram], folder: Path | None, duration_s: float) -> None:
        self._estimator = ram[0].estimator
        is_needed = folder is not None and bool(self._estimator.enabled)
        second_epochs = int(self._estimator.second_epochs)
        self.every = ESTIMATOR_HISTORY_S // 2 * second_epochs if is_needed else 0
        self._keep_every = max(1, -(-round(duration_s) // LARGEST_LOG))
        self._ring = RingReader(ESTIMATOR_HISTORY_S)
        self._file: SampleFile | None = None
        if folder is not None and is_needed:
            self._file = SampleFile(folder / _SAMPLES)

    def run(self, epoch: int = 0) -> None:
        """Write down the seconds since the last call.

        Raises
        ------
        SamplesError
            When they cannot be written.
        """
        if self._file is None:
            return
        numbers = self._ring.new(int(self._estimator.history_count))
        kept = numbers[numbers % self._keep_every == 0]
        self._file.append(self._estimator.history[kept % ESTIMATOR_HISTORY_S])

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()


def take_estimates(folder: Path) -> Records[EstimatorSecond]:
    """Return what a run left in a folder, oldest first, and remove its file."""
    seconds = read_samples(folder / _SAMPLES, EstimatorSecond)
    (folder / _SAMPLES).unlink(missing_ok=True)
    return seconds
