"""On python-can's buses the hardware goes on when the firmware's power goes between two frames.

RRINS_CYCLES says how often; the embedded bus is in `tests/host_tools/testing/test_power.py`.
"""

from __future__ import annotations

import contextlib
import os
import random
import socket
import threading

import pytest

from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.loop import Firmware, open_memories
from rrins.firmware_py.loop import run_lockstep as run_firmware
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.message_port import MessagePort
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.loop import run_lockstep as run_hardware
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import load

CYCLES = int(os.environ.get("RRINS_CYCLES", "5"))


class _PowerLostError(Exception):
    """The firmware's power has gone, in the middle of whatever it does."""


class _CutPort(MessagePort):
    """The firmware's port, whose power goes after so many frames in navigation."""

    firmware: Firmware
    frames_left = 0

    def _count(self):
        if self.firmware.mode is Mode.NAVIGATION_ROTATING:
            self.frames_left -= 1
            if self.frames_left < 0:
                raise _PowerLostError

    def _send(self, message):
        self._count()
        super()._send(message)

    def _receive(self, timeout):
        self._count()
        return super()._receive(timeout)


@pytest.mark.soak
@pytest.mark.parametrize("interface", ["virtual", "socketcan"])
def test_on_any_bus_the_hardware_outlives_the_firmware(interface, tmp_path):
    """In lockstep, as threads: the firmware ends between two frames, anywhere in an epoch."""
    if interface == "socketcan" and "vcan0" not in [name for _, name in socket.if_nameindex()]:
        pytest.skip("the kernel has no vcan0")
    rng = random.Random(11)
    scenario = load("ideal", duration_s=36000, firmware={"alignment_s": 0.1})
    address = Address(interface, "vcan0" if interface == "socketcan" else "power")
    hardware = Hardware(hardware_settings(scenario))
    port = MessagePort(address, "hardware", keeps=True)
    failures: list[BaseException] = []

    def host():
        try:
            port.meet()
            run_hardware(hardware, port, scenario.epochs)
        except BaseException as error:  # noqa: BLE001 - the test says it
            failures.append(error)

    thread = threading.Thread(target=host, daemon=True)
    thread.start()
    epochs = 0
    for _ in range(CYCLES):
        with (
            contextlib.closing(
                Firmware(firmware_settings(scenario), stores=open_memories(tmp_path / "memory"))
            ) as firmware,
            contextlib.closing(_CutPort(address, "firmware")) as own,
        ):
            own.firmware, own.frames_left = firmware, rng.randrange(3000)
            own.meet()
            with pytest.raises(_PowerLostError):
                run_firmware(firmware, own)
            assert not any(
                firmware.ram[0]["faults"][name] for name in ("crc_errors", "bridged_epochs")
            )
        assert thread.is_alive(), failures
        assert hardware.epoch > epochs
        epochs = hardware.epoch
    port.close()
    thread.join(60)
