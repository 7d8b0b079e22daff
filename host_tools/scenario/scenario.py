"""A scenario: one TOML file that says what is rehearsed, for both sides.

`Scenario` is the file as a person writes it, checked; its tables are in `scenario.tables`.
`rrins.host_tools.runs.set_up.settings` makes of it what each side is set up with.
"""

from __future__ import annotations

import difflib
import html
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import tomli_w
from pydantic import Field, TypeAdapter, ValidationError, model_validator

import rrins.firmware_py.core.settings
from rrins.host_tools import files
from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.hardware.memory import FAULT_CAPACITY, STANDING_CAPACITY
from rrins.host_tools.hardware.tables import (
    Accelerometers,
    Altimeter,
    Gyros,
    Odometer,
    PerSensor,
    Thermal,
    TomlTable,
    Turntable,
)
from rrins.host_tools.rounding import rounded
from rrins.host_tools.scenario import presets
from rrins.host_tools.scenario.fault_tables import AnyFault, FaultOfHardware, FaultOnWire
from rrins.host_tools.scenario.geometry import AxesDeg
from rrins.host_tools.scenario.motion import Motion
from rrins.host_tools.scenario.schemes import SCHEMES
from rrins.host_tools.scenario.tables import (
    LONGEST_S,
    MOST_LETTERS,
    Body,
    Bus,
    Estimator,
    Firmware,
    Gnss,
    Integrity,
    Master,
    OperatorRequest,
    Paper,
    Redundancy,
    Rimu,
    Site,
    Xcp,
    ZeroVelocity,
    check_turntable,
    each,
)
from rrins.host_tools.scenario.wrong_keys import first_line

_LARGE_ASYMMETRY_PPM = 10.0
"""Root mean square of a kind's asymmetric scale factors from which on they are estimated."""

_NAVIGATE = {"strapdown": "NAVIGATE_STRAPDOWN", "rotating": "NAVIGATE_ROTATING"}


class _InOneLine(type(TomlTable)):  # type: ignore[misc]  # pydantic's has no public name
    """Makes a wrong key of a call one line, too."""

    if not TYPE_CHECKING:

        def __call__(cls, **keys: Any) -> Any:
            try:
                return super().__call__(**keys)
            except ValidationError as error:
                raise ScenarioError(f"scenario: {first_line(error, cls)}") from None


class Scenario(TomlTable, metaclass=_InOneLine):
    """A rehearsal, whole."""

    title: str = Field(default="", max_length=MOST_LETTERS)
    """Heading of the table and the plots."""
    mode: Literal["strapdown", "rotating"] = "rotating"
    """Navigation that the operator asks for, unless `operator` says otherwise."""
    duration_s: float = Field(gt=0, le=LONGEST_S)
    """How long it navigates."""
    rate_hz: Annotated[int, Field(ge=50, le=1000)] = 200
    """Epochs per second; the period is a whole number of ns."""
    seed: int = Field(default=1, ge=0, lt=2**63)
    """Of all noise, and of what is drawn at each power-up."""
    navigate_at_s: float = Field(default=1.0, ge=0, le=3600)
    """When the operator asks for navigation, unless `operator` says otherwise."""
    site: Site = Site()
    body: Body = Body()
    rimu: Rimu = Rimu()
    sensors: str | None = None
    """Preset that the keys of `gyros` and `accelerometers` are changes to."""
    gyros: Gyros = Gyros()
    accelerometers: Accelerometers = Accelerometers()
    thermal: Thermal = Thermal()
    altimeter: Altimeter | None = None
    gnss: Gnss | None = None
    odometer: Odometer | None = None
    master: Master | None = None
    turntable: Turntable = Turntable()
    motion: Motion = Motion()
    firmware: Firmware = Firmware()
    redundancy: Redundancy = Redundancy()
    estimator: Estimator = Estimator()
    integrity: Integrity = Integrity()
    xcp: Xcp | None = None
    zero_velocity: tuple[ZeroVelocity, ...] = Field(default=(), max_length=STANDING_CAPACITY)
    """Times in which the operator says that the vehicle stands."""
    operator: tuple[OperatorRequest, ...] = Field(default=(), max_length=30)
    """Modes that the operator requests, in order of time."""
    paper: Paper | None = None
    bus: Bus = Bus()
    faults: tuple[AnyFault, ...] = Field(default=(), max_length=100)
    """Faults of the hardware and on the wire."""

    @model_validator(mode="before")
    @classmethod
    def _with_preset(cls, data: Any) -> Any:
        """Put the preset's values where the scenario has none of its own."""
        if not isinstance(data, dict) or data.get("sensors") is None:
            return data
        name = data["sensors"]
        if name not in presets.names():
            known = presets.names()
            near = difflib.get_close_matches(str(name), known, 1)
            hint = f", did you mean {near[0]}?" if near else ";"
            listed = f"there are {', '.join(known)}"
            raise ValueError(f"sensors: there is no preset {name!r}{hint} {listed}")
        merged = dict(data)
        for table, values in presets.tables_of(name).items():
            own = merged.get(table, {})
            if isinstance(own, dict):
                merged[table] = values | own
        return merged

    @model_validator(mode="after")
    def _consistent(self) -> Scenario:
        if 1_000_000_000 % self.rate_hz:
            raise ValueError(
                f"rate_hz: the period of {self.rate_hz} Hz is not a whole number of ns"
            )
        preset = {} if self.sensors is None else presets.tables_of(self.sensors)
        for kind, table, count in (
            ("gyros", self.gyros, len(self.rimu.gyros)),
            ("accelerometers", self.accelerometers, len(self.rimu.accelerometers)),
        ):
            of_preset = preset.get(kind, {})
            for key, value in table.model_dump().items():
                is_given = key in of_preset and value == _plain(of_preset[key])
                origin = f', of sensors = "{self.sensors}"' if is_given else ""
                _check_count(f"{kind}.{key}", value, count, origin)
        self._check_faults()
        channel = self.firmware.height_channel
        is_measured = self.estimator.enabled and channel == "free"
        if self.altimeter is not None and channel != "damped" and not is_measured:
            raise ValueError(
                'altimeter: is used with firmware.height_channel = "damped", or with "free" and '
                "estimator.enabled"
            )
        for name, unit, what in (
            ("gnss", self.gnss, "fix"),
            ("odometer", self.odometer, "count"),
            ("master", self.master, "transfer"),
        ):
            if unit is not None and unit.latency_s >= 1 / unit.rate_hz:
                late = f"{name}.latency_s: {unit.latency_s:g} s, but the next {what} comes after"
                raise ValueError(f"{late} {1 / unit.rate_hz:g} s")
        if self.integrity.enabled and not self.estimator.enabled:
            raise ValueError("integrity.enabled: needs estimator.enabled = true")
        if self.master is not None and self.firmware.initial_attitude != "transferred":
            raise ValueError('master: needs firmware.initial_attitude = "transferred"')
        if self.firmware.initial_attitude == "self-aligned-moving" and self.gnss is None:
            raise ValueError('firmware.initial_attitude: "self-aligned-moving" needs a [gnss]')
        moves = self.motion.kind in ("drive", "file")
        if moves and self.firmware.height_channel == "held":
            raise ValueError(
                'firmware.height_channel: "held" is for a vehicle that keeps its height; a '
                f'motion.kind = "{self.motion.kind}" needs "damped" with an [altimeter], or "free"'
            )
        firmware, rimu, settle_s = self.firmware, self.rimu, self.settle_s
        _check_weights("gyro_weights", firmware.gyro_weights, rimu.gyros)
        weights = firmware.accelerometer_weights
        _check_weights("accelerometer_weights", weights, rimu.accelerometers)
        if self.mode == "rotating" and firmware.stand_s < settle_s:
            raise ValueError(
                f"firmware.stand_s: {firmware.stand_s:g} s, but an axis comes to rest "
                f"{rounded(settle_s)} s after a turn without ramps would (turn rate / "
                "acceleration, acceleration / jerk)"
            )
        check_turntable(self.turntable, self.mode == "rotating", firmware)
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

    def _check_faults(self) -> None:
        """Raise ValueError for faults that the hardware cannot have."""
        counts = {"gyro": len(self.rimu.gyros), "accelerometer": len(self.rimu.accelerometers)}
        of_hardware = [fault for fault in self.faults if isinstance(fault, FaultOfHardware)]
        for number, fault in enumerate(self.faults, 1):
            if not isinstance(fault, FaultOfHardware):
                continue
            part = fault.hardware_kind.part
            name = part.name.lower()
            if name in counts and fault.target >= counts[name]:
                sensor = f"sensor {fault.target + 1} of {counts[name]}"
                raise ValueError(f"faults.{number}.sensor: {sensor}")
            if part.aid and getattr(self, part.aid) is None:
                article = "a" if part.aid == "gnss" else "an"
                needed = f"{fault.kind} needs {article} [{part.aid}]"
                raise ValueError(f"faults.{number}.kind: {needed}")
        for number, order in enumerate(self.redundancy.readmit, 1):
            if order.sensor > counts[order.kind]:
                where = f"redundancy.readmit.{number}.sensor"
                raise ValueError(f"{where}: sensor {order.sensor} of {counts[order.kind]}")
        if (count := len(of_hardware)) > FAULT_CAPACITY:
            raise ValueError(f"faults: {count} of the hardware itself, {FAULT_CAPACITY} at most")

    def varied(self, **changes: Any) -> Scenario:
        """Return the scenario with some keys changed, checked.

        A change is ``key=value`` for a top-level key, ``table__key=value`` for one of a table,
        ``table__table__key=value`` for one of a table in a table.
        Another preset of `sensors` takes the place of the one before; what the scenario has
        changed of that stays changed.

        Raises
        ------
        ScenarioError
        """
        values = self.model_dump(exclude_unset=True)
        if "sensors" in changes and self.sensors is not None:
            for kind, before in presets.tables_of(self.sensors).items():
                own = values[kind].items()
                values[kind] = {k: v for k, v in own if k not in before or v != _plain(before[k])}
        for name, value in changes.items():
            *tables, key = name.split("__")
            place = values
            for table in tables:
                place[table] = dict(place.get(table) or {})
                place = place[table]
            place[key] = value
        try:
            return Scenario.model_validate(values)
        except ValidationError as error:
            raise ScenarioError(f"scenario {self.title!r}: {first_line(error, Scenario)}") from None

    def toml(self) -> str:
        """Return the scenario as the TOML text of a file, wherever that file will be."""
        table = self.model_dump(mode="json", exclude_unset=True, exclude_none=True)
        _find_files(table, Path.cwd())
        return tomli_w.dumps(table)

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the keys that are set, as TOML."""
        return f"<pre>{html.escape(self.toml())}</pre>"

    @property
    def scheme(self) -> rrins.firmware_py.core.settings.Scheme:
        """The rotation scheme, resolved."""
        scheme = self.firmware.scheme
        turns = SCHEMES[scheme] if isinstance(scheme, str) else scheme
        return rrins.firmware_py.core.settings.Scheme(
            turns=turns,
            turn_rate_dps=self.firmware.turn_rate_dps,
            stand_s=self.firmware.stand_s,
            isolate_heading=self.firmware.isolate_heading,
        )

    @property
    def estimates_constants(self) -> bool:
        """Whether the estimator has scale factors, asymmetries and installation errors as states.

        Asymmetries add up as the vehicle turns to and fro, which no noise stands for.
        """
        if self.estimator.constants is not None:
            return self.estimator.constants
        tables = (self.gyros, self.accelerometers)
        return self.estimator.enabled and any(
            np.mean(np.square(table.asymmetric_scale_error_ppm)) > _LARGE_ASYMMETRY_PPM**2
            for table in tables
        )

    @property
    def axis_acceleration_dps2(self) -> float:
        """Limits of the slower axis, as the firmware knows it from the data sheet."""
        table = self.turntable
        return min(table.inner.acceleration_limit_dps2, table.outer.acceleration_limit_dps2)

    @property
    def axis_rise_s(self) -> float:
        """How long the slower of the two axes takes to reach its acceleration."""
        return max(self.turntable.inner.rise_s, self.turntable.outer.rise_s)

    @property
    def settle_s(self) -> float:
        """How much longer a turn takes than at the full rate from beginning to end."""
        return self.firmware.turn_rate_dps / self.axis_acceleration_dps2 + self.axis_rise_s

    @property
    def navigation_epoch(self) -> int:
        """The epoch in which navigation begins when nothing goes wrong."""
        asked = self.first_navigation_s if self.operator else self.navigate_at_s
        assert asked is not None
        ready = max(round(asked * self.rate_hz), self.rate_hz)
        coarse = max(1, round(self.firmware.alignment_s * self.rate_hz))
        return ready + coarse + round(self.estimator.fine_alignment_s * self.rate_hz)

    @property
    def requests(self) -> tuple[OperatorRequest, ...]:
        """The operator's requests, in order of time."""
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
        return self.navigation_epoch + round(self.duration_s * self.rate_hz) + 1

    @property
    def period_ns(self) -> int:
        """Sampling period."""
        return 1_000_000_000 // self.rate_hz


def _plain(value: Any) -> Any:
    """Return a value of a TOML file as a model holds it."""
    return tuple(value) if isinstance(value, list) else value


def _check_count(where: str, value: Any, count: int, origin: str = "") -> None:
    if isinstance(value, tuple) and len(value) != count:
        raise ValueError(f"{where}: {len(value)} values for {count} sensors{origin}")


def _check_weights(key: str, value: PerSensor, axes_deg: AxesDeg) -> None:
    _check_count(f"firmware.{key}", value, len(axes_deg))
    try:
        weights = each(value, len(axes_deg))
        rrins.firmware_py.core.settings.check_weights(weights, axes_deg)
    except ValueError as error:
        raise ValueError(f"firmware.{key}: {error}") from None


def names() -> list[str]:
    """Return the names of the built-in scenarios."""
    folder = resources.files(__package__).joinpath("built_in")
    return sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml"))


def text_of(name: str) -> str:
    """Return the TOML text of a built-in scenario, or of a file.

    Raises
    ------
    ScenarioError
        When there is neither a built-in scenario nor a file of that name, or it cannot be read.
    """
    if name in names():
        file = resources.files(__package__).joinpath("built_in", f"{name}.toml")
        return file.read_text(encoding="utf-8")
    path = Path(name)
    try:
        if path.exists():
            return files.text_of(path)
    except (OSError, ValueError) as error:  # ValueError: a path that no system has
        why = getattr(error, "strerror", None) or error
        raise ScenarioError(f"scenario {name}: cannot be read: {why}") from error
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
    return parse(table, name, Path(name).parent)


def parse(table: Mapping[str, Any], name: str, folder: Path = Path()) -> Scenario:
    """Return a scenario from its keys, checked.

    Parameters
    ----------
    table : mapping
        As a TOML file gives it.
    name : str
        What errors call it.
    folder : Path
        What the files that it names are relative to.

    Raises
    ------
    ScenarioError
        One line: which key, what is wrong.
    """
    values = dict(table)
    _find_files(values, folder)
    try:
        return Scenario.model_validate(values)
    except ValidationError as error:
        raise ScenarioError(f"scenario {name}: {first_line(error, Scenario)}") from None


def _find_files(table: dict[str, Any], folder: Path) -> None:
    """Make the files that a scenario names relative to the folder that it stands in."""
    named = (("firmware", "calibration"), ("motion", "path"), ("gnss", "tunnel_map"))
    for section, key in named:
        values = table.get(section)
        if isinstance(values, dict) and isinstance(values.get(key), str):
            table[section] = values | {key: str(folder / values[key])}


_ANY_FAULT: TypeAdapter[FaultOnWire | FaultOfHardware] = TypeAdapter(AnyFault)


def fault_of(values: dict[str, Any]) -> FaultOnWire | FaultOfHardware:
    """Return a fault from the keys that a scenario's `[[faults]]` has.

    Raises
    ------
    ScenarioError
        One line: which key, what is wrong.
    """
    try:
        return _ANY_FAULT.validate_python(values)
    except ValidationError as error:
        raise ScenarioError(f"fault: {first_line(error, Scenario)}") from None
