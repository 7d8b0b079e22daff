"""Logs of the seconds that the firmware keeps, of parity and estimator, written as a run goes."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from rrins.compiled.record import Record, Records
from rrins.firmware_py.core.records.estimator_records import EstimatorSecond
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.redundancy_records import ParitySecond
from rrins.host_tools.runs.results.samples import LARGEST_LOG, RingReader, SampleFile, read_samples
from rrins.host_tools.runs.results.sensor_errors import KINDS

_R = TypeVar("_R", bound=Record)

Parities = dict[str, Records[ParitySecond]]
"""Seconds of each kind, `gyros` and `accelerometers`, oldest first; empty where not compared."""


_PARITIES = {kind: f"{kind}_parity.samples" for kind in KINDS}
_ESTIMATES = "estimator.samples"


@dataclass(frozen=True)
class Seconds:
    """The seconds of a run, oldest first; empty where the firmware kept none."""

    parities: Parities = field(default_factory=dict)
    estimates: Records[EstimatorSecond] = field(default_factory=lambda: EstimatorSecond.zeros(0))


class SecondsLog:
    """Writes down what the firmware keeps, before it forgets it.

    Parameters
    ----------
    ram : Records[Ram]
    folder : Path or None
        Where the samples go; with None they are dropped.
    duration_s : float
        Of the run; a very long one is thinned, but for parities beyond their threshold.

    Attributes
    ----------
    every : int
        Epochs after which `run` must be called again; 0 where nothing is kept.

    Raises
    ------
    SamplesError
        When a file cannot be made.
    """

    def __init__(self, ram: Records[Ram], folder: Path | None, duration_s: float) -> None:
        state = ram[0]
        redundancy, estimator = state.redundancy, state.estimator
        kept: list[tuple[str, Any, Any]] = [(_ESTIMATES, estimator, estimator)]
        kept += [(file, redundancy, redundancy[kind]) for kind, file in _PARITIES.items()]
        self.every = 0
        self._keep_every = max(1, -(-round(duration_s) // LARGEST_LOG))
        self._rings: list[tuple[Any, RingReader, SampleFile]] = []
        for name, owner, ring in kept:
            if folder is not None and owner.enabled:
                capacity = len(ring.history)
                self._rings.append((ring, RingReader(capacity), SampleFile(folder / name)))
                self.every = capacity // 2 * int(owner.second_epochs)

    def run(self, epoch: int = 0) -> None:
        """Write down the seconds since the last call.

        Raises
        ------
        SamplesError
            When they cannot be written.
        """
        for ring, reader, file in self._rings:
            numbers = reader.new(int(ring.history_count))
            seconds = ring.history[numbers % len(ring.history)]
            is_kept = numbers % self._keep_every == 0
            if "ratio" in seconds.dtype.names:
                is_kept |= seconds["ratio"] > 1.0
            file.append(seconds[is_kept])

    def close(self) -> None:
        """Close the files."""
        for _, _, file in self._rings:
            file.close()


def take_seconds(folder: Path) -> Seconds:
    """Return what a run left in a folder, and remove its files."""
    parities = {kind: _take(folder / file, ParitySecond) for kind, file in _PARITIES.items()}
    found = {kind: seconds for kind, seconds in parities.items() if len(seconds)}
    return Seconds(found, _take(folder / _ESTIMATES, EstimatorSecond))


def _take(path: Path, kind: type[_R]) -> Records[_R]:
    seconds = read_samples(path, kind)
    path.unlink(missing_ok=True)
    return seconds
