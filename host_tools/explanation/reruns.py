"""Reruns of a scenario with other set-ups, in this process, as far as the instant asked about."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeVar, cast

import numpy as np

from rrins.compiled.record import Floats, Integers, Record, Records
from rrins.firmware_py.core.navigation.trace import NavigationTrace
from rrins.firmware_py.core.records.memory import NavigationOutput
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.explanation.sources import SENSOR_KINDS, Sides
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.hardware.units import in_si
from rrins.host_tools.runs.exchange import DirectExchange
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.results.results import compare, in_common
from rrins.host_tools.runs.results.samples import SampleBuffer, SampleFile
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.wire.wire import Wire

_R = TypeVar("_R", bound=Record)

QUANTITIES: Final = (
    *("east_m", "north_m", "up_m"),
    *("east_mps", "north_mps", "up_mps"),
    *("roll_arcsec", "pitch_arcsec", "heading_arcsec"),
)
"""Components of an error: of position, velocity and attitude of the body."""

PART_S: Final = 20
"""Simulated time between two looks at whether to stop, s."""


class StoppedError(Exception):
    """The user stopped it."""


class _Kept(SampleFile):
    """Samples that stay in memory."""

    def __init__(self) -> None:
        super().__init__(None)
        self.samples: list[Records[Truth]] = []

    def append(self, samples: Records[_R]) -> None:
        """Keep a copy of samples."""
        self.samples.append(cast("Records[Truth]", samples.copy()))


class Rerun:
    """Both sides of a run, just switched on, to be run as far as wanted.

    Parameters
    ----------
    scenario : Scenario
        Its receiver's standard deviations are told to the firmware, whatever the set-up's are.
    sides : Sides
    every : int
        Epochs that are a multiple of this are kept.
    should_stop : callable
    """

    def __init__(
        self, scenario: Scenario, sides: Sides, every: int, should_stop: Callable[[], bool]
    ) -> None:
        self._scenario, self._every, self._should_stop = scenario, every, should_stop
        self._navigation: list[Records[NavigationOutput]] = []
        self._truth = _Kept()
        self._buffer: SampleBuffer[Truth] = SampleBuffer(Truth, self._truth)
        self._epochs = 0
        wire = _wire(scenario, sides)
        hardware = Hardware(sides.hardware, wire)
        _tell_sigmas(hardware, scenario)
        trace = NavigationTrace(every, lambda rows: self._navigation.append(rows.copy()))
        self._firmware = Firmware(sides.firmware, trace)
        _let_be_quiet(self._firmware, scenario, sides)
        self._fast: FastRun | None = None
        if wire is None:
            self._fast = FastRun(self._firmware.ram, hardware.plant, hardware.pieces, every)
        else:
            ppm = scenario.firmware.clock_error_ppm
            self._exchange = DirectExchange(
                hardware, self._firmware, self._buffer, every, ppm, wire
            )

    def run_until(self, epoch: int) -> None:
        """Go on to the end of an epoch.

        Raises
        ------
        StoppedError
        """
        while self._epochs <= epoch:
            if self._should_stop():
                raise StoppedError
            part = min(epoch + 1 - self._epochs, PART_S * self._scenario.rate_hz)
            if self._fast is not None:
                track = self._fast.run(part)
                self._navigation.append(track.navigation)
                self._truth.append(track.truth)
            else:
                last = -1
                while last + 1 < self._epochs + part:
                    last = self._exchange.run(self._epochs + part, 0)
            self._epochs += part

    def errors(self) -> tuple[Integers, Floats]:
        """Return the epochs kept so far in which it navigated, and the errors, shape (n, 9)."""
        self._firmware.trace.flush()
        self._buffer.flush()
        if not self._navigation:
            return np.zeros(0, np.int64), np.zeros((0, len(QUANTITIES)))
        navigation, truth = in_common(
            cast("Records[NavigationOutput]", np.concatenate(self._navigation)),
            cast("Records[Truth]", np.concatenate(self._truth.samples)),
        )
        found = compare(navigation, truth, self._scenario.rate_hz)
        velocity = navigation["velocity_n"] - truth["velocity_n"]
        place = (found.position_east_m, found.position_north_m, found.height_m)
        angles = [3600.0 * a for a in (found.roll_deg, found.pitch_deg, found.heading_deg)]
        return found.epoch, np.column_stack([*place, velocity, *angles])


def _wire(scenario: Scenario, sides: Sides) -> Wire | None:
    """Return the wire of a set-up, or None where it never does anything."""
    ends = [fault.first_epoch for fault in sides.wire if fault.first_epoch <= scenario.epochs]
    if not ends and scenario.bus.bitrate is None:
        return None
    return Wire(scenario.period_ns, sides.wire, scenario.seed, scenario.bus.bitrate)


def _let_be_quiet(firmware: Firmware, scenario: Scenario, sides: Sides) -> None:
    """Let sensors whose noise is taken away repeat themselves: that is no fault of theirs."""
    monitor = firmware.ram[0].diagnostics
    for kind, word in SENSOR_KINDS.items():
        count = len(getattr(scenario.rimu, kind))
        tables = (getattr(owner, kind) for owner in (scenario, sides.hardware))
        had, has = (np.broadcast_to(in_si(table)["white_noise"], count) for table in tables)
        repetition = monitor[f"{word}_repetition"]
        repetition.enough[:count][has < had] = 0


def _tell_sigmas(hardware: Hardware, scenario: Scenario) -> None:
    """Let the receiver state the standard deviations that it has by its data sheet."""
    table = scenario.gnss
    if table is not None:
        gnss = hardware.plant[0].gnss
        gnss.position_sigma = np.hypot(table.position_noise_m, table.position_correlated_noise_m)
        gnss.velocity_sigma = table.velocity_noise_mps
