"""The filter of a run, second by second: its transitions, and each measurement with its gain.

The firmware runs once along the scenario, with hardware that has no errors, and its own functions
say what is noted here: `follow` fills in the transition, `innovation_of` the row and the noise of a
measurement, `take` uses it. No run's noise is in it, nor what the gate rejects of one.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Final, NamedTuple, cast

import numpy as np

from rrins.compiled.record import Floats, Records
from rrins.firmware_py.core.estimator import measurements
from rrins.firmware_py.core.modes.modes import navigating
from rrins.firmware_py.core.records.estimator_records import (
    BIASES,
    COMPONENTS,
    DONE,
    SWAY_EAST,
    SWAY_NORTH,
    Aid,
    Estimator,
)
from rrins.firmware_py.core.records.memory import Ram
from rrins.host_tools.covariance.path import INTERVAL_S
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.hardware.step import note_truth
from rrins.host_tools.hardware.tables import (
    Accelerometers,
    Altimeter,
    Axis,
    Gyros,
    Thermal,
    Turntable,
)
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    first_pose,
    hardware_settings,
)
from rrins.host_tools.scenario.scenario import Scenario

LEAST_RATE_HZ: Final = 30
"""At fewer epochs in a second the filter does several pieces of its work in one."""

_PIECES: Final = 3
"""Epochs in which a filter's second is propagated, before its measurements are taken."""

_TAKING: Final = 4
"""The filter's stage in which it takes measurements."""


class Take(NamedTuple):
    """A scalar measurement that the filter used."""

    aid: Aid
    component: int
    row: Floats
    """Of the states, shape (s,)."""
    gain: Floats
    """Shape (s,)."""
    sigma: float
    """Of its noise, as the filter takes it; m or m/s."""
    stretch_m: float
    """Of the odometer: its distance."""
    stretch_s: float
    heights: int
    """Of the altimeter: heights in the mean."""


@dataclass(frozen=True)
class Second:
    """A second of the filter: measurements at its beginning, and the transition over it."""

    takes: tuple[Take, ...]
    phi: Floats  #: shape (s, s)
    length_s: float


@dataclass(frozen=True)
class Layout:
    """Sensors of each kind, and where the other states begin; None: there are none."""

    gyros: int
    accelerometers: int
    odometer: int | None
    altimeter: int | None
    receiver: int | None
    constants: int | None


@dataclass(frozen=True)
class Trace:
    """A filter along its nominal run.

    Attributes
    ----------
    layout : Layout
    seconds : list of Second
    """

    layout: Layout
    seconds: list[Second]
    P: list[Floats]  #: at the beginning and after each second, before its measurements, (s, s)
    radii: Floats  #: shape (n + 1, 2); m per rad of latitude and of longitude
    truth: Records[Truth]  #: every `INTERVAL_S`
    begins_s: float  #: since navigation began; negative in a fine alignment


def trace_of(scenario: Scenario) -> Trace:
    """Return the trace of a scenario's filter.

    Raises
    ------
    RehearsalError
        When the filter does not run from the beginning of the navigation to its end.
    """
    if (
        scenario.rate_hz < LEAST_RATE_HZ
        or round(INTERVAL_S * scenario.rate_hz) * 2 != scenario.rate_hz
    ):
        raise RehearsalError(
            f"covariance: with the estimator, for an even rate_hz of {LEAST_RATE_HZ} or more"
        )
    return _Recorder(_nominal(scenario), scenario).trace()


def _nominal(scenario: Scenario) -> FastRun:
    """Return both sides switched on: the firmware as it is, hardware without errors.

    The receiver goes on telling the standard deviations that it does.
    """
    longer = scenario.duration_s + 1.0  # the last second is propagated within the next one
    clean = scenario.model_copy(update={"faults": (), "duration_s": longer})
    whole = hardware_settings(clean)
    table, odometer, master = whole.turntable, whole.odometer, whole.master
    if odometer is not None:
        odometer = odometer.model_copy(update={"scale_error_ppm": 0.0, "noise_mps": 0.0})
    if master is not None:
        none = (0.0, 0.0, 0.0)
        master = replace(master, attitude_error=none, velocity_error=none, position_error=none)
    sides = replace(
        whole,
        gyros=Gyros(range_dps=whole.gyros.range_dps),
        accelerometers=Accelerometers(range_g=whole.accelerometers.range_g),
        turntable=Turntable(inner=_true(table.inner), outer=_true(table.outer)),
        thermal=Thermal(),
        altimeter=None if whole.altimeter is None else Altimeter(),
        odometer=odometer,
        master=master,
    )
    firmware = firmware_settings(clean).model_copy(update=asdict(first_pose(clean)))
    run = FastRun.of(firmware, sides)
    silent = ("position_noise", "velocity_noise", "position_correlated_noise")
    run.plant["gnss"][list(silent)] = 0.0
    return run


def _true(axis: Axis) -> Axis:
    """Return an axis without imperfections."""
    wrong = ("encoder_offset_deg", "ripple_arcsec", "stiction_arcsec", "run_out_um")
    return axis.model_copy(update=dict.fromkeys(wrong, 0.0))


class _Recorder:
    """Goes along a nominal run from one event of the filter to the next."""

    def __init__(self, run: FastRun, scenario: Scenario) -> None:
        self._run, self._rate_hz = run, scenario.rate_hz
        self._last = scenario.epochs - 1
        gnss = run.plant[0].gnss
        self._fixes = int(gnss.interval_epochs), int(gnss.latency_epochs)
        self._takes: list[Take] = []
        self._truth: list[Records[Truth]] = []
        self._begins = self._navigates = -1

    def trace(self) -> Trace:
        """Go along the run; see `trace_of`."""
        while not self._filter.running:
            if self._next > self._last:
                raise RehearsalError("covariance: the filter of the scenario never begins")
            self._run.run(1)
        self._begins = self._next - 1
        self._note()
        seconds: list[Second] = []
        P, radii = [self._covariance()], [self._radii()]
        left = self._rate_hz
        while self._next - 1 + left <= self._last:
            self._go(left)
            left = self._rate_hz - _PIECES
            self._run.run(_PIECES)
            if self._filter.epochs != _PIECES or self._filter.stage != _TAKING:
                raise RehearsalError("covariance: the filter begins anew within the scenario")
            takes, self._takes = tuple(self._takes), []
            seconds.append(Second(takes, *self._transition()))
            P.append(self._covariance())
            radii.append(self._radii())
            self._drain(self._run.ram)
        if self._navigates < 0 or not seconds:
            raise RehearsalError("covariance: the scenario does not navigate to its end")
        truth = cast(Records[Truth], np.concatenate(self._truth))
        begins_s = (self._begins - self._navigates) / self._rate_hz
        return Trace(self._layout(), seconds, P, np.array(radii), truth, begins_s)

    @property
    def _filter(self) -> Estimator:
        return self._run.ram[0].estimator

    @property
    def _next(self) -> int:
        """The next epoch."""
        return int(self._run.plant[0].epoch)

    def _go(self, epochs: int) -> None:
        """Go on by some epochs, of which the last ends the filter's second."""
        until, half = self._next + epochs, self._rate_hz // 2
        while self._next < until:
            if self._brings_fix(self._next):
                self._step_with_fix()
            else:
                ends = (e + 1 for e in range(self._next, until) if self._ends_part(e + 1, half))
                self._run.run(next(ends, until) - self._next)
            if (self._next - 1 - self._begins) % half == 0:
                self._note()
            self._drain(self._run.ram)

    def _ends_part(self, epoch: int, half: int) -> bool:
        """Return whether something is to be looked at before this epoch."""
        return self._brings_fix(epoch) or (epoch - 1 - self._begins) % half == 0

    def _brings_fix(self, epoch: int) -> bool:
        interval, latency = self._fixes
        return interval > 0 and (epoch - latency) % interval == 0

    def _note(self) -> None:
        """Note the truth at the end of the last epoch, and when navigation began."""
        plant, modes = self._run.plant[0], self._run.ram[0].modes
        plant.epoch -= 1
        note_truth(plant, self._run.pieces)
        self._truth.append(cast(Records[Truth], self._run.plant["truth"].copy()))
        if self._navigates < 0 and navigating(self._run.ram[0]):
            self._navigates = int(plant.epoch - modes.epochs)
        plant.epoch += 1

    def _step_with_fix(self) -> None:
        """Run an epoch that may bring a fix: a part of it may be used at once."""
        ram = self._run.ram
        before, judged = ram["estimator"].copy(), _judged(ram)
        self._run.run(1)
        if _judged(ram) == judged:
            return
        again = ram.copy()
        again["estimator"] = before
        measurements.note(again[0])
        while _judged(again) < _judged(ram):
            self._take(again)

    def _drain(self, ram: Records[Ram]) -> None:
        """Take what waits; nothing else happens to P until the second ends."""
        estimator = ram[0].estimator
        while estimator.stage == _TAKING and estimator.waiting:
            self._take(ram)

    def _take(self, ram: Records[Ram]) -> None:
        """Take the next measurement that waits, and note it if it is used."""
        state = ram[0]
        estimator, n = state.estimator, int(state.estimator.states)
        bit = (int(estimator.waiting) & -int(estimator.waiting)).bit_length() - 1
        aid, component = Aid(bit // COMPONENTS), bit % COMPONENTS
        estimator.row[:] = 0.0
        _, sigma = measurements.innovation_of(state, int(aid), component)
        row, P = estimator.row[:n].copy(), estimator.P[:n, :n]
        spread = P @ row
        gain = spread / (row @ spread + sigma**2)
        used = int(estimator.sources[aid].used)
        measurements.take(state)
        if estimator.sources[aid].used > used:
            size = float(estimator.stretch_m), float(estimator.stretch_s)
            self._takes.append(
                Take(aid, component, row, gain, sigma, *size, int(estimator.height_count))
            )

    def _transition(self) -> tuple[Floats, float]:
        """Return the transition over the filter's second, and its length, s."""
        estimator = self._filter
        n = int(estimator.states)
        phi = np.eye(n)
        phi[:BIASES] = estimator.transition[:, :n]
        if estimator.sway:
            for pair in (SWAY_EAST, SWAY_NORTH):
                at = int(estimator.sway_state) + pair
                phi[at : at + 2, at : at + 2] = estimator.sway_transition
        if estimator.receiver:
            at = int(estimator.receiver_state)
            phi[at : at + COMPONENTS, at : at + COMPONENTS] *= estimator.receiver_share
        return phi, float(estimator.seconds[DONE])

    def _covariance(self) -> Floats:
        n = int(self._filter.states)
        return self._filter.P[:n, :n].copy()

    def _radii(self) -> tuple[float, float]:
        return float(self._filter.north_radius), float(self._filter.east_radius)

    def _layout(self) -> Layout:
        ram, estimator = self._run.ram[0], self._filter
        gyros, accelerometers = int(ram.gyros.count), int(ram.accelerometers.count)
        return Layout(
            gyros,
            accelerometers,
            BIASES + gyros + accelerometers if ram.odometer.interval_epochs > 0 else None,
            int(estimator.altimeter_state) if estimator.altimeter else None,
            int(estimator.receiver_state) if estimator.receiver else None,
            int(estimator.constants_state) if estimator.constants else None,
        )


def _judged(ram: Records[Ram]) -> int:
    """Return how many scalars the filter has judged."""
    sources = ram["estimator"]["sources"]
    return int(sources["used"].sum() + sources["rejected"].sum())
