"""Sensitivity to the inputs: linear shares of the variance, and Sobol's indices.

A linear share of an input is ``b cov(x, y) / var(y)``, with b its coefficient in the regression of
the output on all inputs; for independent inputs the square of the standardised coefficient. What
the regression leaves is noise, what the sensors draw at power-up, and whatever is not linear.
Shares are corrected for the number of inputs as R² is (adjusted R²). They are for signed outputs: a
distance is not linear in anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.campaigns.engines import missing
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.row import OK
from rrins.host_tools.campaigns.statistics import Estimate, drawn, rows_of_blocks
from rrins.host_tools.campaigns.store import Store

LINEAR_OUTPUTS: Final = ("position_east_m", "position_north_m")
REST: Final = "noise, power-up, not linear"
NOISE: Final = "noise and power-up"
_RESAMPLES = 200
_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Share:
    """The share that a key has in the variance of an output."""

    name: str  #: key of the scenario, all of its sensors together; `REST`
    share: Estimate
    sigma: float  #: what it alone would give, in the unit of the output


def linear_shares(store: Store, output: str) -> list[Share]:
    """Return the linear shares of all keys in an output, the largest first, what is left last.

    Empty where there are too few runs, or nothing varies.

    Raises
    ------
    CampaignError
    """
    inputs = [one for one in store.definition.plan.inputs if one.distribution.is_numeric]
    table = store.table(["status", output, *(one.column for one in inputs)])
    runs = table["run"].to_numpy().astype(np.int64)
    is_ok = np.array([status == OK for status in table["status"].to_pylist()], bool)
    y = table[output].to_numpy().astype(float)[is_ok]
    X = np.array([table[one.column].to_numpy() for one in inputs], float).reshape(len(inputs), -1).T
    if not len(inputs):
        return []
    X = X[is_ok]
    varies = X.std(axis=0) > 0 if len(X) else np.zeros(len(inputs), bool)
    keys = [one.key for one, does in zip(inputs, varies, strict=True) if does]
    X = X[:, varies]
    if len(y) < 2 * X.shape[1] + 10 or not keys or y.std() == 0:
        return []
    names = list(dict.fromkeys(keys))
    members = np.array([[key == name for key in keys] for name in names], float)
    shares = _shares(X, y, members)
    rng = np.random.default_rng([0, len(y)])
    rows = rows_of_blocks(runs[is_ok] // store.definition.plan.block)
    picked = (rng.integers(len(rows), size=len(rows)) for _ in range(_RESAMPLES))
    resampled = np.array(
        [_shares(X[at], y[at], members) for at in (drawn(rows, k) for k in picked)]
    )
    tail = 50.0 * (1.0 - _CONFIDENCE)
    low, high = np.percentile(resampled, (tail, 100.0 - tail), axis=0)
    deviation = float(y.std(ddof=1))
    found = [
        Share(
            name,
            Estimate(float(shares[k]), float(low[k]), float(high[k])),
            deviation * float(np.sqrt(max(shares[k], 0.0))),
        )
        for k, name in enumerate([*names, REST])
    ]
    return [*sorted(found[:-1], key=lambda one: -one.share.value), found[-1]]


def _shares(X: Floats, y: Floats, members: Floats) -> Floats:
    """Return the share of each group of inputs, and what is left, shape (groups + 1,)."""
    count, inputs = X.shape
    x, z = X - X.mean(axis=0), y - y.mean()
    b = np.linalg.lstsq(x, z, rcond=None)[0]
    parts = b * (x.T @ z) / max(float(z @ z), 1e-300)
    explained = float(parts.sum())
    rest = min(1.0, (1.0 - explained) * (count - 1) / max(count - inputs - 1, 1))
    scale = (1.0 - rest) / explained if explained > 0 else 0.0
    return np.concatenate([members @ parts * scale, [rest]])


@dataclass(frozen=True)
class Index:
    """Sobol's indices of an input.

    Attributes
    ----------
    first, total : Estimate
        Share of the variance that it alone explains, and with all its interactions.
    """

    name: str  #: column of the input; `NOISE`
    first: Estimate
    total: Estimate


def sobol_indices(store: Store, output: str) -> list[Index]:
    """Return Sobol's indices of a campaign of design `saltelli`, the largest total first.

    Raises
    ------
    CampaignError
        When SALib is missing, the design is another one, or blocks are too few.
    """
    plan = store.definition.plan
    if plan.design != "saltelli":
        raise CampaignError(f"Sobol's indices: need design saltelli, not {plan.design}")
    try:
        sobol: Any = import_module("SALib.analyze.sobol")
    except ImportError as error:
        raise missing("SALib", "campaign") from error
    names = [one.column for one in plan.inputs] + [NOISE]
    values = store.values(output)
    blocks = [
        [values.get(run, np.nan) for run in range(first, first + plan.block)]
        for first in range(0, store.definition.runs, plan.block)
    ]
    whole = np.array([block for block in blocks if np.isfinite(block).all()])
    if len(whole) < 8 or whole.std() == 0:
        raise CampaignError(f"Sobol's indices: {len(whole)} whole blocks of runs are too few")
    problem = {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}
    found = sobol.analyze(
        problem, whole.ravel(), calc_second_order=False, conf_level=_CONFIDENCE, seed=0
    )
    indices = [
        Index(
            name,
            _around(found["S1"][k], found["S1_conf"][k]),
            _around(found["ST"][k], found["ST_conf"][k]),
        )
        for k, name in enumerate(names)
    ]
    return sorted(indices, key=lambda one: -one.total.value)


def _around(value: float, half: float) -> Estimate:
    return Estimate(float(value), float(value - half), float(value + half))
