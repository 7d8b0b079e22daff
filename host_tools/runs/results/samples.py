"""Samples of a run, written as they come: what there is so far is kept when a run breaks off."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO, Generic, TypeVar, cast

import numpy as np

from rrins.compiled.record import Integers, Record, Records
from rrins.host_tools.errors import RehearsalError

_R = TypeVar("_R", bound=Record)

NAVIGATION_SAMPLES = "navigation.samples"
TRUTH_SAMPLES = "truth.samples"
"""Files that the sides write as they run, removed at its end."""

LARGEST_LOG = 100_000
"""Samples that a run is thinned to."""


def keep_every(epochs: int, rate_hz: int) -> int:
    """Return every how many epochs a sample is kept: for 10 Hz, or fewer in a very long run."""
    return max(1, rate_hz // 10, -(-epochs // LARGEST_LOG))


class SamplesError(RehearsalError):
    """Samples that cannot be written, such as on a full disk."""

    def __init__(self, path: Path | None, error: OSError) -> None:
        super().__init__(f"{path}: cannot be written: {error.strerror or error}")


class SampleFile:
    """A file of records of one kind, appended to.

    Parameters
    ----------
    path : Path or None
        With None the samples are dropped.

    Raises
    ------
    SamplesError
        When the file cannot be made.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        try:
            self._file: BinaryIO | None = None if path is None else path.open("wb", buffering=0)
        except OSError as error:
            raise SamplesError(path, error) from error

    def append(self, samples: Records[_R]) -> None:
        """Append samples; after a failure, which is raised once, they are dropped.

        Raises
        ------
        SamplesError
            When they cannot be written.
        """
        if self._file is None:
            return
        left = memoryview(samples.tobytes())
        try:
            while left:  # a disk that becomes full takes a part
                left = left[self._file.write(left) :]
        except OSError as error:
            self.close()
            raise SamplesError(self._path, error) from error

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None


def read_samples(path: Path, kind: type[_R]) -> Records[_R]:
    """Return the whole records of a file; none when there is no file."""
    if not path.exists():
        return kind.zeros(0)
    whole = path.stat().st_size // kind.dtype.itemsize
    return cast(Records[_R], np.fromfile(path, dtype=kind.dtype, count=whole))


class RingReader:
    """Tells what is new in a ring that the firmware keeps, and goes on after a reset of it.

    Parameters
    ----------
    capacity : int
        Records of the ring.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._seen = 0

    def new(self, count: int) -> Integers:
        """Return the numbers of the records since the last call that are still there.

        Parameters
        ----------
        count : int
            Records that the ring was given so far.
        """
        if count < self._seen:  # the computer was reset
            self._seen = 0
        numbers = np.arange(max(self._seen, count - self._capacity), count)
        self._seen = count
        return numbers


def sample_files(folder: Path | None) -> tuple[SampleFile, SampleFile]:
    """Return the files of navigation and truth in a folder; without one, samples are dropped.

    Raises
    ------
    SamplesError
        When one cannot be made.
    """
    names = (NAVIGATION_SAMPLES, TRUTH_SAMPLES)
    navigation, truth = (SampleFile(None if folder is None else folder / name) for name in names)
    return navigation, truth


class SampleBuffer(Generic[_R]):
    """Samples collected in fixed memory and handed to a file now and then.

    Parameters
    ----------
    kind : type of Record
    """

    def __init__(self, kind: type[_R], file: SampleFile) -> None:
        self._samples = kind.zeros(256)
        self._count = 0
        self._file = file

    @property
    def room(self) -> Records[_R]:
        """Where the next samples are to be written; there is room for one at least."""
        return self._samples[self._count :]

    def append(self, sample: Records[_R]) -> None:
        """Keep a copy of an array of one record."""
        self._samples[self._count] = sample[0]
        self.add(1)

    def add(self, count: int) -> None:
        """Keep the first samples that were written to `room`."""
        self._count += count
        if self._count == len(self._samples):
            self.flush()

    def flush(self) -> None:
        """Write what has been kept."""
        self._file.append(self._samples[: self._count])
        self._count = 0
