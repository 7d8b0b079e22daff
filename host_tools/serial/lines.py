"""Opens the firmware's serial lines for a shell."""

from __future__ import annotations

import math
from collections.abc import Callable

from firmware_py.loop import Firmware
from firmware_py.serial_lines import Note, SerialLines, SerialSettings
from firmware_py.serial_port import SerialPortError
from host_tools.errors import RehearsalError


class SerialError(RehearsalError):
    """A serial line that cannot be opened, or is asked for what does not fit."""


def open_lines(settings: SerialSettings, firmware: Firmware, on_note: Note) -> SerialLines:
    """Open the serial lines of a firmware; none is right as well.

    Raises
    ------
    SerialError
        One line: which port, and what is wrong with it.
    """
    try:
        return SerialLines(settings, firmware, on_note)
    except SerialPortError as error:
        raise SerialError(str(error)) from error


class Tasks:
    """What a shell does beside its steps, each task every so many epochs.

    Parameters
    ----------
    tasks : tuple of int and callable
        Epochs between two calls, 0 for never, and what is called with the epoch.

    Attributes
    ----------
    every : int
        Epochs after which `run` is to be called.
    """

    def __init__(self, *tasks: tuple[int, Callable[[int], None]]) -> None:
        self._tasks = [(every, call) for every, call in tasks if every]
        self.every = math.gcd(*(every for every, _ in self._tasks))

    def run(self, epoch: int) -> None:
        """Do what is due in an epoch."""
        for every, call in self._tasks:
            if epoch % every == 0:
                call(epoch)
