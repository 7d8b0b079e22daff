"""Rotation schemes: what rotation leaves of each sensor error, and better schemes."""

from __future__ import annotations

from dataclasses import asdict
from functools import cached_property
from typing import TYPE_CHECKING

from rrins.host_tools.rotation.analysis import Variation, analyse
from rrins.host_tools.rotation.enumeration import Limits
from rrins.host_tools.rotation.inputs import NamedRimu, NamedScheme, rimu_of, scheme_of
from rrins.host_tools.rotation.search import SearchResult, search
from rrins.notebook import let_figures_show

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class SchemeAnalysis:
    """What the errors of a RIMU integrate to over one cycle of a scheme.

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
        """What each error of each sensor leaves on each axis of the body after a cycle."""
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
        return f"<p>{self!r}</p>".replace("<rrins", "rrins").replace(">:", ":") + table.to_html()


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
