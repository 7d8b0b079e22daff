"""A scenario: one TOML file that says what is rehearsed, for both sides.

`Scenario` is the file as a person writes it, checked; `host_tools.outfit` makes of it what each
side is set up with.
"""

from __future__ import annotations

import difflib
import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

import firmware_py.settings
from dbc.codec import load as load_codec
from dbc.contract import SENSOR_GROUPS
from host_tools.errors import ScenarioError
from host_tools.faults import ANY_IDENTIFIER, Fault, FaultKind, Node
from host_tools.geometry import GEOMETRIES, AxesDeg
from host_tools.schemes import SCHEMES

PerSensor = float | tuple[float, ...]
"""One number for all sensors, or one for each."""

_Density = Annotated[float, Field(ge=0)]
_NoisePerSensor = _Density | tuple[_Density, ...]

_NAVIGATE = {"strapdown": "NAVIGATE_STRAPDOWN", "rotating": "NAVIGATE_ROTATING"}


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Site(_Table):
    """Where the vehicle stands, on WGS-84."""

    latitude_deg: float = Field(default=40.3554, ge=-89.9, le=89.9)
    longitude_deg: float = Field(default=116.668, ge=-180, le=180)
    height_m: float = Field(default=40.0, ge=-1000, le=100_000)


class Body(_Table):
    """The vehicle's attitude."""

    roll_deg: float = Field(default=0.0, ge=-180, le=180)
    pitch_deg: float = Field(default=0.0, ge=-90, le=90)
    heading_deg: float = Field(default=0.0, ge=-360, le=360)


class Rimu(_Table):
    """Design directions of the input axes: a built-in geometry, or angles for each kind."""

    geometry: Literal["tetrahedron", "orthogonal", "custom"] = "tetrahedron"
    gyro_axes_deg: tuple[tuple[float, float], ...] | None = None
    accelerometer_axes_deg: tuple[tuple[float, float], ...] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Rimu:
        given = (self.gyro_axes_deg, self.accelerometer_axes_deg)
        if self.geometry != "custom":
            if given != (None, None):
                raise ValueError('axes are for geometry = "custom" only')
            return self
        for name, axes in zip(("gyro_axes_deg", "accelerometer_axes_deg"), given, strict=True):
            if axes is None:
                raise ValueError(f'geometry = "custom" needs {name}')
            if not 3 <= len(axes) <= SENSOR_GROUPS:
                raise ValueError(f"{name}: {len(axes)} sensors, can be 3 to {SENSOR_GROUPS}")
            if not _spans_space(axes):
                raise ValueError(f"{name}: the axes lie in one plane")
        return self

    @property
    def gyros(self) -> AxesDeg:
        """Design directions of the gyros."""
        return self.gyro_axes_deg or GEOMETRIES[self.geometry]

    @property
    def accelerometers(self) -> AxesDeg:
        """Design directions of the accelerometers."""
        return self.accelerometer_axes_deg or GEOMETRIES[self.geometry]


class _Sensors(_Table):
    """Errors that both kinds of sensors have."""

    scale_error_ppm: PerSensor = 0.0
    asymmetric_scale_error_ppm: PerSensor = 0.0
    installation_u_arcsec: PerSensor = 0.0
    installation_v_arcsec: PerSensor = 0.0


class Gyros(_Sensors):
    """Errors of the gyros. Paper, (16)."""

    bias_dph: PerSensor = 0.0
    angle_random_walk_deg_per_sqrt_h: _NoisePerSensor = 0.0
    range_dps: float = Field(default=300.0, gt=0)


class Accelerometers(_Sensors):
    """Errors of the accelerometers. Paper, (17)."""

    bias_ug: PerSensor = 0.0
    white_noise_ug_per_sqrt_hz: _NoisePerSensor = 0.0
    range_g: float = Field(default=20.0, gt=0)


class Axis(_Table):
    """Limits and encoder of one axis of the turntable."""

    rate_limit_dps: float = Field(default=30.0, gt=0, le=60)
    acceleration_limit_dps2: float = Field(default=10.0, gt=0, le=10_000)
    encoder_bits: int = Field(default=24, ge=8, le=26)
    """Bits of a whole turn."""


class Turntable(_Table):
    """The two axes."""

    inner: Axis = Axis()
    outer: Axis = Axis()


class Firmware(_Table):
    """Settings of the navigation computer."""

    initial_attitude: Literal["given", "self-aligned"] = "given"
    alignment_s: float = Field(default=2.0, gt=0, le=86_400)
    height_channel: Literal["held", "damped", "free"] = "held"
    scheme: Literal["16-position", "8-position"] | tuple[firmware_py.settings.Turn, ...] = (
        "16-position"
    )
    turn_rate_dps: float = Field(default=2.0, gt=0, le=60)
    stand_s: float = Field(default=10.0, ge=0, le=86_400)
    gyro_weights: PerSensor = 1.0
    accelerometer_weights: PerSensor = 1.0
    clock_error_ppm: float = Field(default=0.0, ge=-1000, le=1000)
    bridge_s: float = Field(default=0.1, ge=0, le=10)
    follow_tolerance_deg: float = Field(default=5.0, gt=0, le=180)
    axis_silence_s: float = Field(default=1.0, gt=0, le=60)


class OperatorRequest(_Table):
    """A mode that the operator asks for at a time after the hardware's power-on."""

    at_s: float = Field(ge=0)
    request: Literal["STANDBY", "ALIGN", "NAVIGATE_STRAPDOWN", "NAVIGATE_ROTATING"]


class Bus(_Table):
    """The wire between the two sides."""

    bitrate: Literal[125_000, 250_000, 500_000, 1_000_000] | None = None
    """bit/s, to model the wire's timing; without it the wire is ideal and takes no time."""


class FaultOnWire(_Table):
    """A fault on the wire, from a time after the hardware's power-on."""

    kind: Literal[
        "drop",
        "delay",
        "duplicate",
        "reorder",
        "corrupt_wire",
        "corrupt",
        "wrong_counter",
        "babble",
        "silence",
        "bus_off",
        "cut",
    ]
    message: str | None = None
    """Name of the message that is meant; without it all of the node."""
    node: Literal["any", "firmware", "hardware"] = "any"
    at_s: float = Field(default=0.0, ge=0)
    for_s: float | None = Field(default=None, gt=0)
    """How long; without it, to the end."""
    probability: float = Field(default=1.0, gt=0, le=1)
    delay_s: float = Field(default=0.01, gt=0, le=60)
    frames_per_epoch: int = Field(default=20, ge=1, le=200)
    bit: int | None = Field(default=None, ge=0, le=63)

    @model_validator(mode="after")
    def _known(self) -> FaultOnWire:
        if self.message is not None and self.message not in _message_names():
            near = difflib.get_close_matches(self.message, _message_names(), 1)
            hint = f", did you mean {near[0]}?" if near else ""
            raise ValueError(f"message: the DBC has no {self.message}{hint}")
        return self

    def fault(self, rate_hz: int) -> Fault:
        """Return the fault, its times in epochs."""
        first = round(self.at_s * rate_hz)
        kind = FaultKind[self.kind.upper()]
        parameter = {
            FaultKind.DELAY: max(1, round(self.delay_s * rate_hz)),
            FaultKind.BABBLE: self.frames_per_epoch,
            FaultKind.CORRUPT: 0 if self.bit is None else self.bit + 1,
        }.get(kind, 0)
        return Fault(
            kind=kind,
            node=Node[self.node.upper()],
            identifier=(
                ANY_IDENTIFIER if self.message is None else load_codec().frame_id(self.message)
            ),
            first_epoch=first,
            last_epoch=-1 if self.for_s is None else first + round(self.for_s * rate_hz) - 1,
            probability=self.probability,
            parameter=parameter,
        )


def _message_names() -> list[str]:
    return [message.name for message in load_codec().database.messages]


class EastNorth(_Table):
    """A pair of figures."""

    east: float
    north: float


class Paper(_Table):
    """What the paper reports for the same run, to stand beside ours."""

    source: str = ""
    duration_s: float | None = None
    max_abs_position_error_m: EastNorth | None = None
    max_abs_velocity_error_mps: EastNorth | None = None


class Scenario(_Table):
    """A rehearsal, whole."""

    title: str = ""
    mode: Literal["strapdown", "rotating"] = "rotating"
    duration_s: float = Field(gt=0, le=10_000_000)
    """How long it navigates."""
    rate_hz: Annotated[int, Field(ge=50, le=1000)] = 200
    seed: int = Field(default=1, ge=0)
    navigate_at_s: float = Field(default=1.0, ge=0, le=3600)
    """When the operator asks for navigation, unless `operator` says otherwise."""
    site: Site = Site()
    body: Body = Body()
    rimu: Rimu = Rimu()
    gyros: Gyros = Gyros()
    accelerometers: Accelerometers = Accelerometers()
    turntable: Turntable = Turntable()
    firmware: Firmware = Firmware()
    operator: tuple[OperatorRequest, ...] = Field(default=(), max_length=30)
    paper: Paper | None = None
    bus: Bus = Bus()
    faults: tuple[FaultOnWire, ...] = Field(default=(), max_length=100)

    @model_validator(mode="after")
    def _consistent(self) -> Scenario:
        if 1_000_000_000 % self.rate_hz:
            raise ValueError(f"rate_hz: the period of {self.rate_hz} Hz is no whole number of ns")
        for kind, table, count in (
            ("gyros", self.gyros, len(self.rimu.gyros)),
            ("accelerometers", self.accelerometers, len(self.rimu.accelerometers)),
        ):
            for key, value in table.model_dump().items():
                _check_count(f"{kind}.{key}", value, count)
        _check_weights("gyro_weights", self.firmware.gyro_weights, len(self.rimu.gyros))
        _check_weights(
            "accelerometer_weights",
            self.firmware.accelerometer_weights,
            len(self.rimu.accelerometers),
        )
        settle_s = self.firmware.turn_rate_dps / self.axis_acceleration_dps2
        if self.mode == "rotating" and self.firmware.stand_s < settle_s:
            raise ValueError(
                f"firmware.stand_s: {self.firmware.stand_s:g} s, but an axis comes to rest "
                f"{settle_s:.3g} s after a turn without ramps would (turn rate / acceleration)"
            )
        for name, axis in (("inner", self.turntable.inner), ("outer", self.turntable.outer)):
            if self.mode == "rotating" and axis.rate_limit_dps < self.firmware.turn_rate_dps:
                raise ValueError(
                    f"turntable.{name}.rate_limit_dps: {axis.rate_limit_dps:g}, below the "
                    f"scheme's {self.firmware.turn_rate_dps:g}"
                )
        times = [request.at_s for request in self.operator]
        if times != sorted(times):
            raise ValueError("operator: the requests are not in order of time")
        if self.operator and self.first_navigation_s is None:
            raise ValueError("operator: nobody asks for navigation")
        try:
            _ = self.scheme
        except ValidationError as error:
            raise ValueError(f"firmware.scheme: {error.errors()[0]['msg']}") from error
        return self

    @property
    def scheme(self) -> firmware_py.settings.Scheme:
        """The rotation scheme, resolved."""
        scheme = self.firmware.scheme
        turns = SCHEMES[scheme] if isinstance(scheme, str) else scheme
        return firmware_py.settings.Scheme(
            turns=turns, turn_rate_dps=self.firmware.turn_rate_dps, stand_s=self.firmware.stand_s
        )

    @property
    def axis_acceleration_dps2(self) -> float:
        """What the slower of the two axes does, as the firmware knows it from the data sheet."""
        table = self.turntable
        return min(table.inner.acceleration_limit_dps2, table.outer.acceleration_limit_dps2)

    @property
    def requests(self) -> tuple[OperatorRequest, ...]:
        """What the operator asks for, in order of time."""
        if self.operator:
            return self.operator
        request = {"at_s": self.navigate_at_s, "request": _NAVIGATE[self.mode]}
        return (OperatorRequest.model_validate(request),)

    @property
    def first_navigation_s(self) -> float | None:
        """When navigation is first asked for."""
        asked = [r.at_s for r in self.operator if r.request.startswith("NAVIGATE")]
        return min(asked) if asked else None

    @property
    def epochs(self) -> int:
        """Epochs from power-on to the end: self-test, alignment, `duration_s` of navigation."""
        asked = self.first_navigation_s if self.operator else self.navigate_at_s
        assert asked is not None
        return (
            max(round(asked * self.rate_hz), self.rate_hz)
            + max(1, round(self.firmware.alignment_s * self.rate_hz))
            + round(self.duration_s * self.rate_hz)
            + 1
        )

    @property
    def period_ns(self) -> int:
        """Sampling period."""
        return 1_000_000_000 // self.rate_hz


def _spans_space(axes_deg: AxesDeg) -> bool:
    H = firmware_py.settings.input_axes(axes_deg)
    normal = H.T @ H
    return bool(abs(_determinant(normal)) > 1e-3)


def _determinant(m: Any) -> float:
    return float(
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )


def _check_count(where: str, value: Any, count: int) -> None:
    if isinstance(value, tuple) and len(value) != count:
        raise ValueError(f"{where}: {len(value)} values for {count} sensors")


def _check_weights(key: str, value: PerSensor, count: int) -> None:
    _check_count(f"firmware.{key}", value, count)
    if any(weight <= 0 for weight in each(value, count)):
        raise ValueError(f"firmware.{key}: a weight must be above 0")


def each(value: PerSensor, count: int) -> tuple[float, ...]:
    """Return a value for each of `count` sensors."""
    return value if isinstance(value, tuple) else (value,) * count


def names() -> list[str]:
    """Return the names of the built-in scenarios."""
    folder = resources.files("host_tools").joinpath("scenarios")
    return sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml"))


def text_of(name: str) -> str:
    """Return the TOML text of a built-in scenario, or of a file.

    Raises
    ------
    ScenarioError
        When there is neither a built-in scenario nor a file of that name, or it cannot be read.
    """
    if name in names():
        file = resources.files("host_tools").joinpath("scenarios", f"{name}.toml")
        return file.read_text(encoding="utf-8")
    path = Path(name)
    try:
        if path.exists():
            return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"scenario {name}: cannot be read: {error}") from error
    near = difflib.get_close_matches(name, names(), 1)
    hint = f"did you mean {near[0]}?" if near else "see `rrins scenarios`"
    raise ScenarioError(f"scenario {name}: neither built in nor a file; {hint}")


def load(name: str, **overrides: Any) -> Scenario:
    """Return a scenario, checked.

    Parameters
    ----------
    name : str
        Of a built-in scenario, or path of a TOML file.
    **overrides
        Top-level keys (`duration_s`, `seed`, …) that take the place of the file's; None leaves it.

    Raises
    ------
    ScenarioError
        One line: which scenario, which key, what is wrong.
    """
    try:
        table = tomllib.loads(text_of(name))
    except ValueError as error:  # also of a number with thousands of digits
        raise ScenarioError(f"scenario {name}: not TOML: {error}") from error
    except RecursionError as error:
        raise ScenarioError(f"scenario {name}: nested too deeply") from error
    table.update({key: value for key, value in overrides.items() if value is not None})
    try:
        return Scenario.model_validate(table)
    except ValidationError as error:
        raise ScenarioError(f"scenario {name}: {_first_line(error)}") from error


def fault_of(values: dict[str, Any]) -> FaultOnWire:
    """Return a fault from the keys that a scenario's `[[faults]]` has.

    Raises
    ------
    ScenarioError
        One line: which key, what is wrong.
    """
    try:
        return FaultOnWire.model_validate(values)
    except ValidationError as error:
        raise ScenarioError(f"fault: {_first_line(error)}") from error


def _first_line(error: ValidationError) -> str:
    """Return the most telling fault that pydantic found, in the words of a scenario."""
    # A misspelt key tells more than the missing one; of the readings of a value that may be one
    # thing or another, the one that got furthest.
    first = max(error.errors(), key=lambda e: (e["type"] == "extra_forbidden", len(e["loc"])))
    where = ".".join(
        str(part + 1) if isinstance(part, int) else part
        for part in first["loc"]
        if isinstance(part, int) or part.isidentifier()
    )
    if first["type"] == "extra_forbidden":
        near = difflib.get_close_matches(str(first["loc"][-1]), _keys(first["loc"][:-1]), 1)
        hint = f", did you mean {near[0]}?" if near else ""
        text = f"{where}: no such key{hint}"
    elif first["type"] == "value_error":
        message = str(first["ctx"]["error"])
        text = f"{where}: {message}" if where else message
    elif first["type"] == "missing":
        text = f"{where}: is missing"
    else:
        text = f"{where}: {first['msg'][0].lower()}{first['msg'][1:]}, got {first['input']!r}"
    others = error.error_count() - 1
    return f"{text} (and {others} more)" if others else text


def _keys(location: tuple[int | str, ...]) -> list[str]:
    """Return the keys that a table of the scenario can have."""
    model: Any = Scenario
    for part in location:
        if isinstance(part, str) and part in model.model_fields:
            annotation = model.model_fields[part].annotation
            lists = {"operator": OperatorRequest, "faults": FaultOnWire}
            model = annotation if isinstance(annotation, type) else lists.get(part, model)
    return list(model.model_fields)
