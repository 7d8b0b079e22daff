"""An emulated unit in this process, at full speed: both sides' frames, and a diagnostic client."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rrins.dbc.frame import frame_array
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.store import Stores
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.diag.connection import LibraryConnection
from rrins.host_tools.diag.target import Target
from rrins.host_tools.diag.transport import DiagnosticFrame, request_message
from rrins.host_tools.hardware.loop import INBOX_CAPACITY, Hardware
from rrins.host_tools.runs.exchange import answer_epoch
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario

_READY_S = 2.0


class EmulatedUnit:
    """A unit of a scenario that stands and waits in STANDBY; time passes while a client receives.

    Parameters
    ----------
    scenario : Scenario
        Its operator asks for nothing; hardware faults are taken over.
    on_time : callable, optional
        Called with the simulated time, s, now and then.
    stores : Stores, optional
        Memories of the computer that last; without them all is lost when it is switched off.
    """

    def __init__(
        self,
        scenario: Scenario,
        on_time: Callable[[float], None] | None = None,
        stores: Stores | None = None,
    ) -> None:
        self.scenario = scenario
        self.firmware = Firmware(firmware_settings(scenario), stores=stores)
        self.hardware = Hardware(replace(hardware_settings(scenario), requests=()))
        self._on_time = on_time
        self._inbox = frame_array(INBOX_CAPACITY)
        self._own = frame_array(64)
        self._own_count = self._count = self._epoch = 0
        self._ids = (table.request_id(), table.response_id())
        for _ in range(round(_READY_S * scenario.rate_hz)):
            self.step()

    @property
    def now_ns(self) -> int:
        """Simulated time since power-on."""
        return self._epoch * self.scenario.period_ns

    def send(self, data: bytes) -> None:
        """Send a frame of a request, just before the next epoch."""
        message = request_message(data)
        frame = self._own[self._own_count]
        frame["can_id"], frame["length"] = message.arbitration_id, len(message.data)
        frame["data"] = int.from_bytes(bytes(message.data).ljust(8, b"\0"), "little")
        self._own_count += 1

    def step(self) -> list[DiagnosticFrame]:
        """Run an epoch; return the responses in it."""
        frames, sent = self.hardware.open_epoch(self._epoch, self.firmware.outbox, self._count)
        own, self._own_count = self._own_count, 0
        if own:
            self._inbox[:own] = self._own[:own]
            self._inbox[own : own + sent] = frames[:sent]
            frames = self._inbox
        self._count = answer_epoch(self.firmware, frames, own + sent, self._epoch)
        self._epoch += 1
        if self._on_time is not None and self._epoch % (20 * self.scenario.rate_hz) == 0:
            self._on_time(self.now_ns * 1e-9)
        if self._count <= _QUIET_FRAMES:
            return []
        return self._responses()

    def _responses(self) -> list[DiagnosticFrame]:
        out = self.firmware.outbox[: self._count]
        found = np.flatnonzero(out["can_id"] == self._ids[1]).tolist()
        return [
            DiagnosticFrame(
                int(out[k]["data"]).to_bytes(8, "little")[: int(out[k]["length"])], True
            )
            for k in found
        ]

    def target(self) -> Target:
        """Return the unit as a diagnostic tool knows it."""
        return _EmulatedTarget(unit=self)


_QUIET_FRAMES = 2
"""An epoch's commands to both axes, and no response."""


class _Transport:
    """A client on the unit's bus; each receive is an epoch."""

    keeps_pace = True

    def __init__(self, unit: EmulatedUnit) -> None:
        self._unit = unit

    @property
    def now_ns(self) -> int:
        return self._unit.now_ns

    def send(self, data: bytes) -> None:
        self._unit.send(data)

    def receive(self, wait_s: float) -> list[DiagnosticFrame]:
        end_ns = self.now_ns + min(wait_s, 1.0) * 1e9
        found = self._unit.step()
        while not found and self.now_ns < end_ns:
            found = self._unit.step()
        return found

    def hears_others(self, wait_s: float) -> bool:
        return True

    def close(self) -> None:
        pass


@dataclass(frozen=True, kw_only=True)
class _EmulatedTarget(Target):
    unit: EmulatedUnit

    def connect(self) -> LibraryConnection:
        return LibraryConnection(_Transport(self.unit), "emulated unit")
