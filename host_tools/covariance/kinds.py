"""The kinds of error sources that a linear model can propagate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from rrins.compiled.record import Floats
from rrins.firmware_py.core.records.estimator_records import Aid
from rrins.host_tools.covariance.trace import Take

Effect = Literal[
    "bias", "scale", "asymmetry", "delta_u", "delta_v", "force", "warm_bias", "warm_scale"
]


@dataclass(frozen=True)
class Drawn:
    """Values that a run draws once, m of them.

    Attributes
    ----------
    name : str
    """

    name: str
    mean: Floats  #: shape (m,); sI units
    covariance: Floats  #: shape (m, m)
    #: shape (m, n): by what each of the n inputs of a campaign, over its σ, changes the values
    loading: Floats


@dataclass(frozen=True)
class Constant(Drawn):
    """A constant error of the m sensors of a kind.

    Attributes
    ----------
    kind : str
    effect : Effect
    """

    kind: str
    effect: Effect


@dataclass(frozen=True)
class Start(Drawn):
    """Errors at the beginning: of position (m), velocity (m/s); roll, pitch, heading (rad)."""


@dataclass(frozen=True)
class Crooked(Drawn):
    """An imperfection of the turntable, of one value, that tilts a given attitude."""

    periods: float  #: of the wobble in a turn


@dataclass(frozen=True)
class AidConstant(Drawn):
    """A constant error of an aid, of one value."""

    part: str  #: odometer or altimeter
    state: int  #: of the filter, among those of the part


@dataclass(frozen=True)
class Process:
    """A first-order Gauss-Markov process added to each sensor of a kind; a sum of several.

    Attributes
    ----------
    name, kind : str
    """

    name: str
    kind: str
    decay_s: tuple[float, ...]  #: time constants; infinity for a random walk
    drive: Floats  #: shape (processes, m); square root of the density of what drives each, SI units


@dataclass(frozen=True)
class White:
    """White noise of the sensors of a kind.

    Attributes
    ----------
    name, kind : str
    """

    name: str
    kind: str
    density: Floats  #: shape (m,); SI units


@dataclass(frozen=True)
class AidNoise:
    """White noise of an aid's measurements.

    Attributes
    ----------
    name : str
    """

    name: str
    aid: Aid
    variance: Callable[[Take], float]  #: of a measurement, m² or m²/s²


@dataclass(frozen=True)
class AidProcess:
    """A first-order Gauss-Markov process, or a random walk, in each component of a measurement.

    Attributes
    ----------
    name : str
    """

    name: str
    aid: Aid
    sigma: float  #: m, of the process
    decay_s: float  #: infinity for a random walk
    walk: float = 0.0  #: m/√s
