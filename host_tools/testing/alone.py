"""A hardware process alone, with the test acting as the firmware."""

from __future__ import annotations

from pathlib import Path
from subprocess import Popen

import can

from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.closing import Closing
from rrins.host_tools.testing.errors import BenchError
from rrins.host_tools.testing.processes import SideProcess, fresh_channel

_START_S = 120.0  # the first start compiles


class HardwareAlone(Closing):
    """The hardware process in real time, started and waiting on its own bus.

    The test's end of the bus carries the firmware's name, so the hardware begins at once. It is an
    observer: if it does not receive for about 100 s, it is disconnected.

    Parameters
    ----------
    scenario_file : Path

    Raises
    ------
    BenchError
        If the process does not start.
    """

    def __init__(self, scenario_file: Path) -> None:
        self.channel = fresh_channel()
        self._side = SideProcess("hardware", scenario_file, self.channel, "1")
        try:
            self._side.wait_until_ready(_START_S)
            self.bus: can.BusABC = RrinsBus(
                self.channel, host="never", role="observer", name="firmware", exclusive=True
            )
        except BaseException:
            self._side.stop()
            raise

    @property
    def process(self) -> Popen[bytes]:
        """The hardware's process."""
        return self._side.process

    def close(self) -> None:
        """End the process and leave the bus. Idempotent.

        Raises
        ------
        BenchError
            If the process had failed before.
        """
        words = self._side.stop()
        self.bus.shutdown()
        if words:
            raise BenchError(words)
