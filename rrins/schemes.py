"""Rotation schemes: what rotation leaves of each sensor error, and better schemes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import cached_property
from typing import TYPE_CHECKING, Literal

from rrins.host_tools.calibration.observability import LIMITS, Observability, observe
from rrins.host_tools.calibration.turning_vehicle import compare as compare_turning
from rrins.host_tools.calibration.unit import drawn_unit, unit_of
from rrins.host_tools.files import JsonObject
from rrins.host_tools.rotation.analysis import Variation, analyse
from rrins.host_tools.rotation.comparison import compared
from rrins.host_tools.rotation.enumeration import Limits
from rrins.host_tools.rotation.inputs import (
    NamedRimu,
    NamedScheme,
    rimu_of,
    rimu_table,
    scheme_of,
)
from rrins.host_tools.rotation.search import SearchResult, search
from rrins.notebook import html_of, let_figures_show

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class SchemeAnalysis:
    """Integrals of a RIMU's errors over one cycle of a scheme.

    Attributes
    ----------
    name : str
        Of the scheme.
    variation : Variation
        The running integrals of every error, as arrays.
    """

    def __init__(self, scheme: NamedScheme, rimu: NamedRimu, variation: Variation) -> None:
        self.name = scheme.name
        self.variation = variation
        self._geometry = rimu.geometry

    @cached_property
    def residuals(self) -> pd.DataFrame:
        """Mean effect of each sensor error on each axis of the body after a cycle."""
        import pandas as pd

        return pd.DataFrame([asdict(row) for row in self.variation.residual_rows()])

    def plot(self, sensor: int = 1, kind: str = "gyro") -> Figure:
        """Draw what the errors of one sensor integrate to (the paper's figures 7 and 8).

        Parameters
        ----------
        sensor : int
            From 1.
        kind : {"gyro", "accelerometer"}
        """
        from rrins.host_tools.rotation.pictures import draw

        let_figures_show()
        integrals = {"gyro": self.variation.gyros, "accelerometer": self.variation.accelerometers}
        title = f"{kind} {sensor} of the {self._geometry}, scheme {self.name}"
        return draw(self.variation, integrals[kind], sensor, title)

    def __repr__(self) -> str:
        rows = self.variation.residual_rows()
        left = sum(not row.vanishes for row in rows)
        return f"<rrins.SchemeAnalysis {self.name}: {left} of {len(rows)} residuals remain>"

    def _repr_html_(self) -> str:
        table = self.residuals[~self.residuals["vanishes"]]
        return html_of(self, table)


def analyse_scheme(
    scheme: str = "16-position",
    geometry: str | None = None,
    errors: str | None = None,
    *,
    turn_rate_dps: float | None = None,
    stand_s: float | None = None,
) -> SchemeAnalysis:
    """Return what rotation leaves of each sensor error over a cycle.

    Parameters
    ----------
    scheme : str
        Built in, or a TOML file.
    geometry : str, optional
        Of the sensors: built in, or a TOML file; the tetrahedron without it.
    errors : str, optional
        TOML file of sensor errors, or a scenario; those of the paper without it.
    turn_rate_dps, stand_s : float, optional
        In place of the scheme's own.

    Raises
    ------
    ScenarioError
        One line: which file, what is wrong.
    """
    named = scheme_of(scheme, turn_rate_dps, stand_s)
    rimu = rimu_of(geometry, errors)
    variation = analyse(named.scheme, rimu.rimu.gyros, rimu.rimu.accelerometers)
    return SchemeAnalysis(named, rimu, variation)


def search_schemes(
    limits: Limits | None = None,
    geometry: str | None = None,
    errors: str | None = None,
    *,
    reference: str = "16-position",
    top: int = 5,
) -> SearchResult:
    """Search for the best schemes of half turns under the paper's principles.

    Best: fewest errors left after the cycle, then the least horizontal velocity error within it,
    then the narrowest ranges, then the fewest reversals.

    Parameters
    ----------
    limits : Limits, optional
        What a scheme may look like (`rrins.host_tools.rotation.enumeration.Limits`); those of the
        paper's table 1 without it.
    geometry, errors
        As in `analyse_scheme`.
    reference : str
        Scheme to set beside what is found.
    top : int
        How many to return.

    Raises
    ------
    SearchError
        When no scheme keeps the limits, or too many would have to be tried.
    """
    limits = limits or Limits()
    rimu = rimu_of(geometry, errors)
    beside = scheme_of(reference, limits.turn_rate_dps, limits.stand_s)
    return search(limits, rimu.rimu, beside.scheme, top)


def compare_schemes(
    schemes: Sequence[str],
    case: Literal["cycle", "drive"] = "cycle",
    geometry: str | None = None,
    errors: str | None = None,
    *,
    turn_rate_dps: float | None = None,
    stand_s: float | None = None,
    routes: int = 4,
) -> pd.DataFrame:
    """Compare schemes: over a cycle at standstill, or in a vehicle that turns.

    Parameters
    ----------
    schemes : sequence of str
        Built in, or TOML files.
    case : {"cycle", "drive"}
        The drive is that of the paper's section 4.5.
    geometry, errors, turn_rate_dps, stand_s
        As in `analyse_scheme`.
    routes : int
        Of the drive.

    Returns
    -------
    pandas.DataFrame
        A row for each scheme. Of a cycle: what is left of each error of gyros (rad) and
        accelerometers (m/s), root of the sum of squares over sensors and axes, the largest within
        it, and the velocity error. Of the drive: σ of the position at its end, m, rms over the
        routes, of each scheme as it is and with the vehicle's heading isolated by the inner axis.

    Raises
    ------
    RehearsalError
        One line: what is wrong.
    """
    import pandas as pd

    rimu = rimu_of(geometry, errors)
    named = [scheme_of(name, turn_rate_dps, stand_s) for name in schemes]
    if case == "drive":
        pairs = [(one.name, one.scheme) for one in named]
        seeds = range(1, routes + 1)
        found = compare_turning(pairs, rimu.axes_deg, rimu.errors, seeds, lambda: None)
        rows = [one.values() for one in found]
    else:
        rows = [_compared_row(compared(one, rimu)) for one in named]
    return pd.DataFrame(rows).set_index("scheme")


def _compared_row(one: JsonObject) -> JsonObject:
    row: JsonObject = {"scheme": one["scheme"]["name"], "cycle_s": one["scheme"]["cycle_s"]}
    for kind, errors in one["errors"].items():
        for error, found in errors.items():
            row[f"{kind} {error}, left"] = found["residual"]
            row[f"{kind} {error}, largest"] = found["excursion"]
    for key in ("velocity_error_rms_mps", "velocity_error_growth_mps_per_h"):
        row[key] = one[key]
    return row


_CONSTANTS = ("bias", "scale_ppm", "asymmetric_ppm", "u_arcsec", "v_arcsec")


class SchemeObservability:
    """Observability of the sensors' constants in a cycle of a scheme, on a unit at rest.

    Attributes
    ----------
    name : str
    observability : Observability
        With `unseen`, the directions that it does not show.
    """

    def __init__(self, name: str, observability: Observability) -> None:
        self.name, self.observability = name, observability

    @cached_property
    def sigma(self) -> pd.DataFrame:
        """σ of each constant, rms over the sensors, and what is wanted; biases in °/h and µg."""
        import pandas as pd

        rows = [
            {"kind": kind, "constant": constant, "sigma": sigma, "wanted": wanted}
            for number, kind in enumerate(("gyro", "accelerometer"))
            for constant, sigma, wanted in zip(
                _CONSTANTS, self.observability.rms[number], LIMITS[number], strict=True
            )
        ]
        return pd.DataFrame(rows)

    def __repr__(self) -> str:
        unseen = len(self.observability.unseen)
        words = f"{unseen} directions unseen" if unseen else "shows all constants"
        seconds = self.observability.duration_s
        return f"<rrins.SchemeObservability {self.name}: {words}, {seconds:.0f} s>"

    def _repr_html_(self) -> str:
        return html_of(self, self.sigma, has_index=False)


def observe_scheme(
    scheme: str = "calibration",
    geometry: str | None = None,
    *,
    gyro_noise_deg_per_sqrt_h: float = 0.005,
    accelerometer_noise_ug_per_sqrt_hz: float = 10.0,
    turn_rate_dps: float | None = None,
    stand_s: float | None = None,
) -> SchemeObservability:
    """Return which constants of the sensors a cycle shows, to what standard deviation.

    Parameters
    ----------
    scheme, geometry, turn_rate_dps, stand_s
        As in `analyse_scheme`.
    gyro_noise_deg_per_sqrt_h, accelerometer_noise_ug_per_sqrt_hz : float
        White noise.

    Raises
    ------
    RehearsalError
        One line: what is wrong.
    """
    named = scheme_of(scheme, turn_rate_dps, stand_s)
    unit = unit_of(drawn_unit(1, rimu_table(geometry or "tetrahedron")))
    found = observe(
        named.scheme, unit, gyro_noise_deg_per_sqrt_h, accelerometer_noise_ug_per_sqrt_hz
    )
    return SchemeObservability(named.name, found)
