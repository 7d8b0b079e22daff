"""The table: what becomes of failures, by mode, part and phase, weighted by their rates."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from rrins.host_tools.campaigns.statistics import Estimate, weighted_proportion
from rrins.host_tools.files import JsonObject
from rrins.host_tools.integrity.fmeda.rates import Rates
from rrins.host_tools.integrity.fmeda.trials import Finding
from rrins.host_tools.integrity.phases import PHASES
from rrins.host_tools.rounding import kept

SHARES: Final[dict[str, Callable[[Finding], bool]]] = {
    "detected": lambda one: math.isfinite(one.detected_s),
    "isolated": lambda one: math.isfinite(one.isolated_s) and not one.wrong_sensors,
    "wrong_sensor": lambda one: bool(one.wrong_sensors),
    "aid_refused": lambda one: len(one.wrong) > len(one.wrong_sensors),
    "latent": lambda one: one.is_latent,
    "dangerous": lambda one: one.is_dangerous,
    "dangerous_undetected": lambda one: one.is_unnoticed_danger,
}
"""Of the failures; the first is the diagnostic coverage."""

HALF, MOST = 0.5, 0.95


@dataclass(frozen=True)
class Cell:
    """A mode of a part in a phase."""

    mode: str
    part: str
    phase: str


@dataclass(frozen=True)
class Row:
    """Some failures and their consequences, weighted by rate and phase."""

    cells: dict[Cell, list[Finding]]
    weights: dict[Cell, float]  #: failures in 1e9 h

    @property
    def findings(self) -> list[Finding]:
        """All runs."""
        return [one for found in self.cells.values() for one in found]

    @property
    def fit(self) -> float:
        """Failures in 1e9 h."""
        return sum(self.weights[cell] for cell in self.cells)

    @cached_property
    def shares(self) -> dict[str, Estimate]:
        """Share of the failures, of each of `SHARES`."""
        of = np.array([float(len(found)) for found in self.cells.values()])
        weights = np.array([self.weights[cell] for cell in self.cells])
        return {
            name: weighted_proportion(
                np.array([float(sum(map(holds, found))) for found in self.cells.values()]),
                of,
                weights if weights.sum() > 0 else np.ones(len(of)),
            )
            for name, holds in SHARES.items()
        }

    def quantile(self, value: Callable[[Finding], float], share: float) -> float:
        """Return the value that a share of the failures does not exceed; infinity for never."""
        pairs = [
            (value(one), self.weights[cell] / len(found))
            for cell, found in self.cells.items()
            for one in found
        ]
        pairs.sort()
        total = np.cumsum([weight for _, weight in pairs])
        if not len(total) or total[-1] <= 0:
            total = np.arange(1.0, len(pairs) + 1.0)
        at = int(np.searchsorted(total, share * total[-1] * (1 - 1e-12)))
        return pairs[min(at, len(pairs) - 1)][0]

    @property
    def worst(self) -> Finding:
        """The run that is to be looked at first."""
        return max(self.findings, key=lambda one: (one.is_unnoticed_danger, one.effect_m))

    def rates_fit(self) -> dict[str, float]:
        """Return the rates of safe, dangerous detected and dangerous undetected failures."""
        shares = {name: self.shares[name].value for name in ("dangerous", "dangerous_undetected")}
        undetected = self.fit * shares["dangerous_undetected"]
        return {
            "safe": self.fit * (1.0 - shares["dangerous"]),
            "dangerous_detected": self.fit * shares["dangerous"] - undetected,
            "dangerous_undetected": undetected,
        }

    def values(self) -> JsonObject:
        """Return all figures as plain values; null for never."""
        delays = {
            f"{name}_s": {
                "half": kept(self.quantile(value, HALF)),
                "95_percent": kept(self.quantile(value, MOST)),
            }
            for name, value in DELAYS.items()
        }
        worst = self.worst
        return {
            "fit": kept(self.fit),
            "runs": len(self.findings),
            "shares": {name: share.values() for name, share in self.shares.items()},
            **delays,
            "effect_m": {
                "half": kept(self.quantile(lambda one: one.effect_m, HALF)),
                "largest": kept(max(one.effect_m for one in self.findings)),
            },
            "rates_fit": {name: kept(value) for name, value in self.rates_fit().items()},
            "worst": {
                "mode": worst.trial.mode.name,
                "part": worst.trial.part,
                "phase": worst.trial.phase,
                "seed": worst.trial.seed,
                "value": worst.trial.value,
                "error_m": kept(worst.error_m),
            },
        }


DELAYS: Final[dict[str, Callable[[Finding], float]]] = {
    "detected": lambda one: one.detected_s,
    "isolated": lambda one: one.isolated_s,
}
"""Times since the failure."""


class Table:
    """The FMEDA of a unit.

    Parameters
    ----------
    rates : Rates
    findings : sequence of Finding
        One at least.
    """

    def __init__(self, rates: Rates, findings: Sequence[Finding]) -> None:
        cells: dict[Cell, list[Finding]] = {}
        fits: dict[Cell, float] = {}
        for one in findings:
            trial = one.trial
            cell = Cell(trial.mode.name, trial.part, trial.phase)
            cells.setdefault(cell, []).append(one)
            fits[cell] = trial.mode.fit
        self.phases = [name for name in PHASES if any(cell.phase == name for cell in cells)]
        total = sum(rates.phases[name] for name in self.phases)
        share = {
            name: rates.phases[name] / total if total > 0 else 1.0 / len(self.phases)
            for name in self.phases
        }
        weights = {cell: fit * share[cell.phase] for cell, fit in fits.items()}
        self.cells = {cell: Row({cell: found}, weights) for cell, found in cells.items()}
        self.unit = Row(cells, weights)

    def by(self, key: Callable[[Cell], str]) -> dict[str, Row]:
        """Return rows of the cells that are alike, in order."""
        groups: dict[str, dict[Cell, list[Finding]]] = {}
        for cell, found in self.unit.cells.items():
            groups.setdefault(key(cell), {})[cell] = found
        return {name: Row(cells, self.unit.weights) for name, cells in groups.items()}

    @property
    def by_mode(self) -> dict[str, Row]:
        """Rows of the modes, all parts and phases."""
        return self.by(lambda cell: cell.mode)

    @property
    def by_part(self) -> dict[str, Row]:
        """Rows of the parts, all modes and phases."""
        return self.by(lambda cell: cell.part)

    @property
    def by_phase(self) -> dict[str, Row]:
        """Rows of the phases; their rate is that of the whole unit times the share of time."""
        return self.by(lambda cell: cell.phase)

    def values(self) -> JsonObject:
        """Return all figures as plain values."""
        return {
            "unit": self.unit.values(),
            "parts": _values(self.by_part.items()),
            "modes": _values(self.by_mode.items()),
            "phases": _values(self.by_phase.items()),
            "cells": [
                {"mode": cell.mode, "part": cell.part, "phase": cell.phase} | row.values()
                for cell, row in self.cells.items()
            ],
        }

    def csv_rows(self) -> list[dict[str, object]]:
        """Return a flat row for each cell."""
        return [_flat(cell, row) for cell, row in self.cells.items()]


def _values(rows: Iterable[tuple[str, Row]]) -> JsonObject:
    return {name: row.values() for name, row in rows}


def _flat(cell: Cell, row: Row) -> dict[str, object]:
    values = row.values()
    flat: dict[str, object] = {"mode": cell.mode, "part": cell.part, "phase": cell.phase}
    flat |= {"fit": row.worst.trial.mode.fit, "runs": values["runs"]}
    for name, share in values["shares"].items():
        flat |= {name: share["value"], f"{name}_low": share["low"], f"{name}_high": share["high"]}
    for name in DELAYS:
        pair = values[f"{name}_s"]
        flat |= {f"{name}_median_s": pair["half"], f"{name}_95_s": pair["95_percent"]}
    flat |= {f"effect_{name}_m": value for name, value in values["effect_m"].items()}
    worst = values["worst"]
    flat |= {f"worst_{key}": worst[key] for key in ("seed", "value", "error_m")}
    return flat
