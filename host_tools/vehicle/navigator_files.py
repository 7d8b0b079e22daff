"""Fused increments, truth and navigation as files that other navigators read.

========  =================================================================================
format    files
========  =================================================================================
csv       increments, truth and navigation, in the frames and signs of this project
parquet   the same
pyins     imu.csv, trajectory.csv: data frames as `pyins.strapdown` and `pyins.sim` have them
kf-gins   imu.txt, truth.nav: text as KF-GINS' README defines it
psins     trj.mat: the struct `trj` that PSINS' `trjfile` loads
========  =================================================================================

The first row is the sample before navigation; its state is the initial one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from rrins.compiled.record import Floats, Integers, Records
from rrins.firmware_py.core.records.memory import NavigationOutput
from rrins.host_tools.errors import FirmwareFaultError, RehearsalError
from rrins.host_tools.files import replacing
from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.vehicle.body_increments import Derotator
from rrins.host_tools.vehicle.fused import FusedTrack, without_gaps

Format = Literal["csv", "parquet", "pyins", "kf-gins", "psins"]
Frame = Literal["b", "s"]
TABLES: Final = ("csv", "parquet")
"""Formats that have columns for the angles of the table, and so can hold increments of s."""

Columns = Mapping[str, NDArray[np.float64] | NDArray[np.int64] | NDArray[np.bool_]]


@dataclass(frozen=True)
class States:
    """Position, velocity and attitude of the body, a row per epoch.

    `velocity_n` (m/s) is east, north, up; `attitude_deg` roll, pitch, heading, which are the same
    angles in right-forward-up and east-north-up as in forward-right-down and north-east-down.
    """

    latitude_deg: Floats
    longitude_deg: Floats
    height_m: Floats
    velocity_n: Floats
    attitude_deg: Floats

    @classmethod
    def of(cls, records: Records[NavigationOutput] | Records[Truth]) -> States:
        """Return the states in records of navigation or truth."""
        angles = np.column_stack([records[name] for name in ("roll", "pitch", "heading")])
        return cls(
            np.degrees(records["latitude"]),
            np.degrees(records["longitude"]),
            np.array(records["height"]),
            np.array(records["velocity_n"]),
            np.degrees(angles),
        )

    @property
    def velocity_ned(self) -> Floats:
        """Velocity north, east, down, m/s."""
        return forward_right_down(self.velocity_n)


@dataclass(frozen=True)
class Piece:
    """Some epochs as they are written; `dtheta` (rad) and `dv` (m/s) in axes of the frame."""

    frame: Frame
    epoch: Integers
    time_s: Floats
    bridged: NDArray[np.bool_]
    dtheta: Floats
    dv: Floats
    inner_deg: Floats
    outer_deg: Floats
    navigation: States
    truth: States | None


def forward_right_down(vectors: Floats) -> Floats:
    """Return vectors (n, 3) of right-forward-up, or of n, in axes forward (north), right, down."""
    return np.column_stack([vectors[:, 1], vectors[:, 0], -vectors[:, 2]])


def _vector(name: str, values: Floats, unit: str) -> dict[str, Floats]:
    return {f"{name}_{axis}_{unit}": values[:, k] for k, axis in enumerate("xyz")}


def _increments(piece: Piece) -> Columns:
    columns: dict[str, NDArray[np.float64] | NDArray[np.int64] | NDArray[np.bool_]] = {
        "epoch": piece.epoch,
        "time_s": piece.time_s,
        **_vector(f"dtheta_{piece.frame}", piece.dtheta, "rad"),
        **_vector(f"dv_{piece.frame}", piece.dv, "mps"),
        "bridged": piece.bridged,
    }
    if piece.frame == "s":
        columns |= {"inner_deg": piece.inner_deg, "outer_deg": piece.outer_deg}
    return columns


def _states(piece: Piece, states: States) -> Columns:
    names = ("east", "north", "up")
    angles = ("roll", "pitch", "heading")
    return {
        "epoch": piece.epoch,
        "time_s": piece.time_s,
        "latitude_deg": states.latitude_deg,
        "longitude_deg": states.longitude_deg,
        "height_m": states.height_m,
        **{f"velocity_{n}_mps": states.velocity_n[:, k] for k, n in enumerate(names)},
        **{f"{n}_deg": states.attitude_deg[:, k] for k, n in enumerate(angles)},
    }


def _pyins_imu(piece: Piece) -> Columns:
    dtheta, dv = forward_right_down(piece.dtheta), forward_right_down(piece.dv)
    return {
        "time": piece.time_s,
        **{f"gyro_{axis}": dtheta[:, k] for k, axis in enumerate("xyz")},
        **{f"accel_{axis}": dv[:, k] for k, axis in enumerate("xyz")},
    }


def _pyins_trajectory(piece: Piece, states: States) -> Columns:
    return {
        "time": piece.time_s,
        "lat": states.latitude_deg,
        "lon": states.longitude_deg,
        "alt": states.height_m,
        **{name: states.velocity_ned[:, k] for k, name in enumerate(("VN", "VE", "VD"))},
        **{name: states.attitude_deg[:, k] for k, name in enumerate(("roll", "pitch", "heading"))},
    }


def _kf_gins_imu(piece: Piece) -> Columns:
    rows = [piece.time_s[:, None], forward_right_down(piece.dtheta), forward_right_down(piece.dv)]
    return {str(k): column for k, column in enumerate(np.hstack(rows).T)}


def _kf_gins_states(piece: Piece, states: States) -> Columns:
    columns = (
        np.zeros_like(piece.time_s),  # week: time counts from the hardware's power-on
        piece.time_s,
        states.latitude_deg,
        states.longitude_deg,
        states.height_m,
        *states.velocity_ned.T,
        *states.attitude_deg.T,
    )
    return {str(k): column for k, column in enumerate(columns)}


class _Writer(Protocol):
    def add(self, piece: Piece) -> None:
        """Add some epochs."""

    def close(self) -> None:
        """Finish the files."""


class _ColumnFile:
    """A file of columns that is written piece by piece."""

    def __init__(self, path: Path, ending: str, columns: Callable[[Piece], Columns]) -> None:
        self._path, self._ending, self._columns = path, ending, columns
        self._writer: pa.csv.CSVWriter | pa.parquet.ParquetWriter | None = None

    def _open(self, schema: pa.Schema) -> pa.csv.CSVWriter | pa.parquet.ParquetWriter:
        if self._ending == ".parquet":
            return pa.parquet.ParquetWriter(str(self._path), schema)
        if self._ending == ".csv":
            options = pa.csv.WriteOptions(quoting_style="none")
        else:
            options = pa.csv.WriteOptions(include_header=False, delimiter=" ", quoting_style="none")
        return pa.csv.CSVWriter(str(self._path), schema, write_options=options)

    def add(self, piece: Piece) -> None:
        """Add some epochs."""
        table = pa.table(
            {name: np.ascontiguousarray(v) for name, v in self._columns(piece).items()}
        )
        if self._writer is None:
            self._writer = self._open(table.schema)
        self._writer.write_table(table)

    def close(self) -> None:
        """Finish the file."""
        if self._writer is not None:
            self._writer.close()


class _PsinsFile:
    """`trj` of PSINS: all rows at once, for a .mat file holds whole arrays."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._imu: list[Floats] = []
        self._navigation: list[Floats] = []
        self._truth: list[Floats] = []

    def add(self, piece: Piece) -> None:
        """Keep some epochs."""
        self._imu.append(np.column_stack([piece.dtheta, piece.dv, piece.time_s]))
        self._navigation.append(self._avp(piece.time_s, piece.navigation))
        if piece.truth is not None:
            self._truth.append(self._avp(piece.time_s, piece.truth))

    @staticmethod
    def _avp(time_s: Floats, states: States) -> Floats:
        roll, pitch, heading = np.radians(states.attitude_deg).T
        yaw = -((heading + np.pi) % (2 * np.pi) - np.pi)  # from north to the west
        place = np.radians(states.latitude_deg), np.radians(states.longitude_deg)
        return np.column_stack(
            [pitch, roll, yaw, states.velocity_n, *place, states.height_m, time_s]
        )

    def close(self) -> None:
        """Write the file."""
        from scipy.io import savemat

        imu, navigation = np.vstack(self._imu), np.vstack(self._navigation)
        truth = np.vstack(self._truth) if self._truth else np.zeros((0, 10))
        initial = truth if self._truth else navigation
        trj = {
            "imu": imu[1:],  # a row is of [t - ts, t]
            "avp": truth[1:],
            "avp0": initial[0, :9, None],
            "ts": float(imu[1, 6] - imu[0, 6]) if len(imu) > 1 else 0.0,
            "navigation": navigation[1:],
        }
        with self._path.open("wb") as file:
            savemat(file, {"trj": trj})


_StatesOf = Callable[[Piece, States], Columns]
_TEXTS: Final[dict[str, tuple[str, str, str, Callable[[Piece], Columns], _StatesOf]]] = {
    "csv": ("increments.csv", "truth.csv", "navigation.csv", _increments, _states),
    "parquet": ("increments.parquet", "truth.parquet", "navigation.parquet", _increments, _states),
    "pyins": ("imu.csv", "trajectory.csv", "navigation.csv", _pyins_imu, _pyins_trajectory),
    "kf-gins": ("imu.txt", "truth.nav", "navigation.nav", _kf_gins_imu, _kf_gins_states),
}
"""By format: increments, truth and navigation; columns of increments and of states."""


def _opened(
    stack: ExitStack, folder: Path, kind: Format, has_truth: bool
) -> tuple[list[_Writer], list[Path]]:
    """Return the writers of a format, and the paths that they come to."""

    def part_of(name: str) -> Path:
        paths.append(folder / name)
        return stack.enter_context(replacing(paths[-1]))

    paths: list[Path] = []
    if kind == "psins":
        return [_PsinsFile(part_of("trj.mat"))], paths
    increments, truth, navigation, columns, states = _TEXTS[kind]

    def of_truth(piece: Piece) -> Columns:
        assert piece.truth is not None
        return states(piece, piece.truth)

    def of_navigation(piece: Piece) -> Columns:
        return states(piece, piece.navigation)

    files = [(increments, columns), (navigation, of_navigation)]
    if has_truth:
        files.insert(1, (truth, of_truth))
    return [_ColumnFile(part_of(name), Path(name).suffix, of) for name, of in files], paths


def _pieces(tracks: Iterable[FusedTrack], period_ns: int, frame: Frame) -> Iterator[Piece]:
    derotator = Derotator()
    for track in tracks:
        rows = track.increments
        if frame == "b":
            dtheta, dv = derotator.of_body(rows)
        else:
            dtheta, dv = np.array(rows["dtheta_s"]), np.array(rows["dv_s"])
        yield Piece(
            frame,
            np.array(rows["epoch"]),
            rows["epoch"] * (period_ns * 1e-9),
            np.array(rows["bridged"]),
            dtheta,
            dv,
            np.array(rows["inner_deg"]),
            np.array(rows["outer_deg"]),
            States.of(track.navigation),
            None if track.truth is None else States.of(track.truth),
        )


@dataclass(frozen=True)
class Written:
    """Written increments: `rows`, of which some are `bridged`, in `files`.

    `begins_s` and `ends_s` are times of the first and the last row since the hardware's power-on.
    """

    files: list[Path]
    rows: int
    bridged: int
    has_truth: bool
    begins_s: float
    ends_s: float


def write(
    tracks: Iterable[FusedTrack],
    period_ns: int,
    folder: Path,
    kind: Format = "csv",
    frame: Frame = "b",
    on_rows: Callable[[int], None] = lambda rows: None,
) -> Written:
    """Write fused increments, with truth and navigation, for other navigators.

    Up to the first epoch that is missing: what follows a gap has another beginning.

    Parameters
    ----------
    tracks : iterable of FusedTrack
    period_ns : int
        Length of an epoch.
    folder : Path
        Made if it is not there.
    kind : Format
    frame : Frame
        ``b`` for the body's axes, with the table's turning removed by its encoders; ``s`` for the
        sensors' own, with the encoders' angles, in tables only.
    on_rows : callable
        Called with the rows written so far.

    Raises
    ------
    RehearsalError
        When a file cannot be written.
    FirmwareFaultError
        When the firmware never navigated.
    """
    if frame == "s" and kind not in TABLES:
        raise RehearsalError(f"--frame s: {kind} knows no table; use --format csv or parquet")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RehearsalError(f"{folder}: cannot be made: {error.strerror}") from error
    pieces = _pieces(without_gaps(tracks), period_ns, frame)
    first = next(pieces, None)
    if first is None:
        raise FirmwareFaultError("increments: the firmware never navigated")
    rows = bridged = 0
    last_s = 0.0
    with ExitStack() as stack:
        writers, paths = _opened(stack, folder, kind, first.truth is not None)
        for piece in (one for some in ((first,), pieces) for one in some):
            for writer in writers:
                writer.add(piece)
            rows += len(piece.epoch)
            bridged += int(piece.bridged.sum())
            last_s = float(piece.time_s[-1])
            on_rows(rows)
        for writer in writers:
            writer.close()
    return Written(paths, rows, bridged, first.truth is not None, float(first.time_s[0]), last_s)
