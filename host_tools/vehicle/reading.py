"""Finds out what a path holds, and reads it."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from rrins.host_tools.vehicle import csv_folder, kf_gins, navego
from rrins.host_tools.vehicle.checks import located
from rrins.host_tools.vehicle.recording import VehicleRecording

Format = Literal["csv", "kf-gins", "navego"]

_YAML = (".yaml", ".yml")
_BY_SUFFIX: dict[str, Format] = {".mat": "navego", ".csv": "csv", ".txt": "kf-gins"}


def format_of(source: Path) -> Format:
    """Return the format of a file or folder.

    Raises
    ------
    VehicleError
        If nobody knows.
    """
    if source.is_dir():
        if (source / csv_folder.INCREMENTS).is_file():
            return "csv"
        if any(next(source.glob(f"*{suffix}"), None) for suffix in _YAML):
            return "kf-gins"
        if next(source.glob("*.mat"), None) is not None:
            return "navego"
        if (source / "imu.txt").is_file():
            return "kf-gins"
        raise located(
            source,
            f"neither {csv_folder.INCREMENTS} (CSV), nor a .yaml or imu.txt (KF-GINS), nor a .mat "
            "file (NaveGo) in it",
        )
    if not source.is_file():
        raise located(source, "no such file or folder")
    if source.suffix.lower() in _YAML:
        return "kf-gins"
    found = _BY_SUFFIX.get(source.suffix.lower())
    if found is None:
        raise located(source, "its format is not known by its suffix; name it with --format")
    return found


def read(
    source: Path,
    kind: Format | None = None,
    imu: Path | None = None,
    gnss: Path | None = None,
    truth: Path | None = None,
) -> VehicleRecording:
    """Return the recording of a vehicle in a file or folder.

    Parameters
    ----------
    source : Path
    kind : str, optional
        Its format; found out by default.
    imu, gnss, truth : Path, optional
        Files that take the place of those found in the folder.

    Raises
    ------
    VehicleError
        If something cannot be read, is missing or ambiguous, or is not a recording of a vehicle.
    """
    kind = kind or format_of(source)
    if kind == "navego":
        return navego.read(source, imu, gnss, truth)
    if kind == "csv":
        folder = source if source.is_dir() else source.parent
        device = imu or (folder / csv_folder.INCREMENTS if source.is_dir() else source)
        return csv_folder.read(
            device,
            gnss or _if_there(folder / csv_folder.GNSS),
            truth or _if_there(folder / csv_folder.TRUTH),
        )
    configuration = _configuration_in(source)
    if configuration is not None and imu is None and gnss is None:
        return kf_gins.read_configuration(configuration, truth)
    folder = source if source.is_dir() else source.parent
    return kf_gins.read_files(
        imu or (folder / "imu.txt" if source.is_dir() else source),
        gnss or _if_there(folder / "gnss.txt"),
        truth or _if_there(folder / "truth.nav"),
    )


def _if_there(path: Path) -> Path | None:
    return path if path.is_file() else None


def _configuration_in(source: Path) -> Path | None:
    """Return the configuration of KF-GINS that a path is, or that a folder has."""
    if source.is_file():
        return source if source.suffix.lower() in _YAML else None
    found = sorted(path for suffix in _YAML for path in source.glob(f"*{suffix}"))
    if len(found) > 1:
        names = ", ".join(path.name for path in found)
        raise located(source, f"several configurations: {names}; name one")
    return found[0] if found else None
