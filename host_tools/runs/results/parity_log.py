"""Parity and residuals of redundant sensors over a run, written as they come."""

from __future__ import annotations

from pathlib import Path

from rrins.compiled.record import Records
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.redundancy_records import HISTORY_S, Parity, ParitySecond
from rrins.host_tools.runs.results.redundancy_summary import KINDS
from rrins.host_tools.runs.results.samples import LARGEST_LOG, RingReader, SampleFile, read_samples

Parities = dict[str, Records[ParitySecond]]
"""Seconds of each kind, `gyros` and `accelerometers`, oldest first; empty where not compared."""


def _path(folder: Path, kind: str) -> Path:
    return folder / f"{kind}_parity.samples"


class ParityLog:
    """Writes down what the firmware keeps of parity and residuals, before it forgets them.

    Parameters
    ----------
    ram : Records[Ram]
    folder : Path or None
        Where the samples go; with None they are dropped.
    duration_s : float
        Of the run; a very long one is thinned, but for what is beyond the threshold.

    Attributes
    ----------
    every : int
        Epochs after which `run` must be called again; 0 where nothing is compared.

    Raises
    ------
    SamplesError
        When a file cannot be made.
    """

    def __init__(self, ram: Records[Ram], folder: Path | None, duration_s: float) -> None:
        redundancy = ram[0].redundancy
        is_needed = folder is not None and bool(redundancy.enabled)
        self.every = HISTORY_S // 2 * int(redundancy.second_epochs) if is_needed else 0
        self._keep_every = max(1, -(-round(duration_s) // LARGEST_LOG))
        self._kinds: list[tuple[Parity, RingReader, SampleFile]] = []
        if folder is not None and is_needed:
            for kind in KINDS:
                file = SampleFile(_path(folder, kind))
                self._kinds.append((redundancy[kind], RingReader(HISTORY_S), file))

    def run(self, epoch: int = 0) -> None:
        """Write down the seconds since the last call.

        Raises
        ------
        SamplesError
            When they cannot be written.
        """
        for parity, ring, file in self._kinds:
            numbers = ring.new(int(parity.history_count))
            seconds = parity.history[numbers % HISTORY_S]
            kept = (numbers % self._keep_every == 0) | (seconds["ratio"] > 1.0)
            file.append(seconds[kept])

    def close(self) -> None:
        """Close the files."""
        for _, _, file in self._kinds:
            file.close()


def take_parities(folder: Path) -> Parities:
    """Return what a run left in a folder, and remove its files."""
    found: Parities = {}
    for kind in KINDS:
        seconds = read_samples(_path(folder, kind), ParitySecond)
        if len(seconds):
            found[kind] = seconds
        _path(folder, kind).unlink(missing_ok=True)
    return found
