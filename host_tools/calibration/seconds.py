"""Records of the table: rows of sums over a second, from the firmware or a simulation."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats
from rrins.firmware_py.diagnostics.calibration_record import fields
from rrins.host_tools.errors import CalibrationRecordError
from rrins.host_tools.files import text_of, write_text

_LARGEST = 1 << 28  # bytes of a record


@dataclass(frozen=True)
class Seconds:
    """Sums over n seconds, oldest first.

    Attributes
    ----------
    gyro_usable, accelerometer_usable : bool array, shapes (n, m), (n, k)
    """

    epoch: Floats  #: shape (n,); the last epoch of each
    duration_s: Floats  #: shape (n,)
    position: NDArray[np.int_]  #: shape (n,); of the scheme, from 0
    gyro_usable: NDArray[np.bool_]
    accelerometer_usable: NDArray[np.bool_]
    angles_deg: Floats  #: shape (n, 2); inner and outer encoder at the end
    #: shape (n, 8); s; `rrins.firmware_py.core.turntable.table_sums.ORIENTATIONS`.
    orientation: Floats
    turn: Floats  #: shape (n, 4); rad; `rrins.firmware_py.core.turntable.table_sums.TURNS`.
    gyro: Floats  #: shape (n, m); rad, along the input axes
    accelerometer: Floats  #: shape (n, k); m/s, along the input axes

    def __len__(self) -> int:
        return len(self.duration_s)

    @property
    def total_s(self) -> float:
        """Time recorded."""
        return float(self.duration_s.sum())

    def where(self, chosen: NDArray[np.bool_] | slice) -> Seconds:
        """Return some of the seconds."""
        return Seconds(**{name: values[chosen] for name, values in vars(self).items()})

    def __add__(self, later: Seconds) -> Seconds:
        """Return these seconds and later ones."""
        pairs = {name: (values, getattr(later, name)) for name, values in vars(self).items()}
        return Seconds(**{name: np.concatenate(pair) for name, pair in pairs.items()})


def row_size(gyros: int, accelerometers: int) -> int:
    """Return how many numbers a row has."""
    return sum(count for _, count in fields(gyros, accelerometers))


def decode(rows: Floats, gyros: int, accelerometers: int, period_s: float) -> Seconds:
    """Return the seconds in rows of numbers, shape (n, `row_size`)."""
    parts: dict[str, Floats] = {}
    at = 0
    for name, count in fields(gyros, accelerometers):
        parts[name] = rows[:, at] if count == 1 else rows[:, at : at + count]
        at += count
    parts["gyro"] = rows[:, at - gyros - accelerometers : at - accelerometers]
    parts["accelerometer"] = rows[:, at - accelerometers : at]
    axis_received = parts["axis_missing"] == 0
    return Seconds(
        epoch=parts["epoch"],
        duration_s=parts["epochs"] * period_s,
        position=parts["position"].astype(int),
        gyro_usable=_usable(parts["gyro_missing"], gyros, axis_received),
        accelerometer_usable=_usable(parts["accelerometer_missing"], accelerometers, axis_received),
        angles_deg=np.column_stack([parts["inner_deg"], parts["outer_deg"]]),
        orientation=parts["orientation"],
        turn=parts["turn"],
        gyro=parts["gyro"],
        accelerometer=parts["accelerometer"],
    )


def _usable(missing: Floats, count: int, axis_received: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return whether each sensor's second counts.

    Where one of a kind was missing, the firmware may have taken the parity off the others: then
    none of the kind counts.
    """
    is_whole = (missing == 0) & axis_received
    return np.repeat(is_whole[:, None], count, axis=1)


def of_bytes(data: bytes, gyros: int, accelerometers: int, period_s: float) -> Seconds:
    """Return the seconds of a record as the firmware gives it.

    Raises
    ------
    CalibrationRecordError
        When the bytes are not a whole number of rows.
    """
    size = 8 * row_size(gyros, accelerometers)
    if len(data) % size:
        raise CalibrationRecordError(
            f"{len(data)} bytes of the calibration's record are not a multiple of {size}; is the "
            "firmware of another version?"
        )
    rows = np.frombuffer(data, dtype="<f8").reshape(-1, row_size(gyros, accelerometers))
    return decode(rows.astype(float), gyros, accelerometers, period_s)


def save(path: Path, seconds: Seconds, note: dict[str, object]) -> None:
    """Write seconds, and a note of what they are of, as JSON.

    Raises
    ------
    OSError
        When it cannot be written.
    """
    columns = {name: values.tolist() for name, values in vars(seconds).items()}
    write_text(path, json.dumps({"note": note, "seconds": columns}))


def load(path: Path) -> tuple[Seconds, dict[str, object]]:
    """Return seconds and note that `save` has written.

    Raises
    ------
    CalibrationRecordError
        When the file cannot be read, or holds something else.
    """
    try:
        table = json.loads(text_of(path, _LARGEST))
        columns = {name: np.array(values) for name, values in table["seconds"].items()}
        columns["position"] = columns["position"].astype(int)
        return Seconds(**columns), dict(table["note"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise CalibrationRecordError(
            f"{path}: not a record of a calibration ({error}); remove it to begin again"
        ) from error
