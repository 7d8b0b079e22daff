"""The calibration of the sensors: a TOML file given at start, and its place in memory.

::

    [gyros]
    bias_dph = [0.1, 0.11, 0.12, 0.13]      # or one number for all
    scale_error_ppm = 0
    asymmetric_scale_error_ppm = 0
    installation_u_arcsec = 0
    installation_v_arcsec = 0

    [accelerometers]
    bias_ug = [50, 55, 60, 65]
    position_x_mm = [20, -10, -10, 0]       # in the sensor frame, from the reference point
    position_y_mm = 0
    position_z_mm = 0

    [calibrated]                            # when, and how warm the sensors were
    date_utc = 2026-11-23T08:05:00Z
    temperature_c = 22.5

    [gyros.sigma]                           # standard deviations, by the keys of the constants
    bias_dph = 0.013
    scale_error_ppm = [1.9, 2.0, 1.9, 2.1]

The keys of the constants are those of a scenario's tables; missing keys are zero. A date, a
temperature or a table of standard deviations that is missing is not known.
"""

from __future__ import annotations

import datetime
import difflib
import math
import tomllib
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError

from rrins.firmware_py.core.records.calibration_records import CalibrationInUse
from rrins.firmware_py.core.records.memory import Fusion

STANDARD_GRAVITY = 9.80665
"""m/s²: the g of µg (ISO 80000-3)."""

DPH = math.radians(1) / 3600
"""rad/s of a °/h."""

UG = 1e-6 * STANDARD_GRAVITY
"""m/s² of a µg."""

_LARGEST_FILE = 1 << 20  # bytes
ARCSEC = math.radians(1) / 3600
"""rad of an arc second."""

PPM = 1e-6
"""1 of a part per million."""
_SINGULAR = 1e-12  # of singular values: smaller is rounding

PerSensor = float | tuple[float, ...]
"""One number for all sensors, or one for each."""

_Small = Annotated[float, Field(ge=-100_000, le=100_000)]  # a tenth; half a turn and more
_SmallPerSensor = _Small | tuple[_Small, ...]
_Sigma = Annotated[float, Field(ge=0, le=100_000)]
_SigmaPerSensor = _Sigma | tuple[_Sigma, ...]
_FIRST_DATE = datetime.datetime.fromtimestamp(1, datetime.UTC)
_LAST_DATE = datetime.datetime.fromtimestamp((1 << 32) - 1, datetime.UTC)
_Distance = Annotated[float, Field(ge=-1000, le=1000)]
_DistancePerSensor = _Distance | tuple[_Distance, ...]


class CalibrationError(Exception):
    """An unreadable or invalid calibration file; the message gives file and reason in one line."""


class Origin(BaseModel):
    """When a calibration was made, and how warm the sensors were; None: not known."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    date_utc: Annotated[AwareDatetime, Field(ge=_FIRST_DATE, le=_LAST_DATE)] | None = None
    temperature_c: Annotated[float, Field(ge=-100, le=200)] | None = None


class _Sigmas(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    scale_error_ppm: _SigmaPerSensor = 0.0
    asymmetric_scale_error_ppm: _SigmaPerSensor = 0.0
    installation_u_arcsec: _SigmaPerSensor = 0.0
    installation_v_arcsec: _SigmaPerSensor = 0.0


class GyroSigmas(_Sigmas):
    """Standard deviations of the calibrated errors of the gyros."""

    bias_dph: _SigmaPerSensor = 0.0


class AccelerometerSigmas(_Sigmas):
    """Standard deviations of the calibrated errors of the accelerometers."""

    bias_ug: _SigmaPerSensor = 0.0


class _Sensors(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    scale_error_ppm: _SmallPerSensor = 0.0
    asymmetric_scale_error_ppm: _SmallPerSensor = 0.0
    installation_u_arcsec: _SmallPerSensor = 0.0
    installation_v_arcsec: _SmallPerSensor = 0.0

    @property
    def bias(self) -> PerSensor:
        """Bias in the unit of its key."""
        raise NotImplementedError


class GyroCalibration(_Sensors):
    """Calibrated errors of the gyros. Paper, (16)."""

    bias_dph: PerSensor = 0.0
    sigma: GyroSigmas | None = None

    @property
    def bias(self) -> PerSensor:
        """Bias in °/h."""
        return self.bias_dph


class AccelerometerCalibration(_Sensors):
    """Calibrated errors of the accelerometers, paper (17), and their positions."""

    bias_ug: PerSensor = 0.0
    position_x_mm: _DistancePerSensor = 0.0
    position_y_mm: _DistancePerSensor = 0.0
    position_z_mm: _DistancePerSensor = 0.0
    sigma: AccelerometerSigmas | None = None

    @property
    def bias(self) -> PerSensor:
        """Bias in µg."""
        return self.bias_ug


class Calibration(BaseModel):
    """The errors that the firmware removes from the sensors' increments."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    calibrated: Origin = Origin()
    gyros: GyroCalibration = Field(default=GyroCalibration())
    accelerometers: AccelerometerCalibration = Field(default=AccelerometerCalibration())

    def for_counts(self, gyros: int, accelerometers: int) -> Calibration:
        """Return the calibration if it suits the given numbers of gyros and accelerometers.

        Raises
        ------
        CalibrationError
        """
        tables = (
            ("gyros", self.gyros, gyros),
            ("accelerometers", self.accelerometers, accelerometers),
        )
        for kind, table, count in tables:
            sigma = {} if table.sigma is None else table.sigma.model_dump()
            values = table.model_dump() | {f"sigma.{key}": value for key, value in sigma.items()}
            for key, value in values.items():
                if isinstance(value, tuple) and len(value) != count:
                    raise CalibrationError(f"{kind}.{key}: {len(value)} values for {count} sensors")
        return self


def _text_of(path: Path) -> str:
    """Return the text of a file; a pipe or a device, which may never end, is none."""
    if path.exists() and not path.is_file():
        raise CalibrationError("is not a file")
    if path.stat().st_size > _LARGEST_FILE:
        raise CalibrationError(f"is larger than {_LARGEST_FILE >> 20} MiB")
    return path.read_text(encoding="utf-8")


def load(path: Path, gyros: int, accelerometers: int) -> Calibration:
    """Read the calibration of the given numbers of gyros and accelerometers from a TOML file.

    Raises
    ------
    CalibrationError
    """
    try:
        text = _text_of(path)
        loaded = Calibration.model_validate(tomllib.loads(text))
        return loaded.for_counts(gyros, accelerometers)
    except OSError as error:
        raise CalibrationError(f"calibration {path}: cannot be read: {error.strerror}") from error
    except ValidationError as error:
        raise CalibrationError(f"calibration {path}: {_first_fault(error)}") from None
    except CalibrationError as error:
        raise CalibrationError(f"calibration {path}: {error}") from error
    except (ValueError, RecursionError) as error:
        raise CalibrationError(f"calibration {path}: not TOML: {error}") from error


def _first_fault(error: ValidationError) -> str:
    first = max(error.errors(), key=lambda e: e["type"] == "extra_forbidden")
    path = [str(part) for part in first["loc"] if isinstance(part, int) or part.isidentifier()]
    where = ".".join(path)
    if first["type"] != "extra_forbidden":
        return f"{where}: {first['msg'][0].lower()}{first['msg'][1:]}, got {first['input']!r}"
    tables: dict[str, type[BaseModel]] = {
        "": Calibration,
        "calibrated": Origin,
        "gyros": GyroCalibration,
        "gyros.sigma": GyroSigmas,
        "accelerometers": AccelerometerCalibration,
        "accelerometers.sigma": AccelerometerSigmas,
    }
    known = tables.get(".".join(path[:-1]), Calibration)
    near = difflib.get_close_matches(path[-1], known.model_fields, 1)
    return f"{where}: no such key" + (f", did you mean {near[0]}?" if near else "")


def input_axes(axes_deg: tuple[tuple[float, float], ...]) -> NDArray[np.float64]:
    """Return the configuration matrix H, shape (m, 3). Paper, (5), (9)."""
    alpha, beta = np.radians(np.asarray(axes_deg, dtype=float)).T
    return np.column_stack(
        [np.sin(alpha) * np.cos(beta), np.sin(alpha) * np.sin(beta), np.cos(alpha)]
    )


def condition_number(H: NDArray[np.float64]) -> float:
    """Return the condition number of axes, shape (m, 3), in the Frobenius norm; see `fusion`.

    3 for axes that span space evenly, infinite for axes in one plane.
    """
    singular = np.linalg.svd(H, compute_uv=False)
    if not singular[-1] > _SINGULAR * singular[0]:
        return math.inf
    return float(np.sqrt((singular**2).sum() * (singular**-2.0).sum()))


def largest_gain(H: NDArray[np.float64], weights: tuple[float, ...]) -> float:
    """Return the largest element of the gain of weighted least squares, of axes of shape (m, 3)."""
    root = np.sqrt(np.asarray(weights) / max(weights))
    return float(np.abs(np.linalg.pinv(root[:, None] * H) * root).max())


def transverse(
    axes_deg: tuple[tuple[float, float], ...],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return U and V, shape (m, 3) each: the directions of growing α and β. Paper, (11)."""
    alpha, beta = np.radians(np.asarray(axes_deg, dtype=float)).T
    U = np.column_stack(
        [np.cos(alpha) * np.cos(beta), np.cos(alpha) * np.sin(beta), -np.sin(alpha)]
    )
    V = np.column_stack([-np.sin(beta), np.cos(beta), np.zeros_like(beta)])
    return U, V


def each(value: PerSensor, count: int) -> NDArray[np.float64]:
    """Return a value for each of `count` sensors, shape (count,)."""
    return np.broadcast_to(np.asarray(value, dtype=float), (count,))


def fill_origin(record: CalibrationInUse, origin: Origin) -> None:
    """Fill in when the sensors were calibrated, and how warm they were."""
    if origin.date_utc is not None:
        record.date_utc_s = int(origin.date_utc.timestamp())
    if origin.temperature_c is not None:
        record.temperature_known = True
        record.temperature_c = origin.temperature_c


def fill(
    fusion: Fusion,
    axes_deg: tuple[tuple[float, float], ...],
    sensors: GyroCalibration | AccelerometerCalibration,
    dt: float,
) -> None:
    """Fill the calibration of the sensors of one kind into their record."""
    count = len(axes_deg)
    unit = DPH if isinstance(sensors, GyroCalibration) else UG

    du = each(sensors.installation_u_arcsec, count) * ARCSEC
    dv = each(sensors.installation_v_arcsec, count) * ARCSEC
    U, V = transverse(axes_deg)
    # h' = h - δu v - δv u, paper (13)
    fusion.H[:count] = input_axes(axes_deg) - du[:, None] * V - dv[:, None] * U
    fusion.bias_increment[:count] = each(sensors.bias, count) * unit * dt
    fusion.scale_error[:count] = each(sensors.scale_error_ppm, count) * PPM
    asymmetric = each(sensors.asymmetric_scale_error_ppm, count)
    fusion.asymmetric_scale_error[:count] = asymmetric * PPM
    fusion.calibrated = bool(
        fusion.bias_increment.any()
        or fusion.scale_error.any()
        or fusion.asymmetric_scale_error.any()
    )
