"""The parameters in effect: from the memory, or from the set-up where the memory has none."""

from __future__ import annotations

from collections.abc import Mapping

from rrins.firmware_py.core.records.troubles import SystemFault
from rrins.firmware_py.core.settings import Settings
from rrins.firmware_py.diagnostics import calibration_image as image
from rrins.firmware_py.diagnostics import parameter_settings as set_up
from rrins.firmware_py.diagnostics.calibration_image import ImageError, Parameters
from rrins.firmware_py.diagnostics.codecs import Values
from rrins.firmware_py.diagnostics.identifiers import MemoryState
from rrins.firmware_py.diagnostics.store import Condition, StoredCopy, TwoCopyStore
from rrins.firmware_py.diagnostics.writer import DirectWriter, WriteJob, Writer

_FAULTS = {
    Condition.ONE_DAMAGED: 1 << SystemFault.PARAMETER_COPY_DAMAGED,
    Condition.LOST: 1 << SystemFault.PARAMETERS_LOST,
}
_STATES = {
    Condition.BLANK: MemoryState.SET_UP,
    Condition.WHOLE: MemoryState.MEMORY,
    Condition.ONE_DAMAGED: MemoryState.OTHER_COPY,
    Condition.LOST: MemoryState.LOST,
}


class ParameterMemory:
    """The parameter memory of a computer.

    Parameters
    ----------
    set_up : Settings
        The computer's set-up.
    store : TwoCopyStore, optional
        Without one, parameters last until the process ends.

    Attributes
    ----------
    stored : dict
        Values by data identifier, as in the memory; they take effect at the next reset.
    state : MemoryState
        Condition in which the memory was found.
    sequence : int
        How often it had been written by then.
    faults : int
        Bits of `SystemFault`.

    Raises
    ------
    StoreError
        When the store cannot be read, or is not a store of this kind.
    """

    def __init__(self, set_up: Settings, store: TwoCopyStore | None = None) -> None:
        self._set_up = set_up
        self._store = store
        self.writer: Writer = DirectWriter()
        self.stored: Parameters = {}
        self._before: Parameters = {}
        self.state = MemoryState.SET_UP
        self.sequence = 0
        self.faults = 0
        self.load()

    def load(self) -> None:
        """Read the memory, as at power-on."""
        if self._store is None:
            return
        self._adopt(self._store.read())

    def _adopt(self, found: StoredCopy) -> None:
        self.state, self.faults = _STATES[found.condition], _FAULTS.get(found.condition, 0)
        self.sequence = found.sequence
        self.stored = {}
        if found.image is None:
            return
        try:
            self.stored, is_whole = image.tolerated(image.entries(found.image))
        except ImageError:
            is_whole = False
        unusable = set_up.unusable(self._set_up, self.stored)
        for number in unusable:
            del self.stored[number]
        if unusable or not is_whole:
            self.faults |= 1 << SystemFault.PARAMETER_OUT_OF_LIMITS

    def settings(self) -> Settings:
        """Return the settings after a reset: the set-up, overridden by the memory."""
        return set_up.changed(self._set_up, self.stored)

    def effective(self) -> Parameters:
        """Return the values that all parameters of the computer have after a reset."""
        return set_up.parameters_of(self._set_up) | self.stored

    def value(self, number: int) -> Values:
        """Return the value that a parameter has after a reset."""
        values = self.stored.get(number)
        return set_up.parameters_of(self._set_up)[number] if values is None else values

    def has(self, number: int) -> bool:
        """Return whether the computer has a parameter, such as a fitted sensor's calibration."""
        return number in set_up.parameters_of(self._set_up)

    def can_use(self, parameters: Mapping[int, Values]) -> bool:
        """Return whether the computer can fuse its sensors with the weights among parameters."""
        return not set_up.unusable(self._set_up, parameters)

    def replace(self, parameters: Mapping[int, Values]) -> WriteJob:
        """Start storing parameters that replace all in the memory; `finish` completes it."""
        self._before, self.stored = self.stored, dict(parameters)
        if self._store is None:
            job = WriteJob()
            job.done = True
            return job
        return self.writer.submit(self._store, image.encode(self.stored))

    def finish(self, job: WriteJob) -> bool:
        """Return whether a finished job succeeded; if it failed, nothing has changed."""
        if job.failed:
            self.stored = self._before
        return not job.failed

    def change(self, parameters: Mapping[int, Values]) -> WriteJob:
        """Start storing parameters in addition to the others; `finish` completes it.

        What they make unknown of the calibration's origin changes with them.
        """
        return self.replace(self.stored | set_up.with_origin(self.effective(), parameters))

    def close(self) -> None:
        """Wait until everything is stored, then release the store."""
        self.writer.close()
        if self._store is not None:
            self._store.close()
