"""Runs a scenario, and gives its results: numbers, datasets, pictures."""

from __future__ import annotations

import html
import io
import tempfile
from base64 import b64encode
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Unpack

from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.rounding import rounded
from rrins.host_tools.runs.display import RunDisplay
from rrins.host_tools.runs.programs.program import Program
from rrins.host_tools.runs.results.keeping import place_for
from rrins.host_tools.runs.results.summary import cells_of, lines_of
from rrins.host_tools.runs.results.summary_types import Summary
from rrins.host_tools.runs.run import BusOptions, Plan, RunResult
from rrins.host_tools.runs.run import rehearse as rehearse_plan
from rrins.host_tools.runs.run import simulate as simulate_scenario
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.terminal import new_console
from rrins.notebook import NotebookLine, is_notebook, let_figures_show
from rrins.scenarios import load_scenario

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rrins.explain import Explanation
    from rrins.host_tools.scenario.typed_keys import RunKeys, ScenarioKeys

Source = str | Path | Mapping[str, object] | Scenario
"""Name of a scenario: see `load_scenario`."""


class Run:
    """The results of a run, the same whichever way it was run.

    Attributes
    ----------
    name : str
        Of the scenario.
    scenario : Scenario
    summary : Summary
        What `rrins simulate --json` prints.
    """

    def __init__(self, result: RunResult, *, is_own: bool = False) -> None:
        self._result, self._is_own = result, is_own
        self.name = result.name
        self.scenario = result.scenario
        self.summary: Summary = result.summary

    @cached_property
    def errors(self) -> xr.Dataset:
        """Navigation minus truth.

        `position_n` (m) and `velocity_n` (m/s) over `time` (s) and `axis` (east, north, up);
        `attitude` (deg) over `time` and `angle` (roll, pitch, heading).
        """
        from rrins.datasets import errors_of

        return errors_of(self._result)

    @cached_property
    def navigation(self) -> xr.Dataset:
        """Navigation of the firmware.

        `latitude`, `longitude` (deg), `height` (m), `velocity_n` (m/s), `attitude` (deg), `mode`.
        """
        from rrins.datasets import navigation_of

        return navigation_of(self._result)

    @cached_property
    def truth(self) -> xr.Dataset:
        """Where the vehicle really was, in the variables of `navigation`."""
        from rrins.datasets import truth_of

        return truth_of(self._result)

    @cached_property
    def turntable(self) -> xr.Dataset:
        """The true `angle` (deg) over `time` and `table_axis` (inner, outer)."""
        from rrins.datasets import turntable_of

        return turntable_of(self._result)

    @cached_property
    def sigma(self) -> xr.Dataset:
        """Standard deviations of the estimator's errors, second by second.

        `position_n` (m), `velocity_n` (m/s) and `attitude_n` (deg, about each axis) over `time`
        and `axis`; a name as in `errors` is of the same quantity.

        Raises
        ------
        RehearsalError
            When the firmware has no estimator.
        """
        from rrins.datasets import sigma_of

        return sigma_of(self._result)

    @cached_property
    def estimates(self) -> xr.Dataset:
        """Estimates of the sensors' errors, second by second, and the protection levels.

        `gyro_bias` and `gyro_bias_sigma` (deg/h), `accelerometer_bias` and
        `accelerometer_bias_sigma` (ug) over `time` and `sensor`; with `[integrity]`
        `horizontal_protection`, `vertical_protection` (m) and `heading_protection` (deg).

        Raises
        ------
        RehearsalError
            When the firmware has no estimator.
        """
        from rrins.datasets import estimates_of

        return estimates_of(self._result)

    @cached_property
    def parity(self) -> xr.Dataset:
        """How the redundant sensors compare, second by second.

        For `gyro` and `accelerometer`: `gyro_ratio`, the largest parity over its threshold (an
        alarm beyond 1), `gyro_residual` and `gyro_threshold` (deg/h; ug) of each `sensor`. NaN
        where a sensor is not compared: it is left out, or too few are left.

        Raises
        ------
        RehearsalError
            When no sensors are compared.
        """
        from rrins.datasets import parity_of

        return parity_of(self._result)

    @cached_property
    def increments(self) -> xr.Dataset:
        """Increments of each sensor in each epoch from power-on, as its frames carry them.

        `gyro` (rad) and `accelerometer` (m/s) over `time`, negative before navigation, and
        `sensor`; NaN where one is absent or saturated. They are found by running the scenario
        again, which gives the same to the bit.

        Raises
        ------
        RehearsalError
            When faults or timing of the wire need frames, or a program of yours took part: see
            `open_log` for what was on the bus.
        """
        from rrins.datasets import increments_of

        if self._is_own:
            raise RehearsalError("increments: of your own program only a log knows: record=")
        return increments_of(self._result)

    @cached_property
    def events(self) -> pd.DataFrame:
        """Events in order of time: `time_s` since navigation began, `kind` and `text`.

        `kind` is `fault`, `request`, `mode`, `outage`, `alarm`, `exclusion`, `readmission` or
        `finding`.
        """
        import pandas as pd

        from rrins.host_tools.runs.results.events import Event, events_of

        found = events_of(self.scenario, self.summary, self._result.navigation)
        return pd.DataFrame(found, columns=list(Event._fields))

    def to_pandas(self) -> pd.DataFrame:
        """Return the errors as a table over `time_s`, a column each, units in the names."""
        import pandas as pd

        from rrins.host_tools.runs.results.results import columns_of

        columns = columns_of(self._result.errors)
        time_s = columns.pop("time_s")
        return pd.DataFrame(columns, index=pd.Index(time_s, name="time_s"))

    def plot_errors(self, figure: Figure | None = None) -> Figure:
        """Draw position and velocity errors and the turntable's angles over time.

        Parameters
        ----------
        figure : matplotlib.figure.Figure, optional
            To draw into; a new one without it.
        """
        from rrins.host_tools.runs.results.plots import draw_errors

        let_figures_show()
        return draw_errors(self._result.errors, self._result.title, figure)

    def plot_track(self, axes: Axes | None = None) -> Axes:
        """Draw the horizontal position error as a track seen from above.

        Parameters
        ----------
        axes : matplotlib.axes.Axes, optional
            To draw into; those of a new figure without it.
        """
        from rrins.host_tools.runs.results.plots import draw_track

        let_figures_show()
        return draw_track(self._result.errors, self._result.title, axes)

    def explain(
        self,
        t_s: float,
        *,
        by: Literal["sensor", "source"] = "sensor",
        check: bool = False,
        progress: bool | None = None,
    ) -> Explanation:
        """Return what each error source contributes to the error at an instant.

        The scenario is run again in this process, twice for each source: with it alone, and
        without it.

        Parameters
        ----------
        t_s : float
            Since navigation began, as in `errors`.
        by : str
            "sensor": each sensor's errors; "source": all sensors of a kind together, in fewer runs.
        check : bool
            Whether to compare the parts with the linear error equations, too.
        progress : bool, optional
            Whether to show progress; in a terminal or notebook by default.

        Raises
        ------
        RehearsalError
            When there is no such instant, or the scenario does not give this run again.
        """
        from rrins.explain import explain_run

        return explain_run(self._result, t_s, by, check, progress)

    def save(self, folder: str | Path) -> list[Path]:
        """Write summary, errors and pictures into a folder, as the command line does.

        Returns
        -------
        list of Path

        Raises
        ------
        RehearsalError
            When one cannot be written.
        """
        path = Path(folder)
        path.mkdir(parents=True, exist_ok=True)
        place, _ = place_for(path, self.summary)
        return self._result.write(place)

    def __repr__(self) -> str:
        end_m = self.summary["end_position_error_m"]
        end = "never navigated" if end_m is None else f"{rounded(end_m)} m off at the end"
        return f"<rrins.Run {self.name}: {self.summary['duration_s']:g} s, {end}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: table, picture, how the run went."""
        parts = [f"<b>{html.escape(self._result.title)}</b>"]
        if len(self._result.errors):
            rows = (
                "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>"
                for row in cells_of(self.summary)
            )
            parts.append(f"<table>{''.join(rows)}</table>")
        if len(self._result.errors) > 1:
            picture = io.BytesIO()
            self.plot_errors().savefig(picture, format="png")
            encoded = b64encode(picture.getvalue()).decode()
            parts.append(f'<img alt="errors over time" src="data:image/png;base64,{encoded}">')
        parts.append("<br>".join(html.escape(line) for line in lines_of(self.summary)))
        return "".join(parts)


def simulate(
    scenario: Source,
    *,
    frames: bool = False,
    progress: bool | None = None,
    **changes: Unpack[ScenarioKeys],
) -> Run:
    """Run both sides of a scenario in this process, without a bus.

    Parameters
    ----------
    scenario : str, Path, mapping or Scenario
        As in `load_scenario`.
    frames : bool
        Whether frames are passed, as on a bus, even where nothing needs them. The navigation is
        the same; it takes longer.
    progress : bool, optional
        Whether to show progress; in a terminal or notebook by default.
    **changes
        Keys of the scenario, as in `load_scenario`.

    Raises
    ------
    RehearsalError
        When the run cannot begin or come to its end. A firmware that ends in FAULT is a result.

    Examples
    --------
    >>> run = simulate("ideal", duration_s=10)
    >>> run.summary["epochs"]
    2602
    """
    loaded = load_scenario(scenario, **changes)
    with _display(loaded, progress) as display:
        result = simulate_scenario(_name_of(scenario), loaded, display, with_frames=frames)
    return _checked(result)


def rehearse(
    scenario: Source,
    *,
    speed: float | None = None,
    interface: str = "rrins",
    channel: str | None = None,
    bitrate: int | None = None,
    record: str | Path | None = None,
    progress: bool | None = None,
    program: str | None = None,
    hardware: str | None = None,
    restarts: int = 0,
    **changes: Unpack[RunKeys],
) -> Run:
    """Run a scenario as two processes on one bus.

    Parameters
    ----------
    scenario : str, Path, mapping or Scenario
        As in `load_scenario`.
    speed : float, optional
        1 is real time, another number at most that many times real time, None as fast as it goes.
    interface, channel, bitrate
        The bus, as python-can names it; without them the embedded bus on a free channel.
    record : str or Path, optional
        Log of the bus; its ending chooses the format.
    progress : bool, optional
        Whether to show progress; in a terminal or notebook by default.
    program : str, optional
        Your own navigation computer: a program, or its command line.
    hardware : str, optional
        Your own sensors and table: a program, or its command line.
    restarts : int
        How often `program` is started again when it fails.
    **changes
        Keys of the scenario, as in `load_scenario`.

    Raises
    ------
    RehearsalError
        When the run cannot begin or come to its end. A firmware that ends in FAULT is a result.
    """
    loaded = load_scenario(scenario, **changes)
    name = _name_of(scenario)
    with tempfile.TemporaryDirectory(prefix="rrins-") as folder:
        file = Path(folder) / f"{Path(name).stem}.toml"
        file.write_text(loaded.toml(), encoding="utf-8")
        plan = Plan(
            str(file),
            loaded,
            bus=BusOptions(interface, channel, bitrate),
            speed=speed,
            firmware=None if program is None else Program.parse(program),
            hardware=None if hardware is None else Program.parse(hardware),
            restarts=restarts,
        )
        with _display(loaded, progress) as display:
            path = None if record is None else Path(record)
            result = rehearse_plan(plan, display, record=path, name=name)
    return _checked(result, is_own=program is not None or hardware is not None)


def _checked(result: RunResult, *, is_own: bool = False) -> Run:
    if result.failure is not None:
        raise result.failure
    return Run(result, is_own=is_own)


def _name_of(scenario: Source) -> str:
    if isinstance(scenario, Scenario | Mapping):
        return "scenario"
    return str(scenario)


def _display(scenario: Scenario, progress: bool | None) -> RunDisplay:
    console = new_console(stderr=True)
    shown = console.is_terminal or is_notebook() if progress is None else progress
    line = NotebookLine().show if is_notebook() else None
    return RunDisplay(scenario, console, quiet=not shown, line=line)
