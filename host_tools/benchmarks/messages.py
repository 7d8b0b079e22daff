"""Lockstep frame by frame: both sides exchange python-can messages on the embedded bus.

Run as a program, it is one of the two sides. The hardware runs a section of epochs for each line it
reads and prints the section's nanoseconds, so that sections can alternate with other measurements.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time

from rrins.firmware_py.loop import Firmware
from rrins.firmware_py.loop import run_lockstep as run_firmware_lockstep
from rrins.host_tools.bus.address import EMBEDDED, Address
from rrins.host_tools.bus.message_port import MessagePort
from rrins.host_tools.bus.port import open_bus, open_when_there
from rrins.host_tools.closing import Closing
from rrins.host_tools.errors import SideLostError
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.loop import run_lockstep as run_hardware_lockstep
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.runs.sides.job import prepare_firmware, prepare_hardware
from rrins.host_tools.scenario.scenario import Scenario, load

_GRACE_S = 5.0
_ATTACH_WAIT_S = 120.0  # the other side may need to compile


class MessageLockstep(Closing):
    """Two processes on one core, with the hardware hosting the bus; a context manager.

    Parameters
    ----------
    scenario : str
        Name of a built-in scenario.
    channel : str
        Of the embedded bus.
    section_epochs : int
    sections : int
        Maximum number of calls of `run_section`.
    """

    def __init__(self, scenario: str, channel: str, section_epochs: int, sections: int) -> None:
        self._section_epochs = section_epochs
        rate_hz = load(scenario).rate_hz
        duration_s = section_epochs * sections / rate_hz
        job = [scenario, str(duration_s), channel, str(section_epochs)]
        job.append(str(max(os.sched_getaffinity(0))))
        self._hardware = self._start("hardware", job)
        self._firmware = self._start("firmware", job)

    @staticmethod
    def _start(side: str, job: list[str]) -> subprocess.Popen[str]:
        is_hardware = side == "hardware"
        return subprocess.Popen(
            [sys.executable, "-m", "rrins.host_tools.benchmarks.messages", side, *job],
            stdin=subprocess.PIPE if is_hardware else subprocess.DEVNULL,
            stdout=subprocess.PIPE if is_hardware else subprocess.DEVNULL,
            text=True,
            start_new_session=True,
        )

    def run_section(self) -> float:
        """Run one section; return its epochs per second.

        Raises
        ------
        SideLostError
            If a side has exited early.
        """
        stdin, stdout = self._hardware.stdin, self._hardware.stdout
        assert stdin is not None
        assert stdout is not None
        try:
            stdin.write("\n")
            stdin.flush()
            took_ns = int(stdout.readline())
        except (BrokenPipeError, ValueError) as error:
            raise SideLostError("a side of the message lockstep exited early") from error
        return self._section_epochs / (took_ns * 1e-9)

    def close(self) -> None:
        """End both processes."""
        for process in (self._firmware, self._hardware):
            process.terminate()
        for process in (self._firmware, self._hardware):
            try:
                process.wait(_GRACE_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    pipe.close()


def _run_firmware(scenario: Scenario, address: Address) -> None:
    prepare_firmware(scenario)
    firmware = Firmware(firmware_settings(scenario))
    bus = open_when_there(address, _ATTACH_WAIT_S, host="never")
    port = MessagePort(address, "firmware", bus)
    port.meet()
    run_firmware_lockstep(firmware, port)


def _run_hardware(scenario: Scenario, address: Address, section_epochs: int) -> None:
    prepare_hardware(scenario)
    hardware = Hardware(hardware_settings(scenario))
    port = MessagePort(address, "hardware", open_bus(address, host="here"))
    port.meet()
    start_ns = 0

    def on_epoch(epoch: int) -> None:
        nonlocal start_ns
        if epoch:
            print(time.monotonic_ns() - start_ns, flush=True)
        sys.stdin.readline()
        start_ns = time.monotonic_ns()

    run_hardware_lockstep(hardware, port, scenario.epochs, every=section_epochs, on_epoch=on_epoch)


def main(arguments: list[str]) -> None:
    """Run one side: ``firmware|hardware SCENARIO SECONDS CHANNEL SECTION_EPOCHS CORE``."""
    side, name, duration_s, channel, section_epochs, core = arguments
    os.sched_setaffinity(0, {int(core)})
    scenario = load(name, duration_s=float(duration_s))
    address = Address(EMBEDDED, channel)
    if side == "firmware":
        _run_firmware(scenario, address)
    else:
        _run_hardware(scenario, address, int(section_epochs))


if __name__ == "__main__":
    main(sys.argv[1:])
