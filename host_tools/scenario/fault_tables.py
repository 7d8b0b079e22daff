"""The tables `[[faults]]` of a scenario, made from the kinds of fault of hardware and wire."""

from __future__ import annotations

import difflib
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Self

from pydantic import Field, create_model, model_validator

from rrins.dbc.codec import load as load_codec
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.host_tools.hardware.fault_kinds import EVERY, HardwareFault, Parameter, Target
from rrins.host_tools.hardware.faults import ALWAYS, cycle_of
from rrins.host_tools.hardware.settings import PlannedFault
from rrins.host_tools.hardware.tables import TomlTable
from rrins.host_tools.scenario.tables import LONGEST_S
from rrins.host_tools.wire.effects import ANY_IDENTIFIER, Node
from rrins.host_tools.wire.fault_kinds import FaultKind, to_number
from rrins.host_tools.wire.faults import WireFault


class _Fault(TomlTable):
    """When a fault is present, and the value of its kind's parameter."""

    kind: str
    """Which fault it is."""
    at_s: float = Field(default=0.0, ge=0, le=LONGEST_S)
    """After power-on of the hardware."""
    for_s: float | None = Field(
        default=None,
        gt=0,
        le=LONGEST_S,
        description="Duration in simulated seconds.  [default: until removed]",
    )

    @model_validator(mode="before")
    @classmethod
    def _has_keys_of_its_kind(cls, data: Any) -> Any:
        """Refuse keys of other kinds; older recordings have some, with their defaults."""
        if not isinstance(data, dict):
            return data
        own = dict(data)
        for key in data.keys() - cls.model_fields.keys():
            fields = {k: t.model_fields[key] for k, t in KINDS.items() if key in t.model_fields}
            if any(data[key] == field.default for field in fields.values()):
                del own[key]
            elif fields:
                others = ", ".join([*fields][:5]) + (" …" if len(fields) > 5 else "")
                raise ValueError(f"{key}: does not apply to {data['kind']}, only to {others}")
        return own

    def epochs(self, rate_hz: int) -> tuple[int, int]:
        """Return the first and the last epoch; -1 as the last means to the end."""
        first = round(self.at_s * rate_hz)
        if self.for_s is None:
            return first, -1
        return first, first + max(1, round(self.for_s * rate_hz)) - 1


class FaultOnWire(_Fault):
    """A fault on the wire."""

    message: str | None = Field(
        default=None, description="Wire: message concerned, such as SENSOR_3.  [default: all]"
    )
    node: Literal["any", "firmware", "hardware"] = Field(
        default="any",
        description="Wire: sender concerned: any, firmware or hardware.  [default: any]",
    )
    probability: float = Field(
        default=1.0, gt=0, le=1, description="Wire: fraction of the frames affected."
    )

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.message is not None and self.message not in _message_names():
            near = difflib.get_close_matches(self.message, _message_names(), 1)
            hint = f", did you mean {near[0]}?" if near else ""
            raise ValueError(f"message: the DBC has no {self.message}{hint}")
        return self

    @property
    def wire_kind(self) -> FaultKind:
        """The kind, as the wire knows it."""
        return FaultKind[self.kind.upper()]

    def fault(self, rate_hz: int) -> WireFault:
        """Return the fault, its times in epochs."""
        first, last = self.epochs(rate_hz)
        parameter = self.wire_kind.parameter
        value = None if parameter is None else getattr(self, parameter.key)
        return WireFault(
            kind=self.wire_kind,
            node=Node[self.node.upper()],
            identifier=(
                ANY_IDENTIFIER if self.message is None else load_codec().frame_id(self.message)
            ),
            first_epoch=first,
            last_epoch=last,
            probability=self.probability,
            parameter=to_number(parameter, value, rate_hz),
        )


def _message_names() -> list[str]:
    return [message.name for message in load_codec().facts.messages]


class FaultOfHardware(_Fault):
    """A failure of the hardware."""

    period_s: float | None = Field(
        default=None, gt=0, le=LONGEST_S, description="Hardware: intermittent, period in s."
    )
    duty: float = Field(
        default=0.5, gt=0, lt=1, description="Share of the period with the fault.  [default: 0.5]"
    )

    @model_validator(mode="after")
    def _intermittent(self) -> Self:
        if self.period_s is None and self.duty != type(self).model_fields["duty"].default:
            raise ValueError("duty: needs period_s")
        return self

    @property
    def hardware_kind(self) -> HardwareFault:
        """The kind, as the hardware knows it."""
        return HardwareFault[self.kind.upper()]

    @property
    def target(self) -> int:
        """Index of the axis, the sensor or the direction; `EVERY` for all and for one thing."""
        key = self.hardware_kind.target
        found = None if key is None else getattr(self, key.key)
        if key is None or found is None:
            return EVERY
        return key.names.index(found) if key.names else int(found) - 1

    @property
    def value(self) -> float:
        """The kind's value, in the unit of its key; 0 for a kind that has none."""
        parameter = self.hardware_kind.parameter
        return 0.0 if parameter is None else float(getattr(self, parameter.key))

    def planned(self, rate_hz: int) -> PlannedFault:
        """Return the fault, its times in epochs, its value in SI units."""
        kind = self.hardware_kind
        value = 0.0 if kind.parameter is None else self.value * kind.parameter.si
        return PlannedFault(kind, self.target, *self.epochs(rate_hz), value, self.cycle(rate_hz))

    def cycle(self, rate_hz: int) -> tuple[int, int]:
        """Return its cycle in epochs, as `rrins.host_tools.hardware.faults.cycle_of` does."""
        if self.period_s is None:
            return ALWAYS
        return cycle_of(self.period_s, self.duty, 1_000_000_000 // rate_hz)


def _field_of_target(target: Target) -> Any:
    if not target.names:
        text = "Gyro or accelerometer that fails, from 1.  [default: all]"
        return int | None, Field(default=None, ge=1, le=SENSOR_GROUPS, description=text)
    default = ... if target.is_needed else target.default
    text = f"{target.key}: {', '.join(target.names)}."
    text += "" if target.is_needed else f"  [default: {default}]"
    return Literal[target.names], Field(default=default, description=text)


def _field_of_parameter(parameter: Parameter) -> Any:
    number = int if parameter.is_whole else float
    default = parameter.default
    return number if default is not None else number | None, Field(
        default=default,
        ge=parameter.minimum,
        le=parameter.maximum,
        description=f"{parameter.unit}.",
    )


def _tables() -> dict[str, type[FaultOnWire] | type[FaultOfHardware]]:
    """Return the table of each kind; kinds with the same keys share one."""
    alike: dict[Any, list[str]] = {}
    for kind in (*FaultKind, *HardwareFault):
        target = kind.target if isinstance(kind, HardwareFault) else None
        alike.setdefault((type(kind), target, kind.parameter), []).append(kind.word)
    found: dict[str, type[FaultOnWire] | type[FaultOfHardware]] = {}
    for (of, target, parameter), words in alike.items():
        fields: dict[str, Any] = {"kind": (Literal[tuple(words)], ...)}
        if target is not None:
            fields[target.key] = _field_of_target(target)
        if parameter is not None:
            fields[parameter.key] = _field_of_parameter(parameter)
        base: Any = FaultOnWire if of is FaultKind else FaultOfHardware
        table = create_model(f"{base.__name__}_{words[0]}", __base__=base, **fields)
        found |= dict.fromkeys(words, table)
    return {kind.word: found[kind.word] for kind in (*FaultKind, *HardwareFault)}


KINDS: Final = _tables()
"""The table that each kind of fault has."""

if TYPE_CHECKING:
    AnyFault = FaultOnWire | FaultOfHardware
else:
    AnyFault = Annotated[reduce(or_, KINDS.values()), Field(discriminator="kind")]
"""Any fault; `kind` tells them apart."""
