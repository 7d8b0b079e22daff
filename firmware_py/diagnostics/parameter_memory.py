"""The parameters in force: those of the memory, and of the set-up where the memory has none."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.diagnostics import image, set_up
from firmware_py.diagnostics.codecs import Values
from firmware_py.diagnostics.identifiers import MemoryState
from firmware_py.diagnostics.image import ImageError, Parameters
from firmware_py.diagnostics.store import Condition, Found, TwoCopyStore
from firmware_py.diagnostics.troubles import SystemFault
from firmware_py.diagnostics.writer import DirectWriter, Job, Writer
from firmware_py.settings import Settings

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
        What the computer is set up with.
    store : TwoCopyStore, optional
        Without one, parameters last until the process ends.

    Attributes
    ----------
    stored : dict
        Values by data identifier, as the memory has them; in force from the next reset on.
    state : MemoryState
        How the memory was found.
    sequence : int
        How often it had been written then.
    faults : int
        Bits of `SystemFault`.
    writer : Writer

    Raises
    ------
    StoreError
        When the store cannot be read, or is something else.
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
        self._take(self._store.read())

    def _take(self, found: Found) -> None:
        self.state, self.faults = _STATES[found.condition], _FAULTS.get(found.condition, 0)
        self.sequence = found.sequence
        self.stored = {}
        if found.image is None:
            return
        try:
            self.stored, is_whole = image.tolerated(image.entries(found.image))
        except ImageError:
            is_whole = False
        if not is_whole:
            self.faults |= 1 << SystemFault.PARAMETER_OUT_OF_LIMITS

    def settings(self) -> Settings:
        """Return the settings in force after a reset: the set-up, changed by the memory."""
        return set_up.changed(self._set_up, self.stored)

    def effective(self) -> Parameters:
        """Return the values of all parameters that the computer has, as after a reset."""
        return set_up.parameters_of(self._set_up) | self.stored

    def value(self, number: int) -> Values:
        """Return a parameter as it is after a reset."""
        values = self.stored.get(number)
        return set_up.parameters_of(self._set_up)[number] if values is None else values

    def has(self, number: int) -> bool:
        """Return whether the computer has a parameter: not the calibration of a ninth of four."""
        return number in set_up.parameters_of(self._set_up)

    def replace(self, parameters: Mapping[int, Values]) -> Job:
        """Begin to store parameters in place of all that the memory has; `finish` ends it."""
        self._before, self.stored = self.stored, dict(parameters)
        if self._store is None:
            job = Job()
            job.done = True
            return job
        return self.writer.submit(self._store, image.encode(self.stored))

    def finish(self, job: Job) -> bool:
        """Return whether a job that is done went well; otherwise all is as it was before."""
        if job.failed:
            self.stored = self._before
        return not job.failed

    def change(self, parameters: Mapping[int, Values]) -> Job:
        """Begin to store parameters beside the others; `finish` ends it."""
        return self.replace(self.stored | dict(parameters))

    def close(self) -> None:
        """Return when all is stored, and let go of the store."""
        self.writer.close()
        if self._store is not None:
            self._store.close()
