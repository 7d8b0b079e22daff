"""One case, run: its error against its bound, second by second, and what was left out."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats, Records
from rrins.firmware_py.core.records.estimator_records import EstimatorSecond
from rrins.firmware_py.core.records.integrity_records import (
    BOUNDS,
    HEADING,
    HORIZONTAL,
    VERTICAL,
    IntegrityStatus,
)
from rrins.host_tools.integrity.cases import Case
from rrins.host_tools.integrity.stanford import Counts, counts_of
from rrins.host_tools.runs.direct import run_direct, run_without_frames
from rrins.host_tools.runs.results.results import Errors, read_errors
from rrins.host_tools.runs.results.seconds_log import take_seconds
from rrins.host_tools.runs.set_up.settings import scenario_wire

_NEAR_S: Final = 0.2
"""From the end of a second to the sample of the error, at most."""

_TRUSTED: Final = (IntegrityStatus.AVAILABLE, IntegrityStatus.DEGRADED)


@dataclass(frozen=True)
class Seconds:
    """Error and bound at the end of each second; of `BOUNDS`, m, m and rad."""

    error: Floats  #: shape (n, 3)
    bound: Floats  #: shape (n, 3); infinite where there is none
    sigma: Floats  #: shape (n, 3); of the filter, horizontally along the larger of east and north
    error_over_sigma: Floats  #: shape (n, 3); horizontally the root mean square of both axes
    status: NDArray[np.int64]  #: an `IntegrityStatus`, shape (n,)

    @property
    def is_trusted(self) -> NDArray[np.bool_]:
        """Whether the unit called itself available, or degraded."""
        return np.isin(self.status, _TRUSTED)


@dataclass(frozen=True)
class Result:
    """The outcome of a case."""

    case: Case
    seconds: int
    available: int  #: seconds
    degraded: int  #: seconds
    misleading: tuple[int, ...]  #: seconds available with the error beyond each of `BOUNDS`
    doubtful: tuple[int, ...]  #: the same while degraded
    excess: float  #: largest error over bound while trusted
    level_over_sigma: tuple[float, ...]  #: median of each bound's while trusted; NaN for none
    error_over_sigma: tuple[float, ...]  #: root mean square of each error over sigma; NaN for none
    to_alert_s: float  #: longest time trusted with an error beyond an alert limit
    sound_left_out: tuple[str, ...]
    ended: str  #: reason of the firmware's FAULT, or why the case could not run; empty if neither
    counts: Counts

    @property
    def is_misleading(self) -> bool:
        """Whether an error went beyond its bound while the unit called itself available."""
        return any(self.misleading)

    def without_counts(self) -> Result:
        """Return the result without its share of the diagram, which is large."""
        return replace(self, counts=np.zeros(0, np.int64))


def no_seconds() -> Seconds:
    """Return the seconds of a run without any."""
    none = np.zeros((0, BOUNDS))
    return Seconds(none, none, none, none, np.zeros(0, np.int64))


def seconds_of(errors: Errors, estimates: Records[EstimatorSecond], rate_hz: int) -> Seconds:
    """Return what both logs of a run say of the same seconds.

    The navigation has the corrections of a second from its next epoch on, as on the bus, where its
    σ comes after that. Where a long run has no sample soon after, the one before is taken.
    """
    if not len(errors) or not len(estimates):
        return no_seconds()
    epochs, near = estimates["epoch"] + 1, _NEAR_S * rate_hz
    after = np.minimum(np.searchsorted(errors.epoch, epochs), len(errors) - 1)
    at = np.maximum(after - (errors.epoch[after] - epochs > near), 0)
    is_there = np.abs(errors.epoch[at] - epochs) <= near
    at, known = at[is_there], estimates[is_there]
    error = np.zeros((len(at), BOUNDS))
    error[:, HORIZONTAL] = np.hypot(errors.position_east_m[at], errors.position_north_m[at])
    error[:, VERTICAL] = np.abs(errors.height_m[at])
    error[:, HEADING] = np.radians(np.abs(errors.heading_deg[at]))
    bound = known["protection"].copy()
    error[bound[:, VERTICAL] == 0.0, VERTICAL] = 0.0  # the height is not the filter's
    sigma = np.zeros_like(error)
    sigma[:, HORIZONTAL] = known["position_sigma"][:, :2].max(axis=1)
    sigma[:, VERTICAL] = known["position_sigma"][:, 2]
    sigma[:, HEADING] = known["attitude_sigma"][:, 2]
    over_sigma = error / np.where(sigma > 0.0, sigma, np.inf)
    level = np.stack([errors.position_east_m[at], errors.position_north_m[at]], axis=1)
    level_sigma = known["position_sigma"][:, :2]
    level /= np.where(level_sigma > 0.0, level_sigma, np.inf)
    over_sigma[:, HORIZONTAL] = np.sqrt(np.mean(level**2, axis=1))
    return Seconds(error, bound, sigma, over_sigma, known["integrity"])


def _longest(is_set: NDArray[np.bool_]) -> int:
    """Return the length of the longest run of truth."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], is_set.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def judged(
    case: Case, seconds: Seconds, excluded: frozenset[str] = frozenset(), ended: str = ""
) -> Result:
    """Return what came of a case.

    Parameters
    ----------
    excluded : frozenset of str
        Sensors that are left out at the end, such as gyro_2.
    ended : str
        Reason of the firmware's FAULT.
    """
    settings = case.scenario.integrity
    alert = (
        settings.horizontal_alert_m,
        settings.vertical_alert_m,
        math.radians(settings.heading_alert_deg),
    )
    is_beyond = seconds.error > seconds.bound
    is_available = seconds.status == IntegrityStatus.AVAILABLE
    is_degraded = seconds.status == IntegrityStatus.DEGRADED
    is_trusted = seconds.is_trusted
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = np.where(seconds.error > 0, seconds.error / seconds.bound, 0.0)[is_trusted]
    is_silent = is_trusted & (seconds.error > np.array(alert)).any(axis=1)
    return Result(
        case,
        seconds=len(seconds.status),
        available=int(is_available.sum()),
        degraded=int(is_degraded.sum()),
        misleading=_counted(is_beyond[is_available]),
        doubtful=_counted(is_beyond[is_degraded]),
        excess=float(excess.max(initial=0.0)),
        level_over_sigma=_level_over_sigma(seconds),
        error_over_sigma=_error_over_sigma(seconds),
        to_alert_s=float(_longest(is_silent)),
        sound_left_out=tuple(sorted(excluded - case.failing)),
        ended=ended,
        counts=counts_of(seconds.error, seconds.bound),
    )


def _level_over_sigma(seconds: Seconds) -> tuple[float, ...]:
    found = []
    for k in range(BOUNDS):
        bound, sigma = seconds.bound[:, k], seconds.sigma[:, k]
        is_known = seconds.is_trusted & (sigma > 0.0) & np.isfinite(sigma) & (bound > 0.0)
        ratio = bound[is_known] / sigma[is_known]
        found.append(float(np.median(ratio)) if len(ratio) else math.nan)
    return tuple(found)


def _error_over_sigma(seconds: Seconds) -> tuple[float, ...]:
    found = []
    for k in range(BOUNDS):
        known = seconds.error_over_sigma[seconds.sigma[:, k] > 0.0, k]
        found.append(float(np.sqrt(np.mean(known**2))) if len(known) else math.nan)
    return tuple(found)


def _counted(is_beyond: NDArray[np.bool_]) -> tuple[int, ...]:
    return tuple(int(count) for count in is_beyond.sum(axis=0))


def run(case: Case, should_stop: Callable[[], bool] = lambda: False) -> Result | None:
    """Run a case; None if it is to stop."""
    scenario = case.scenario
    way = run_without_frames if scenario_wire(scenario) is None else run_direct
    with tempfile.TemporaryDirectory(prefix="rrins-") as name:
        folder = Path(name)
        outcome = way(scenario, folder, should_stop=should_stop)
        if should_stop():
            return None
        errors = read_errors(folder, scenario.rate_hz)
        estimates = take_seconds(folder).estimates
    redundancy = outcome.firmware["redundancy"] or {}
    excluded = frozenset(
        f"{kind.removesuffix('s')}_{sensor}"
        for kind, found in redundancy.items()
        for sensor in found["excluded"] or ()
    )
    fault = outcome.firmware["fault"]
    ended = "" if fault == "NONE" else f"FAULT: {fault}"
    return judged(case, seconds_of(errors, estimates, scenario.rate_hz), excluded, ended)
