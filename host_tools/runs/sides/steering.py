"""Steers how fast a rehearsal in lockstep goes, while it runs: speed, pause.

A file of eight bytes, mapped by both: one writes a speed, the other reads it before each epoch,
which costs a fraction of a microsecond and can neither block nor fail.
"""

from __future__ import annotations

import math
import mmap
import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from rrins.host_tools.closing import Closing
from rrins.host_tools.errors import RehearsalError

PAUSED: Final = 0.0
"""The speed of a rehearsal that stands still."""

UNLIMITED: Final = math.inf
"""The speed of a rehearsal that goes as fast as it can."""

_SPEED = struct.Struct("=d")
_LOOK_S = 0.02  # at the file, while time stands still or passes slowly


class _Mapped(Closing):
    """The file, mapped."""

    def __init__(self, path: Path) -> None:
        try:
            with path.open("r+b") as file:
                self._memory = mmap.mmap(file.fileno(), _SPEED.size)
        except (OSError, ValueError) as error:
            raise RehearsalError(f"--steer {path}: cannot be mapped: {error}") from error

    @property
    def speed(self) -> float:
        """Seconds of simulated time per second: `PAUSED`, a factor, or `UNLIMITED`."""
        speed = float(_SPEED.unpack_from(self._memory)[0])
        return speed if speed > 0 else PAUSED  # NaN pauses, too

    def close(self) -> None:
        """Unmap the file."""
        self._memory.close()


class Helm(_Mapped):
    """The end that steers; it makes the file.

    Parameters
    ----------
    speed : float
        At the beginning.

    Raises
    ------
    RehearsalError
        When the file cannot be made.
    """

    def __init__(self, path: Path, speed: float = PAUSED) -> None:
        try:
            path.write_bytes(_SPEED.pack(speed))
        except OSError as error:
            raise RehearsalError(f"{path}: cannot be written: {error.strerror}") from error
        super().__init__(path)

    def steer(self, speed: float) -> None:
        """Set the speed."""
        _SPEED.pack_into(self._memory, 0, speed)


class SteeredPace(_Mapped):
    """The end that is steered.

    Parameters
    ----------
    period_ns : int
        Of the epochs.
    clock : callable
        The wall clock, ns.
    rest : callable
        Waits for some seconds.

    Raises
    ------
    RehearsalError
        When there is no such file.
    """

    def __init__(
        self,
        path: Path,
        period_ns: int,
        clock: Callable[[], int] = time.monotonic_ns,
        rest: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__(path)
        self._period_ns = period_ns
        self._clock = clock
        self._rest = rest
        self._speed = UNLIMITED
        self._since = (0, 0)  # epoch and time from which the present speed counts

    def wait_for(self, epoch: int) -> None:
        """Return when an epoch is due at the speed that is set; a new one counts from here on."""
        while True:
            speed = self.speed
            if speed != self._speed:
                self._speed, self._since = speed, (epoch, self._clock())
            if speed == UNLIMITED:
                return
            left_s = _LOOK_S if speed == PAUSED else self._left_s(epoch)
            if left_s <= 0:
                return
            self._rest(min(left_s, _LOOK_S))

    def _left_s(self, epoch: int) -> float:
        first, begun_ns = self._since
        due_ns = begun_ns + (epoch - first) * self._period_ns / self._speed
        return (due_ns - self._clock()) * 1e-9
