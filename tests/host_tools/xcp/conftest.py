"""A rehearsal in lockstep on the embedded bus, its sides in threads, and a master beside it."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rrins.dbc.codec import decode
from rrins.dbc.frame import FrameArray, frame_array
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.loop import Firmware
from rrins.firmware_py.loop import run_lockstep as run_firmware
from rrins.host_tools.bus.address import Address, Side
from rrins.host_tools.bus.message_port import MessagePort
from rrins.host_tools.bus.port import BatchPort
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.loop import run_lockstep as run_hardware
from rrins.host_tools.runs.exchange import answer_epoch
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    hardware_settings,
    scenario_wire,
)
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.testing.processes import fresh_channel
from tests.firmware_py.xcp.conftest import xcp_frame

PATIENCE_S = 60.0


class Sides:
    """Both sides in one process, and a tool that sends packets with each epoch's frames."""

    def __init__(self, scenario: Scenario) -> None:
        self.firmware = Firmware(firmware_settings(scenario))
        self.hardware = Hardware(hardware_settings(scenario))
        self.inbox: FrameArray = frame_array(256)
        self.count = 0
        self._frames = self.inbox[:0]
        self.epochs = scenario.epochs

    def step(self, packets: list[bytes]) -> None:
        hardware, firmware, inbox = self.hardware, self.firmware, self.inbox
        frames, sent = hardware.open_epoch(hardware.epoch, firmware.outbox, self.count)
        for k, packet in enumerate(packets):
            inbox[k] = xcp_frame(packet)
        self._frames = frames[:sent]
        end = len(packets) + sent
        inbox[len(packets) : end] = frames[:sent]
        self.count = answer_epoch(firmware, inbox, end, hardware.epoch - 1)

    def sent_by_gyro(self, gyro: int) -> float:
        """Return the increment in a gyro's last frame, rad."""
        group = self.firmware.contract[0].sensor[gyro]
        (own,) = self._frames[self._frames["can_id"] == group.message.can_id]
        return float(decode(own["data"], group.gyro_dtheta))


@dataclass
class Rehearsed:
    """What a rehearsal left."""

    firmware: Firmware
    #: the bytes of the watched signals after each epoch
    watched: dict[int, bytes] = field(default_factory=dict)
    failures: list[BaseException] = field(default_factory=list)


class _OverError(Exception):
    """The guest has left a bus that would not wait for it."""


def rehearse(
    scenario: Scenario,
    guest: Callable[[Address], Any],
    watch: Sequence[tuple[int, int]] = (),
    address: Address | None = None,
) -> Rehearsed:
    """Rehearse to the end; `guest` runs in a thread from the first second on.

    Parameters
    ----------
    watch : sequence of (address, size)
        Ranges of the RAM image to keep of each epoch.
    address : Address, optional
        Another bus than an embedded one: in real time, as it does not wait, and until the guest
        leaves.
    """
    make: Callable[[Address, Side], Any] = MessagePort if address else BatchPort
    address, is_embedded = address or Address("rrins", fresh_channel()), address is None
    rehearsed = Rehearsed(Firmware(firmware_settings(scenario)))
    firmware = rehearsed.firmware
    hardware = Hardware(hardware_settings(scenario), scenario_wire(scenario, is_live=True))
    port = make(address, "hardware")
    image = firmware.ram.view(np.uint8)
    places = np.array([k for begin, size in watch for k in range(begin, begin + size)], dtype=int)
    is_done = threading.Event()
    threads: list[threading.Thread] = []

    def begin(run: Callable[[], Any]) -> None:
        def guarded() -> None:
            try:
                run()
            except BaseException as error:  # noqa: BLE001 - told by the test
                rehearsed.failures.append(error)
                is_done.set()

        threads.append(threading.Thread(target=guarded))
        threads[-1].start()

    def keep(epoch: int) -> None:
        rehearsed.watched[epoch] = image[places].tobytes()

    def navigate() -> None:
        own = make(address, "firmware")
        try:
            if not is_embedded:
                own.meet()
            run_firmware(firmware, own, 0.0, 1, keep)
        finally:
            own.close()

    def visit() -> None:
        guest(address)
        is_done.set()

    def on_epoch(epoch: int) -> None:
        if epoch == scenario.rate_hz:
            begin(visit)
            if is_embedded:
                port.meet(("xcp",))

    def keep_pace(epoch: int) -> None:
        if is_done.wait(max(0.0, begun_s + epoch / scenario.rate_hz - time.monotonic())):
            firmware.ram["modes"]["mode"] = Mode.SHUTDOWN  # by hand, in a last epoch
            frames, sent = hardware.open_epoch(epoch, hardware.inbox, 0)
            port.send(frames, sent, epoch, epoch * hardware.period_ns)
            raise _OverError

    begin(navigate)
    try:
        port.meet()
        begun_s = time.monotonic()
        with contextlib.suppress(_OverError):
            run_hardware(
                hardware, port, scenario.epochs + 1, None, scenario.rate_hz, on_epoch,
                None if is_embedded else keep_pace,
            )  # fmt: skip
        assert is_done.wait(PATIENCE_S), "the rehearsal was over before the guest"
        port.dismiss()
    finally:
        port.close()
        for thread in threads:
            thread.join(PATIENCE_S)
    if rehearsed.failures:
        raise rehearsed.failures[0]
    return rehearsed
