"""The page `docs/faults.md`: every fault, injected and observed.

``python -m generate.faults_page`` runs each and writes the page; `make docs` keeps it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from generate.fault_cases import OF_HARDWARE, ON_WIRE, Case
from generate.faults_page_text import AT_S, BETWEEN, HEAD
from generate.redundancy_faults import section
from rrins.firmware_py.core.modes.modes import FirmwareFault, Mode
from rrins.firmware_py.core.records.trouble_table import TROUBLES
from rrins.firmware_py.core.records.troubles import Status
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.hardware.fault_kinds import AIDS
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.runs.exchange import exchange_epoch
from rrins.host_tools.runs.results.results import east_north_m
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    hardware_settings,
    scenario_wire,
)
from rrins.host_tools.scenario.scenario import Scenario

_BITRATE = 1_000_000
_DURATION_S = 60

_OUTPUT = ("latitude", "longitude", "roll", "pitch", "heading")
_FIRMWARE_COUNTERS = ("crc_errors", "counter_errors", "missing_frames", "bridged_epochs")
_HARDWARE_COUNTERS = ("crc_errors", "counter_errors", "missing_commands")


@dataclass(frozen=True)
class Row:
    """The result of a fault.

    Attributes
    ----------
    injected : str
    counted : dict
        Counters of both sides that changed, by name.
    troubles : list of str
        Names of the trouble codes that were confirmed.
    after_epochs : int or None
        From the fault's first epoch to the first in which a counter or the mode changed, or a
        trouble code's test failed; None if none did.
    mode : str
        At the end; with the reason if it is FAULT.
    worst_bridged : int
        Longest gap bridged, epochs.
    difference_m, difference_deg : float
        Difference in position and attitude from the run without the fault, at the end or when
        navigation ended.
    """

    injected: str
    counted: dict[str, int]
    troubles: list[str]
    after_epochs: int | None
    mode: str
    worst_bridged: int
    difference_m: float
    difference_deg: float


def _has_fault_of(stem: str, faults: list[dict[str, Any]]) -> bool:
    return any(fault["kind"].startswith(f"{stem}_") for fault in faults)


class _Run:
    """A direct run that is observed after every epoch."""

    def __init__(self, faults: list[dict[str, Any]], modelled: bool) -> None:
        channel = "damped" if _has_fault_of("altimeter", faults) else "held"
        self.scenario = Scenario.model_validate(
            {
                "duration_s": _DURATION_S,
                "faults": faults,
                "bus": {"bitrate": _BITRATE} if modelled else {},
                **{aid: {} for aid in AIDS if _has_fault_of(aid, faults)},
                "firmware": {"height_channel": channel},
            }
        )
        self.firmware = Firmware(firmware_settings(self.scenario))
        wire = scenario_wire(self.scenario)
        self.hardware = Hardware(hardware_settings(self.scenario), wire)
        ram, plant = self.firmware.ram, self.hardware.plant
        self._counters = {
            f"{side} {name}": record[name]
            for side, names, record in (
                ("firmware", _FIRMWARE_COUNTERS, ram["faults"]),
                ("hardware", _HARDWARE_COUNTERS, plant["counters"]),
            )
            for name in names
        }
        self._signs = (
            *self._counters.values(),
            ram["modes"]["mode"],
            ram["diagnostics"]["troubles"]["status"],
            ram["sequencer"]["not_following"],
        )
        self._bridged = ram["faults"]["consecutive_bridged"]

    def counters(self) -> dict[str, int]:
        return {name: int(count[0]) for name, count in self._counters.items()}

    def signs(self) -> list[bytes]:
        """Return everything that can reveal the fault."""
        *others, status, not_following = self._signs
        failed = status & Status.TEST_FAILED
        return [*(one.tobytes() for one in others), failed.tobytes(), not_following.tobytes()]

    @property
    def bridged(self) -> int:
        """Epochs bridged without a break up to now."""
        return int(self._bridged[0])

    def navigation(self) -> tuple[float, ...]:
        """Return the values of `_OUTPUT`, as last navigated."""
        output = self.firmware.ram[0]["navigation"]
        return tuple(float(output[name]) for name in _OUTPUT)

    def troubles(self) -> list[str]:
        """Return the names of the trouble codes that are confirmed."""
        status = self.firmware.ram[0]["diagnostics"]["troubles"]["status"]
        confirmed = np.flatnonzero(status & Status.CONFIRMED)
        return [TROUBLES[index].name for index in confirmed]

    def epochs(self) -> Iterator[int]:
        count = 0
        for epoch in range(self.scenario.epochs):
            count = exchange_epoch(self.hardware, self.firmware, epoch, count)
            yield epoch


def observe(case: Case, reference: list[tuple[float, ...]]) -> Row:
    """Run a fault and return its result; `reference` navigates without, an item per epoch."""
    run = _Run([{"at_s": AT_S} | case.fault], case.modelled)
    first = round(AT_S * run.scenario.rate_hz)
    before: dict[str, int] = {}
    signs: list[bytes] = []
    found: int | None = None
    worst = 0
    for epoch in run.epochs():
        if epoch == first - 1:
            before, signs = run.counters(), run.signs()
        elif epoch >= first:
            if run.bridged > worst and run.firmware.mode is not Mode.FAULT:
                worst = run.bridged
            if found is None and run.signs() != signs:
                found = epoch - first
    after = run.counters()
    mode = run.firmware.mode.name
    if run.firmware.mode is Mode.FAULT:
        mode += f" ({FirmwareFault(int(run.firmware.ram[0]['modes']['fault'])).name})"
    elif any(run.firmware.ram[0]["sequencer"]["not_following"]):
        mode += " (axis not following)"
    return Row(
        case.injected,
        {name: after[name] - before[name] for name in after if after[name] != before[name]},
        run.troubles(),
        found,
        mode,
        worst,
        *_differences(run, reference),
    )


def _differences(run: _Run, reference: list[tuple[float, ...]]) -> tuple[float, float]:
    """Return the errors of the last position, m, and attitude, °."""
    epoch = int(run.firmware.ram[0]["navigation"]["epoch"])
    lat, lon, *ours = run.navigation()
    true_lat, true_lon, *theirs = reference[epoch]
    east, north = east_north_m(lat, lon, true_lat, true_lon, 40.0)
    angles = [math.remainder(a - b, math.tau) for a, b in zip(ours, theirs, strict=True)]
    return float(np.hypot(east, north)), math.degrees(max(map(abs, angles)))


def rows() -> list[Row]:
    """Return the rows of all cases, those on the wire first."""
    sound = _Run([], modelled=False)
    reference = [sound.navigation() for _ in sound.epochs()]
    return [observe(case, reference) for case in (*ON_WIRE, *OF_HARDWARE)]


def _epochs(count: int) -> str:
    return f"{count} epoch" if count == 1 else f"{count} epochs"


def _cells(row: Row) -> tuple[str, str, str, str]:
    """Return the cells detected after, counters, trouble codes, position error."""
    after = "not detected" if row.after_epochs is None else _epochs(row.after_epochs)
    counted = ", ".join(f"{name} {count}" for name, count in row.counted.items()) or "-"
    off_by = f"{row.difference_m * 1000:.3g} mm"
    if row.difference_m >= 1:
        off_by = f"{row.difference_m:.3g} m"
    return after, counted, ", ".join(f"`{name}`" for name in row.troubles) or "-", off_by


def _on_wire(row: Row, case: Case) -> str:
    after, counted, troubles, off_by = _cells(row)
    wire = "modelled" if case.modelled else "ideal"
    return (
        f"| {row.injected} | {wire} | {after} | {counted} | {troubles} "
        f"| {_epochs(row.worst_bridged)} | {row.mode} | {off_by} |"
    )


def _of_hardware(row: Row) -> str:
    after, counted, troubles, off_by = _cells(row)
    return (
        f"| {row.injected} | {after} | {counted} | {troubles} | {row.mode} | {off_by} "
        f"| {round(row.difference_deg, 6):.2g}° |"
    )


def page(table: list[Row]) -> str:
    """Return the page as Markdown."""
    on_wire, of_hardware = table[: len(ON_WIRE)], table[len(ON_WIRE) :]
    lines = [_on_wire(row, case) for row, case in zip(on_wire, ON_WIRE, strict=True)]
    lines += [BETWEEN, *(_of_hardware(row) for row in of_hardware)]
    return "\n".join([HEAD, *lines]) + "\n"


if __name__ == "__main__":
    print(page(rows()) + section(), end="")
