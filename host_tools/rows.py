"""Rows of a run, written as they come: what was recorded so far is there when a run breaks off."""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from host_tools.errors import RehearsalError

LARGEST_LOG = 100_000
"""Rows that a log is thinned to."""


def keep_every(epochs: int, rate_hz: int) -> int:
    """Return of how many epochs one is logged: 10 Hz, or fewer in a very long run."""
    return max(1, rate_hz // 10, -(-epochs // LARGEST_LOG))


class RowsError(RehearsalError):
    """Rows that cannot be written, such as on a full disk."""

    def __init__(self, path: Path | None, error: OSError) -> None:
        super().__init__(f"{path}: cannot be written: {error.strerror or error}")


class RowFile:
    """A file of records of one dtype, appended to.

    Parameters
    ----------
    path : Path or None
        With None the rows are dropped.

    Raises
    ------
    RowsError
        When the file cannot be made.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        try:
            self._file: BinaryIO | None = None if path is None else path.open("wb", buffering=0)
        except OSError as error:
            raise RowsError(path, error) from error

    def append(self, rows: NDArray[Any]) -> None:
        """Append rows; after a failure, which is told once, they are dropped.

        Raises
        ------
        RowsError
            When they cannot be written.
        """
        if self._file is None:
            return
        left = memoryview(rows.tobytes())
        try:
            while left:  # a disk that becomes full takes a part
                left = left[self._file.write(left) :]
        except OSError as error:
            self.close()
            raise RowsError(self._path, error) from error

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None


def read_rows(path: Path, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the whole records of a file; none when there is no file."""
    if not path.exists():
        return np.zeros(0, dtype=dtype)
    whole = path.stat().st_size // dtype.itemsize
    return np.fromfile(path, dtype=dtype, count=whole)


class RowBuffer:
    """Rows collected in fixed memory and handed to a file now and then.

    Parameters
    ----------
    dtype : numpy dtype
    file : RowFile
    """

    def __init__(self, dtype: np.dtype[Any], file: RowFile) -> None:
        self._rows = np.zeros(256, dtype=dtype)
        self._count = 0
        self._file = file

    def take(self, row: NDArray[Any]) -> None:
        """Take a copy of an array of one record."""
        self._rows[self._count] = row[0]
        self._count += 1
        if self._count == len(self._rows):
            self.flush()

    def flush(self) -> None:
        """Write what has been taken."""
        self._file.append(self._rows[: self._count])
        self._count = 0
