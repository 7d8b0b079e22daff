"""Calibration of a unit on its own table, from Python."""

from __future__ import annotations

import shutil
import tempfile
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from rrins.host_tools.calibration.procedure import Calibrated, Order
from rrins.host_tools.calibration.procedure import calibrate as calibrate_unit
from rrins.host_tools.calibration.report import result_of
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.files import JsonObject, make_folder
from rrins.notebook import html_of, let_figures_show

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_KINDS = ("gyros", "accelerometers")


class UnitCalibration:
    """The constants of a unit's sensors, each with its σ.

    Attributes
    ----------
    file : Path
        Calibration file, for `calibration` of a scenario.
    report : Path
        Page with all that was found.
    verified : str
        What a second run in the unit said, where the calibration was pushed.
    """

    def __init__(
        self, done: Calibrated, kept: tempfile.TemporaryDirectory[str] | None = None
    ) -> None:
        self._done, self._kept = done, kept
        self.report, _, self.file = done.files
        self.verified = done.verified

    @property
    def values(self) -> JsonObject:
        """Values and σ by the keys of the calibration file."""
        return result_of(self._done.estimate)

    @cached_property
    def constants(self) -> pd.DataFrame:
        """A row for each constant of each sensor: `value`, `sigma`; units stand in its key."""
        import pandas as pd

        rows = [
            {"kind": kind, "constant": key, "sensor": k + 1, "value": value, "sigma": sigma}
            for kind in _KINDS
            for key, found in self.values[kind].items()
            if isinstance(found, dict)
            for k, (value, sigma) in enumerate(zip(found["value"], found["sigma"], strict=True))
        ]
        return pd.DataFrame(rows)

    def save(self, folder: str | Path) -> list[Path]:
        """Write report, picture and calibration file into a folder; return their paths.

        Raises
        ------
        RehearsalError
            When one cannot be written.
        """
        place = Path(folder)
        make_folder(place)
        try:
            return [Path(shutil.copy(path, place)) for path in self._done.files]
        except OSError as error:
            raise RehearsalError(f"{place}: cannot be written: {error.strerror}") from error

    def plot(self) -> Figure:
        """Draw the residuals of every sensor before and after."""
        from rrins.host_tools.calibration.pictures import residuals_figure

        let_figures_show()
        return residuals_figure(self._done.estimate)

    def __repr__(self) -> str:
        seconds = self._done.estimate.seconds.total_s
        return f"<rrins.UnitCalibration {self.file}: {seconds:.0f} s on the table>"

    def _repr_html_(self) -> str:
        return html_of(self, self.constants, has_index=False)


def calibrate(
    scenario: str | Path | None = None,
    folder: str | Path | None = None,
    *,
    interface: str = "rrins",
    channel: str | None = None,
    bitrate: int | None = None,
    geometry: str | Path | None = None,
    scheme: str | Path = "calibration",
    turn_rate_dps: float | None = None,
    stand_s: float | None = None,
    seed: int = 1,
    push: bool = False,
    anew: bool = False,
    temperature_c: float | None = None,
    timeout_s: float | None = None,
) -> UnitCalibration:
    """Calibrate the sensors of a unit on its own table: all constants, with their uncertainty.

    Parameters
    ----------
    scenario : str or Path, optional
        Whose unit; an emulated one with the prototype's noise and drawn errors without it.
    folder : str or Path, optional
        For the calibration file and the report; a calibration that was stopped goes on from there.
        Without it they are in a temporary folder, until the result is gone or saved.
    interface, channel, bitrate
        Bus of a unit that is there, which must stand still; without a channel one is emulated.
    geometry : str or Path, optional
        Of the sensors, without a scenario: built in, or a TOML file.
    scheme : str or Path
        Built in, or a TOML file.
    turn_rate_dps, stand_s : float, optional
        In place of the scheme's own.
    seed : int
        Of the errors that are drawn.
    push : bool
        Whether to store the calibration in the unit, and to verify it there.
    anew : bool
        Whether to begin anew where a calibration was stopped.
    temperature_c : float, optional
        How warm the sensors are, °C; stored with the calibration.
    timeout_s : float, optional
        Longest wait for a response of a unit on a slow bus; 2 s by default.

    Raises
    ------
    RehearsalError
        One line: what went wrong. The unit then has its old calibration.
    """
    kept = None
    if folder is None:
        kept = tempfile.TemporaryDirectory(prefix="rrins-")
        folder = kept.name
    order = Order(
        Path(folder),
        None if scenario is None else str(scenario),
        interface,
        channel,
        bitrate,
        None if geometry is None else str(geometry),
        str(scheme),
        turn_rate_dps,
        stand_s,
        seed,
        push,
        anew,
        temperature_c,
        timeout_s,
    )
    return UnitCalibration(calibrate_unit(order), kept)
