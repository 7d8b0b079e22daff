"""A hardware process alone, with the test in the place of the firmware."""

from __future__ import annotations

from pathlib import Path
from subprocess import Popen
from types import TracebackType
from typing import Self

import can

from host_tools.bus.interface import RrinsBus
from host_tools.testing.errors import BenchError
from host_tools.testing.processes import SideProcess, fresh_channel

_START_S = 120.0  # the first start compiles


class HardwareAlone:
    """The hardware process in real time, started and waiting on a bus of its own.

    The test's end of the bus carries the firmware's name, so the hardware begins at once. It is an
    observer: what it does not receive within some 100 s cuts it off.

    Parameters
    ----------
    scenario_file : Path

    Raises
    ------
    BenchError
        When the process does not start.
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
            When the process had failed before.
        """
        words = self._side.stop()
        self.bus.shutdown()
        if words:
            raise BenchError(words)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()
