"""Opens the firmware's serial lines for a shell."""

from __future__ import annotations

import math
from collections.abc import Callable

from rrins.firmware_py.loop import Firmware
from rrins.firmware_py.serial.lines import Note, SerialLines
from rrins.firmware_py.serial.port import SerialPortError
from rrins.firmware_py.serial.settings import SerialSettings
from rrins.host_tools.errors import RehearsalError


class SerialError(RehearsalError):
    """A serial line cannot be opened, or its settings do not fit."""


def open_lines(settings: SerialSettings, firmware: Firmware, on_note: Note) -> SerialLines:
    """Open the serial lines of a firmware, if it has any.

    Raises
    ------
    SerialError
        If a port cannot be opened; the message, one line, names it and the reason.
    """
    try:
        return SerialLines(settings, firmware, on_note)
    except SerialPortError as error:
        raise SerialError(str(error)) from error


class Tasks:
    """Periodic tasks that a shell runs between its steps.

    Parameters
    ----------
    tasks : tuple of int and callable
        Epochs between two calls (0 for never), and the function to call with the epoch.

    Attributes
    ----------
    every : int
        Epochs between two calls of `run`.
    """

    def __init__(self, *tasks: tuple[int, Callable[[int], None]]) -> None:
        self._tasks = [(every, call) for every, call in tasks if every]
        self.every = math.gcd(*(every for every, _ in self._tasks))

    def run(self, epoch: int) -> None:
        """Run the tasks due in an epoch."""
        for every, call in self._tasks:
            if epoch % every == 0:
                call(epoch)
