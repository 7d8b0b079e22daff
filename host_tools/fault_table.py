"""The page `docs/faults.md`: every fault, put in and watched.

``python -m host_tools.fault_table`` runs each and writes the page; `make docs` keeps it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from firmware_py.diagnostics.trouble_table import TROUBLES
from firmware_py.diagnostics.troubles import Status
from firmware_py.loop import Firmware, own_clock_ns
from firmware_py.modes import Fault, Mode
from host_tools.fault_cases import OF_HARDWARE, ON_WIRE, Case
from host_tools.fault_page_text import AT_S, BETWEEN, HEAD
from host_tools.hardware.loop import Hardware
from host_tools.outfit import firmware_settings, hardware_settings, scenario_wire
from host_tools.results import east_north_m
from host_tools.scenario import Scenario

_BITRATE = 1_000_000
_DURATION_S = 60

_OUTPUT = ("latitude", "longitude", "roll", "pitch", "heading")
_FIRMWARE_COUNTERS = ("crc_errors", "counter_errors", "missing_frames", "bridged_epochs")
_HARDWARE_COUNTERS = ("crc_errors", "counter_errors", "missing_commands")


@dataclass(frozen=True)
class Row:
    """What came of a fault.

    Attributes
    ----------
    injected : str
    counted : dict
        Counters of both sides that moved, by their names.
    troubles : list of str
        Names of the trouble codes that were confirmed.
    after_epochs : int or None
        From the fault's first epoch to the first one in which a counter or the mode moved, or a
        trouble code's test failed; None if none did.
    mode : str
        In the end; with the reason if it is FAULT.
    worst_bridged : int
        Longest gap bridged, epochs.
    difference_m, difference_deg : float
        Position and attitude at the end, or when navigation ended, against those without the
        fault.
    """

    injected: str
    counted: dict[str, int]
    troubles: list[str]
    after_epochs: int | None
    mode: str
    worst_bridged: int
    difference_m: float
    difference_deg: float


class _Run:
    """A direct run that is looked at after every epoch."""

    def __init__(self, faults: list[dict[str, Any]], modelled: bool) -> None:
        self.scenario = Scenario.model_validate(
            {
                "duration_s": _DURATION_S,
                "faults": faults,
                "bus": {"bitrate": _BITRATE} if modelled else {},
            }
        )
        self.firmware = Firmware(firmware_settings(self.scenario))
        wire = scenario_wire(self.scenario)
        self.hardware = Hardware(hardware_settings(self.scenario), wire)
        self.navigation: list[tuple[float, ...]] = []

    def counters(self) -> dict[str, int]:
        ours, theirs = self.firmware.ram[0]["faults"], self.hardware.plant[0]["counters"]
        return {f"firmware {name}": int(ours[name]) for name in _FIRMWARE_COUNTERS} | {
            f"hardware {name}": int(theirs[name]) for name in _HARDWARE_COUNTERS
        }

    def signs(self) -> tuple[Any, ...]:
        """Return all from which the fault can be noticed."""
        state = self.firmware.ram[0]
        failed = state["diagnostics"]["troubles"]["status"] & Status.TEST_FAILED
        not_following = state["sequencer"]["not_following"]
        return self.counters(), self.firmware.mode, failed.tobytes(), not_following.tobytes()

    def troubles(self) -> list[str]:
        """Return the names of the trouble codes that are confirmed."""
        status = self.firmware.ram[0]["diagnostics"]["troubles"]["status"]
        confirmed = np.flatnonzero(status & Status.CONFIRMED)
        return [TROUBLES[index].name for index in confirmed]

    def epochs(self) -> Iterator[int]:
        count = 0
        for epoch in range(self.scenario.epochs):
            frames, sent = self.hardware.open_epoch(epoch, self.firmware.outbox, count)
            arrival_ns = own_clock_ns(epoch * self.hardware.period_ns, 0.0)
            count = self.firmware.step_whole(frames, sent, arrival_ns)
            output = self.firmware.ram[0]["navigation"]
            self.navigation.append(tuple(float(output[name]) for name in _OUTPUT))
            yield epoch


def observe(case: Case, reference: _Run) -> Row:
    """Run a fault and return what came of it."""
    run = _Run([{"at_s": AT_S} | case.fault], case.modelled)
    first = round(AT_S * run.scenario.rate_hz)
    before: dict[str, int] = {}
    signs: tuple[Any, ...] = ()
    found: int | None = None
    worst = 0
    for epoch in run.epochs():
        if epoch == first - 1:
            before, signs = run.counters(), run.signs()
        elif epoch >= first:
            if run.firmware.mode is not Mode.FAULT:
                worst = max(worst, int(run.firmware.ram[0]["faults"]["consecutive_bridged"]))
            if found is None and run.signs() != signs:
                found = epoch - first
    after = run.counters()
    mode = run.firmware.mode.name
    if run.firmware.mode is Mode.FAULT:
        mode += f" ({Fault(int(run.firmware.ram[0]['modes']['fault'])).name})"
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


def _differences(run: _Run, reference: _Run) -> tuple[float, float]:
    """Return by how much the last position, m, and attitude, °, are off."""
    epoch = int(run.firmware.ram[0]["navigation"]["epoch"])
    (lat, lon, *ours), (true_lat, true_lon, *theirs) = (
        side.navigation[epoch] for side in (run, reference)
    )
    east, north = east_north_m(lat, lon, true_lat, true_lon, 40.0)
    angles = [math.remainder(a - b, math.tau) for a, b in zip(ours, theirs, strict=True)]
    return float(np.hypot(east, north)), math.degrees(max(map(abs, angles)))


def rows() -> list[Row]:
    """Return the rows of all cases, those on the wire first."""
    reference = _Run([], modelled=False)
    for _ in reference.epochs():
        pass
    return [observe(case, reference) for case in (*ON_WIRE, *OF_HARDWARE)]


def _cells(row: Row) -> tuple[str, str, str, str]:
    """Return found after, counted, trouble codes, position off by."""
    after = "not noticed" if row.after_epochs is None else f"{row.after_epochs} epochs"
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
        f"| {row.worst_bridged} epochs | {row.mode} | {off_by} |"
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
    print(page(rows()), end="")
