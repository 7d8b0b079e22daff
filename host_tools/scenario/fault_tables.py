"""The tables `[[faults]]` of a scenario: faults on the wire and of the hardware."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal, get_args

from pydantic import Field, model_validator

from rrins.dbc.codec import load as load_codec
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.host_tools.hardware.fault_values import VALUES, FaultValue
from rrins.host_tools.hardware.faults import ALWAYS, EVERY, HardwareFault, cycle_of
from rrins.host_tools.hardware.memory import INNER, OUTER
from rrins.host_tools.hardware.settings import PlannedFault
from rrins.host_tools.hardware.tables import TomlTable
from rrins.host_tools.scenario.tables import LONGEST_S
from rrins.host_tools.wire.faults import ANY_IDENTIFIER, FaultKind, Node, WireFault


class _Timed(TomlTable):
    """When a fault is present."""

    at_s: float = Field(default=0.0, ge=0, le=LONGEST_S)
    """After power-on of the hardware."""
    for_s: float | None = Field(default=None, gt=0, le=LONGEST_S)
    """Duration; to the end by default."""

    def epochs(self, rate_hz: int) -> tuple[int, int]:
        """Return the first and the last epoch; -1 as the last means to the end."""
        first = round(self.at_s * rate_hz)
        if self.for_s is None:
            return first, -1
        return first, first + max(1, round(self.for_s * rate_hz)) - 1

    def _refuse_keys_of_other_kinds(self, kind: str, keys: Mapping[str, tuple[str, ...]]) -> None:
        """Raise if a key is given that does not apply to the kind; `keys` has the kinds of each."""
        for key, kinds in keys.items():
            if key not in self.model_fields_set or kind in kinds:
                continue
            if getattr(self, key) != type(self).model_fields[key].default:
                raise ValueError(f"{key}: does not apply to {kind}, only to {', '.join(kinds)}")


class FaultOnWire(_Timed):
    """A fault on the wire."""

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
        "stale",
    ]
    message: str | None = None
    """Message concerned; by default all messages of the node."""
    node: Literal["any", "firmware", "hardware"] = "any"
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

    @model_validator(mode="after")
    def _fitting(self) -> FaultOnWire:
        of = {"delay_s": ("delay",), "frames_per_epoch": ("babble",), "bit": ("corrupt",)}
        self._refuse_keys_of_other_kinds(self.kind, of)
        return self

    def fault(self, rate_hz: int) -> WireFault:
        """Return the fault, its times in epochs."""
        first, last = self.epochs(rate_hz)
        kind = FaultKind[self.kind.upper()]
        parameter = {
            FaultKind.DELAY: max(1, round(self.delay_s * rate_hz)),
            FaultKind.BABBLE: self.frames_per_epoch,
            FaultKind.CORRUPT: 0 if self.bit is None else self.bit + 1,
        }.get(kind, 0)
        return WireFault(
            kind=kind,
            node=Node[self.node.upper()],
            identifier=(
                ANY_IDENTIFIER if self.message is None else load_codec().frame_id(self.message)
            ),
            first_epoch=first,
            last_epoch=last,
            probability=self.probability,
            parameter=parameter,
        )


def _message_names() -> list[str]:
    return [message.name for message in load_codec().database.messages]


def _limited(kind: HardwareFault, default: float) -> Any:
    """Return the field of a kind's value."""
    return Field(default=default, ge=VALUES[kind].minimum, le=VALUES[kind].maximum)


class FaultOfHardware(_Timed):
    """A failure of the hardware."""

    kind: str
    period_s: float | None = Field(default=None, gt=0, le=LONGEST_S)
    """Of an intermittent fault."""
    duty: float = Field(default=0.5, gt=0, lt=1)
    """Share of the period in which it is present, from its beginning."""

    @model_validator(mode="after")
    def _fitting(self) -> FaultOfHardware:
        own: dict[str, tuple[str, ...]] = {}
        for kind, value in VALUES.items():
            own[value.key] = (*own.get(value.key, ()), kind.name.lower())
        self._refuse_keys_of_other_kinds(self.kind, own)
        if self.period_s is None and self.duty != type(self).model_fields["duty"].default:
            raise ValueError("duty: needs period_s")
        return self

    @property
    def hardware_kind(self) -> HardwareFault:
        """The kind, as the hardware knows it."""
        return HardwareFault[self.kind.upper()]

    @property
    def target(self) -> int:
        """Index of the axis or the sensor; `EVERY` for all sensors of the kind."""
        raise NotImplementedError

    @property
    def value(self) -> float:
        """The kind's value, in the unit of its key; 0 for a kind that has none."""
        described: FaultValue | None = VALUES.get(self.hardware_kind)
        return 0.0 if described is None else float(getattr(self, described.key))

    def planned(self, rate_hz: int) -> PlannedFault:
        """Return the fault, its times in epochs, its value in SI units."""
        kind = self.hardware_kind
        value = self.value * VALUES[kind].unit if kind in VALUES else 0.0
        return PlannedFault(kind, self.target, *self.epochs(rate_hz), value, self.cycle(rate_hz))

    def cycle(self, rate_hz: int) -> tuple[int, int]:
        """Return its cycle in epochs, as `rrins.host_tools.hardware.faults.cycle_of` does."""
        if self.period_s is None:
            return ALWAYS
        return cycle_of(self.period_s, self.duty, 1_000_000_000 // rate_hz)


class FaultOfAxis(FaultOfHardware):
    """An axis of the turntable that fails."""

    kind: Literal["axis_stall", "axis_runaway", "encoder_stuck", "encoder_offset", "encoder_slip"]
    axis: Literal["inner", "outer"]
    rate_dps: float = _limited(HardwareFault.AXIS_RUNAWAY, 5.0)
    """Of a runaway."""
    offset_deg: float = _limited(HardwareFault.ENCODER_OFFSET, 1.0)
    """By which the encoder reads too high."""
    slip_percent: float = _limited(HardwareFault.ENCODER_SLIP, 1.0)
    """Share of the turning that the encoder misses."""

    @property
    def target(self) -> int:
        """Index of the axis."""
        return INNER if self.axis == "inner" else OUTER


class FaultOfSensor(FaultOfHardware):
    """A gyro or an accelerometer that fails."""

    kind: Literal[
        "gyro_stuck",
        "gyro_bias",
        "gyro_noise",
        "gyro_absent",
        "gyro_ramp",
        "gyro_scale",
        "gyro_shift_u",
        "gyro_shift_v",
        "gyro_dead",
        "gyro_full_scale",
        "accelerometer_stuck",
        "accelerometer_bias",
        "accelerometer_noise",
        "accelerometer_absent",
        "accelerometer_ramp",
        "accelerometer_scale",
        "accelerometer_shift_u",
        "accelerometer_shift_v",
        "accelerometer_dead",
        "accelerometer_full_scale",
    ]
    sensor: int | None = Field(default=None, ge=1, le=SENSOR_GROUPS)
    """From 1; all sensors of the kind by default."""
    bias_dph: float = _limited(HardwareFault.GYRO_BIAS, 10.0)
    bias_ug: float = _limited(HardwareFault.ACCELEROMETER_BIAS, 1000.0)
    angle_random_walk_deg_per_sqrt_h: float = _limited(HardwareFault.GYRO_NOISE, 1.0)
    white_noise_ug_per_sqrt_hz: float = _limited(HardwareFault.ACCELEROMETER_NOISE, 1000.0)
    bias_dph_per_min: float = _limited(HardwareFault.GYRO_RAMP, 1.0)
    bias_ug_per_min: float = _limited(HardwareFault.ACCELEROMETER_RAMP, 100.0)
    scale_ppm: float = _limited(HardwareFault.GYRO_SCALE, 10_000.0)
    """Additional error of the scale factor, of either kind of sensor."""
    shift_arcsec: float = _limited(HardwareFault.GYRO_SHIFT_U, 60.0)
    """Additional installation angle, of either kind of sensor."""

    @property
    def target(self) -> int:
        """Index of the sensor; `EVERY` for all of the kind."""
        return EVERY if self.sensor is None else self.sensor - 1


class FaultOfOdometer(FaultOfHardware):
    """An odometer that fails."""

    kind: Literal["odometer_slip", "odometer_lock", "odometer_lost"]
    slip_percent: float = _limited(HardwareFault.ODOMETER_SLIP, 10.0)
    """By which the wheel turns more than the vehicle moves."""

    @property
    def target(self) -> int:
        """`EVERY`: it is one thing."""
        return EVERY


DIRECTIONS = ("east", "north", "up")
"""Of a wrong position, by the target of its fault."""


class FaultOfGnss(FaultOfHardware):
    """A GNSS receiver that fails, or is deceived."""

    kind: Literal["gnss_jump", "gnss_pull", "gnss_lost"]
    direction: Literal["east", "north", "up"] | None = None
    """Of a jump or a pull; by default east."""
    jump_m: float = _limited(HardwareFault.GNSS_JUMP, 100.0)
    """By which positions are off."""
    pull_mps: float = _limited(HardwareFault.GNSS_PULL, 1.0)
    """At which positions, and velocities with them, are led away."""

    @model_validator(mode="before")
    @classmethod
    def _with_direction(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("kind") in ("gnss_jump", "gnss_pull"):
            return {"direction": "east"} | data
        return data

    @model_validator(mode="after")
    def _without_direction(self) -> FaultOfGnss:
        self._refuse_keys_of_other_kinds(self.kind, {"direction": ("gnss_jump", "gnss_pull")})
        return self

    @property
    def target(self) -> int:
        """Index of the direction; `EVERY` for a fault that has none."""
        return EVERY if self.direction is None else DIRECTIONS.index(self.direction)


AnyFault = Annotated[
    FaultOnWire | FaultOfAxis | FaultOfSensor | FaultOfOdometer | FaultOfGnss,
    Field(discriminator="kind"),
]
"""Any fault; `kind` tells them apart."""

KINDS: Final[dict[str, type[TomlTable]]] = {
    kind: table
    for table in (FaultOnWire, FaultOfAxis, FaultOfSensor, FaultOfOdometer, FaultOfGnss)
    for kind in get_args(table.model_fields["kind"].annotation)
}
"""The table that each kind of fault has."""
