"""The page `docs/faults.md`: every fault on the wire, put in and watched.

``python -m host_tools.fault_table`` runs each and writes the page; `make docs` keeps it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from firmware_py.loop import Firmware, own_clock_ns
from firmware_py.modes import Fault, Mode
from host_tools.hardware.loop import Hardware
from host_tools.outfit import firmware_settings, hardware_settings, scenario_wire
from host_tools.results import east_north_m
from host_tools.scenario import Scenario

AT_S = 23.0
"""When every fault of the table begins, after power-on: 20 s into navigation."""

_BITRATE = 1_000_000
_DURATION_S = 60

CASES: tuple[tuple[str, dict[str, Any], bool], ...] = (
    ("SENSOR_3 lost for 5 s", {"kind": "drop", "message": "SENSOR_3", "for_s": 5}, False),
    ("1 % of all frames lost", {"kind": "drop", "probability": 0.01}, False),
    ("SENSOR_2 10 ms late for 1 s", {"kind": "delay", "message": "SENSOR_2", "for_s": 1}, False),
    ("every frame twice for 5 s", {"kind": "duplicate", "for_s": 5}, False),
    ("every epoch in another order for 5 s", {"kind": "reorder", "for_s": 5}, False),
    ("an error frame in each epoch for 5 s", {"kind": "corrupt_wire", "for_s": 5}, True),
    (
        "a bit wrong past CRC-15, SENSOR_1 for 5 s",
        {"kind": "corrupt", "message": "SENSOR_1", "for_s": 5},
        False,
    ),
    ("10 % of all frames with a wrong bit", {"kind": "corrupt", "probability": 0.1}, False),
    (
        "wrong counter, SENSOR_4 for 5 s",
        {"kind": "wrong_counter", "message": "SENSOR_4", "for_s": 5},
        False,
    ),
    ("SYNC lost for 5 s", {"kind": "drop", "message": "SYNC", "for_s": 5}, False),
    ("hardware silent for 50 ms", {"kind": "silence", "node": "hardware", "for_s": 0.05}, False),
    ("hardware silent for 1 s", {"kind": "silence", "node": "hardware", "for_s": 1}, False),
    (
        "inner encoder silent for 5 s",
        {"kind": "silence", "message": "AXIS_INNER_STATUS", "for_s": 5},
        False,
    ),
    (
        "firmware silent for 5 s",
        {"kind": "silence", "node": "firmware", "for_s": 5},
        False,
    ),
    ("a node babbles, 8 frames an epoch", {"kind": "babble", "frames_per_epoch": 8}, True),
    (
        "a node babbles, 40 frames an epoch for 1 s",
        {"kind": "babble", "frames_per_epoch": 40, "for_s": 1},
        True,
    ),
    ("hardware bus-off", {"kind": "bus_off", "node": "hardware", "for_s": 0.02}, True),
    ("firmware bus-off", {"kind": "bus_off", "node": "firmware", "for_s": 0.02}, True),
    ("bus cut for 50 ms", {"kind": "cut", "for_s": 0.05}, True),
    ("bus cut for 1 s", {"kind": "cut", "for_s": 1}, True),
)
"""What is injected, in words and as a scenario says it, and whether the wire is modelled."""

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
    after_epochs : int or None
        From the fault's first epoch to the first counter or mode that moved; None if none did.
    mode : str
        In the end; with the reason if it is FAULT.
    worst_bridged : int
        Longest gap bridged, epochs.
    difference_m : float
        Position at the end, or when navigation ended, against that without the fault.
    """

    injected: str
    counted: dict[str, int]
    after_epochs: int | None
    mode: str
    worst_bridged: int
    difference_m: float


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
        self.navigation: list[tuple[float, float]] = []

    def counters(self) -> dict[str, int]:
        ours, theirs = self.firmware.ram[0]["faults"], self.hardware.plant[0]["counters"]
        return {f"firmware {name}": int(ours[name]) for name in _FIRMWARE_COUNTERS} | {
            f"hardware {name}": int(theirs[name]) for name in _HARDWARE_COUNTERS
        }

    def epochs(self) -> Iterator[int]:
        count = 0
        for epoch in range(self.scenario.epochs):
            frames, sent = self.hardware.open_epoch(epoch, self.firmware.outbox, count)
            arrival_ns = own_clock_ns(epoch * self.hardware.period_ns, 0.0)
            count = self.firmware.step_whole(frames, sent, arrival_ns)
            output = self.firmware.ram[0]["navigation"]
            self.navigation.append((float(output["latitude"]), float(output["longitude"])))
            yield epoch


def observe(injected: str, fault: dict[str, Any], modelled: bool, reference: _Run) -> Row:
    """Run a fault and return what came of it."""
    run = _Run([{"at_s": AT_S} | fault], modelled)
    first = round(AT_S * run.scenario.rate_hz)
    before: dict[str, int] = {}
    found: int | None = None
    worst = 0
    for epoch in run.epochs():
        if epoch == first - 1:
            before = run.counters()
        elif epoch >= first:
            if run.firmware.mode is not Mode.FAULT:
                worst = max(worst, int(run.firmware.ram[0]["faults"]["consecutive_bridged"]))
            if found is None and run.counters() != before:
                found = epoch - first
    after = run.counters()
    mode = run.firmware.mode.name
    if run.firmware.mode is Mode.FAULT:
        mode += f" ({Fault(int(run.firmware.ram[0]['modes']['fault'])).name})"
    elif any(run.firmware.ram[0]["sequencer"]["not_following"]):
        mode += " (axis not following)"
    return Row(
        injected,
        {name: after[name] - before[name] for name in after if after[name] != before[name]},
        found,
        mode,
        worst,
        _difference_m(run, reference),
    )


def _difference_m(run: _Run, reference: _Run) -> float:
    epoch = int(run.firmware.ram[0]["navigation"]["epoch"])
    (lat, lon), (true_lat, true_lon) = run.navigation[epoch], reference.navigation[epoch]
    east, north = east_north_m(lat, lon, true_lat, true_lon, 40.0)
    return float(np.hypot(east, north))


def rows() -> list[Row]:
    """Return the whole table."""
    reference = _Run([], modelled=False)
    for _ in reference.epochs():
        pass
    return [observe(*case, reference) for case in CASES]


_HEAD = f"""# Faults on the wire

`make docs` writes this page by putting each fault into a direct run and watching it
(`python -m host_tools.fault_table`).

A scenario puts faults in by tables `[[faults]]`, `rrins inject` puts them into a rehearsal under
way (by the message FAULT_COMMAND, so any CAN tool can). Which frames a fault with a probability
hits follows from the scenario's seed: the same in every way to run it.

```toml
[[faults]]
kind = "drop"          # drop delay duplicate reorder corrupt_wire corrupt wrong_counter
message = "SENSOR_3"   # babble silence bus_off cut; without message or node: all frames
at_s = {AT_S:.0f}             # since power-on
for_s = 5
```

```console
$ rrins inject silence --node hardware --for 0.05
$ rrins inject list
$ rrins inject clear
```

`corrupt_wire` is a bit error that the controllers' CRC-15 catches: with the wire's timing modelled
(`[bus] bitrate`) it costs an error frame and a repetition, on the ideal wire nothing. `corrupt` is
one that gets past it, for the end-to-end CRC to catch.

## What the firmware makes of them

Ideal sensors, 60 s of navigation with rotation, the fault from 20 s on; wire modelled at 1 Mbit/s
where it says so, else ideal. *Found after* counts epochs (of 5 ms) from the first one with the
fault to the first counter that moved, at either end. *Off by* is the horizontal distance, at the
end of the run or of navigation, from where the same run without the fault is. No wrong value is
ever used: what is lost is left out of the fusion, or bridged for 0.1 s at most by the increments
before.

| injected | wire | found after | counted | longest bridge | mode in the end | off by |
|---|---|---|---|---|---|---|"""


def _shown(row: Row, modelled: bool) -> str:
    after = "not noticed" if row.after_epochs is None else f"{row.after_epochs} epochs"
    counted = ", ".join(f"{name} {count}" for name, count in row.counted.items()) or "-"
    return (
        f"| {row.injected} | {'modelled' if modelled else 'ideal'} | {after} | {counted} "
        f"| {row.worst_bridged} epochs | {row.mode} | {row.difference_m * 1000:.3g} mm |"
    )


def page(table: list[Row]) -> str:
    """Return the page as Markdown."""
    lines = [_shown(row, case[2]) for row, case in zip(table, CASES, strict=True)]
    return "\n".join([_HEAD, *lines]) + "\n"


if __name__ == "__main__":
    print(page(rows()), end="")
