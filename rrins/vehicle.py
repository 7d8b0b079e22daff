"""Increments for other navigators; increments of a real vehicle as a log of the bus."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np

from rrins.host_tools.vehicle import importing, reading
from rrins.host_tools.vehicle.fused import fused_of_scenario
from rrins.host_tools.vehicle.importing import Imported
from rrins.host_tools.vehicle.navigator_files import Format, Frame, Written, write
from rrins.scenarios import load_scenario

if TYPE_CHECKING:
    from rrins.host_tools.scenario.scenario import Scenario
    from rrins.host_tools.scenario.typed_keys import RunKeys


def write_increments(
    scenario: str | Path | Mapping[str, object] | Scenario,
    folder: str | Path,
    *,
    kind: Format = "csv",
    frame: Frame = "b",
    **changes: Unpack[RunKeys],
) -> Written:
    """Run a scenario without a bus; write its fused increments and truth for other navigators.

    Parameters
    ----------
    scenario, **changes
        As in `load_scenario`.
    folder : str or Path
        Made if it is not there.
    kind : {"csv", "parquet", "pyins", "kf-gins", "psins"}
    frame : {"b", "s"}
        Axes of the body, or of the sensors.

    Returns
    -------
    Written
        Its `files`, and the number of `rows`.

    Raises
    ------
    RehearsalError
        One line: what is wrong with the scenario, or with the folder.
    """
    loaded = load_scenario(scenario, **changes)
    return write(fused_of_scenario(loaded), loaded.period_ns, Path(folder), kind, frame)


def import_recording(
    source: str | Path,
    log: str | Path,
    *,
    kind: reading.Format | None = None,
    imu: str | Path | None = None,
    gnss: str | Path | None = None,
    truth: str | Path | None = None,
    scenario: str | Path | None = None,
    start_s: float | None = None,
    duration_s: float | None = None,
    attitude_deg: Sequence[float] | None = None,
) -> Imported:
    """Make the recording of a real vehicle a log of the bus, for `replay` and `open_log`.

    Parameters
    ----------
    source : str or Path
        Folder or file: CSV as `write_increments` makes it, a configuration of KF-GINS, or .mat
        structures of NaveGo.
    log : str or Path
        Its suffix selects the format.
    kind : {"csv", "kf-gins", "navego"}, optional
        Format of `source`; found out without it.
    imu, gnss, truth : str or Path, optional
        Files in place of those found in the folder.
    scenario : str or Path, optional
        TOML file with keys of a scenario, on top of what the recording says.
    start_s, duration_s : float, optional
        When navigation begins, by the recording's clock, where the vehicle must stand; how long.
    attitude_deg : sequence of float, shape (3,), optional
        Roll, pitch, heading at the beginning.

    Returns
    -------
    Imported
        Its `file`, `scenario`, number of `fixes`, and `notes`.

    Raises
    ------
    RehearsalError
        One line: which file, what is wrong.
    """
    paths = [None if path is None else Path(path) for path in (imu, gnss, truth, scenario)]
    attitude = None if attitude_deg is None else np.radians(attitude_deg)
    recording = reading.read(Path(source), kind, *paths[:3])
    return importing.write(recording, Path(log), paths[3], start_s, duration_s, attitude)
