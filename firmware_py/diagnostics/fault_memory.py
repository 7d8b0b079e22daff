"""The trouble codes' status bytes, freeze frames and counters, as the services read them.

The step sets them in the RAM image. Operation cycles, aging and clearing are handled
here, between two steps (ISO 14229-1, annex D).
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator

import numpy as np

from rrins.compiled.record import Records
from rrins.dbc.codec import load
from rrins.dbc.contract import Contract
from rrins.firmware_py.core.monitoring import consistency
from rrins.firmware_py.core.monitoring.monitor import COUNTER_CEILING, COUNTER_ONE
from rrins.firmware_py.core.records.diagnostic_records import Snapshot, TroubleMemory
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.redundancy_records import ParityBefore
from rrins.firmware_py.core.records.trouble_table import FIRST, PARITY_KIND, TROUBLES
from rrins.firmware_py.core.records.troubles import (
    AGING_CYCLES,
    ALL_GROUPS,
    CLEARED_STATUS,
    Status,
    Trouble,
)
from rrins.firmware_py.diagnostics.codecs import Values

_HEAD = struct.Struct(">II")  # CRC-32 of the layout, operation cycles
LAYOUT = zlib.crc32(repr((TroubleMemory.dtype.descr, [t.number for t in TROUBLES])).encode())
"""CRC-32 of what the image means: another firmware version has another."""

CAPACITY = _HEAD.size + TroubleMemory.dtype.itemsize
"""Bytes of `FaultMemory.image`."""

PARITY_ROW = {index: row for row, index in enumerate(PARITY_KIND)}
"""Rows of `TroubleMemory.parities` by index of the trouble code."""

_LOAD_MEAN_S = 0.25
_PATIENCE_S = 0.2  # two cycles of MODE_COMMAND, or of ALTIMETER
_STUCK_S = 2.0
_CLOCK_TOLERANCE = 300e-6
_FRAME_BITS = 125  # of a classic frame with 8 bytes, with average stuffing and gap

_BITS_PER_KIND = np.array(
    [sum(1 << t.bit for t in TROUBLES if t.kind == kind) for kind in range(len(FIRST))]
)


class FaultMemory:
    """The trouble codes of a computer.

    Parameters
    ----------
    ram : Records[Ram]
        As `rrins.firmware_py.core.settings.power_on` makes it.

    Attributes
    ----------
    operation_cycles : int
        Since the trouble codes were first stored.
    """

    def __init__(self, ram: Records[Ram], contract: Records[Contract]) -> None:
        self._ram = ram
        self._contract = contract
        self._monitor = ram[0].diagnostics
        self._memory = self._monitor.troubles
        self.operation_cycles = 1
        self.supported: tuple[int, ...] = ()
        """Indices of the trouble codes that this computer can have."""
        self.set_up()
        self._memory.status[:] = CLEARED_STATUS

    def set_up(self) -> None:
        """Set up the monitor in a new RAM image; no test has run yet."""
        state, monitor = self._ram[0], self._monitor
        period_s = float(state.parameters.period_ns) * 1e-9
        counts = {"gyro": int(state.gyros.count)}
        counts["accelerometer"] = int(state.accelerometers.count)
        counts[""] = max(counts.values())
        counts["altimeter"] = int(state.parameters.altimeter)
        counts["gnss"] = int(state.gnss.interval_epochs > 0)
        counts["odometer"] = int(state.odometer.interval_epochs > 0)
        counts["estimator"] = int(state.estimator.enabled)
        self.supported = tuple(
            index for index, one in enumerate(TROUBLES) if one.group < counts[one.needs]
        )
        self._index = {TROUBLES[index].number: index for index in self.supported}
        up, down = monitor.up, monitor.down
        for index, one in enumerate(TROUBLES):
            debounce = one.debounce
            up[index] = math.ceil(COUNTER_CEILING / debounce.fail_epochs(1 / period_s))
            down[index] = math.ceil(COUNTER_CEILING / debounce.pass_epochs(1 / period_s))
        monitor.counter[:] = 0
        monitor.unsettled[:] = _BITS_PER_KIND
        bits_per_s = load().bits_per_s
        monitor.frames_capacity = bits_per_s * period_s / _FRAME_BITS
        monitor.frames_share = min(1.0, period_s / _LOAD_MEAN_S)
        monitor.patience_epochs = round(_PATIENCE_S / period_s)
        monitor.stuck_epochs = 2 * round(_STUCK_S / period_s / 2)
        monitor.residual_share = min(1.0, period_s / consistency.MEAN_S)
        monitor.clock_tolerance_q16 = round(_CLOCK_TOLERANCE * period_s * 1e9 * 65536)
        sensor = self._contract[0].sensor[0]
        for repetition, signal in (
            (monitor.gyro_repetition, sensor.gyro_dtheta),
            (monitor.accelerometer_repetition, sensor.accelerometer_dv),
        ):
            repetition.resolution = max(repetition.resolution, signal.scale)

    def index_of(self, number: int) -> int | None:
        """Return the index of a trouble code that this computer can have."""
        return self._index.get(number)

    def status(self, index: int) -> int:
        """Return a trouble code's status byte."""
        return int(self._memory.status[index])

    def numbers(self) -> Iterator[tuple[int, int]]:
        """Yield the number and index of each trouble code that this computer can have."""
        yield from self._index.items()

    def by_mask(self, mask: int) -> Iterator[tuple[Trouble, int]]:
        """Yield the trouble codes that have one of the bits, with their status bytes."""
        statuses = self._memory.status.tolist()
        for index in self.supported:
            if statuses[index] & mask:
                yield TROUBLES[index], statuses[index]

    def detection_counter(self, index: int) -> int:
        """Return a trouble code's fault detection counter, -128 (passed) to 127 (failed)."""
        return int(self._monitor.counter[index]) // COUNTER_ONE

    def extended(self, index: int) -> dict[int, Values]:
        """Return a trouble code's extended data, by record."""
        return {
            0x01: {
                "occurrences": min(0xFFFF, int(self._memory.occurrences[index])),
                "aging": min(0xFF, int(self._memory.aging[index])),
                "fault_detection_counter": self.detection_counter(index),
            }
        }

    def snapshot(self, index: int, number: int) -> Records[Snapshot] | None:
        """Return a freeze frame, an array of one record; None if there is none."""
        if self._memory.occurrences[index] == 0:
            return None
        return self._memory.snapshots[index, number - 1 : number]

    def parity(self, index: int, number: int) -> Records[ParityBefore] | None:
        """Return the parity in a freeze frame, an array of one record; None if it has none."""
        if index not in PARITY_ROW or self._memory.occurrences[index] == 0:
            return None
        return self._memory.parities[PARITY_ROW[index], number - 1 : number]

    def with_snapshots(self) -> list[Trouble]:
        """Return the trouble codes that have freeze frames."""
        occurrences = self._memory.occurrences.tolist()
        return [TROUBLES[index] for index in self.supported if occurrences[index]]

    def is_group(self, number: int) -> bool:
        """Return whether `clear` supports a groupOfDTC."""
        return number == ALL_GROUPS or number in self._index

    def clear(self, number: int) -> None:
        """Clear one trouble code, or all (`ALL_GROUPS`)."""
        cleared = list(self.supported) if number == ALL_GROUPS else [self._index[number]]
        self._forget(cleared)
        self._memory.status[cleared] = CLEARED_STATUS
        self._monitor.counter[cleared] = 0
        for index in cleared:
            self._monitor.unsettled[TROUBLES[index].kind] |= 1 << TROUBLES[index].bit

    def _forget(self, indices: list[int]) -> None:
        self._memory.occurrences[indices] = 0
        self._memory.aging[indices] = 0
        self._memory.snapshots[indices] = Snapshot.zeros(2)
        rows = [PARITY_ROW[index] for index in indices if index in PARITY_ROW]
        self._memory.parities[rows] = ParityBefore.zeros(2)

    def begin_cycle(self) -> None:
        """End an operation cycle and begin the next: what did not fail in it ages."""
        self.operation_cycles += 1
        status = self._memory.status
        tested = status & Status.TEST_NOT_COMPLETED_THIS_OPERATION_CYCLE == 0
        sound = tested & (status & Status.TEST_FAILED_THIS_OPERATION_CYCLE == 0)
        status[sound] &= 0xFF & ~Status.PENDING
        for index in np.flatnonzero(sound & (status & Status.CONFIRMED != 0)).tolist():
            self._memory.aging[index] += 1
            if self._memory.aging[index] >= AGING_CYCLES:
                self._forget([index])
                status[index] &= 0xFF & ~Status.CONFIRMED
        status &= 0xFF & ~Status.TEST_FAILED_THIS_OPERATION_CYCLE
        status |= int(Status.TEST_NOT_COMPLETED_THIS_OPERATION_CYCLE)
        self.begin_test()

    def begin_test(self) -> None:
        """Restart every test, as after any reset."""
        self._memory.status &= 0xFF & ~Status.TEST_FAILED

    def image(self) -> bytes:
        """Return the image to store across power-off."""
        return _HEAD.pack(LAYOUT, self.operation_cycles) + self._memory.tobytes()

    def recall(self, image: bytes) -> None:
        """Load a stored image; discard one of another firmware version."""
        if len(image) != CAPACITY:
            return
        layout, cycles = _HEAD.unpack_from(image)
        if layout == LAYOUT:
            self.operation_cycles = cycles
            self.restore(image[_HEAD.size :])

    def keep(self) -> bytes:
        """Return the trouble codes as bytes, for `restore` after a soft reset."""
        return self._memory.tobytes()

    def restore(self, kept: bytes) -> None:
        """Restore trouble codes that `keep` returned."""
        self._monitor.troubles = TroubleMemory.from_bytes(kept)[0]
        self._memory = self._monitor.troubles
