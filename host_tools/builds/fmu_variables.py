"""Variables of an FMU: what it shows of a side's memory, and the parameters that change it.

What is shown is named here; its type, unit and meaning are the record's. The hardware's parameters
are the keys of a scenario: what a key does to the memory is found by setting the hardware up with
other values of it. A key that does something else than change numbers in proportion is none.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args, get_origin

import numpy as np
from pydantic import BaseModel

from rrins.compiled.record import Floats, Record
from rrins.firmware_py.core.records.memory import Ram
from rrins.host_tools.builds.images import Images
from rrins.host_tools.hardware.memory import Plant
from rrins.host_tools.hardware.settings import Settings, power_on
from rrins.host_tools.hardware.units import split
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.schema import meaning

SHOWN: dict[str, tuple[str, ...]] = {
    "hardware": (
        "truth", "dtheta_s", "dv_s", "axis.angle", "axis.rate", "gyros.counts",
        "accelerometers.counts", "counters",
    ),
    "firmware": (
        "navigation", "dtheta_s", "dv_s", "assembly.gyro_dtheta", "assembly.accelerometer_dv",
        "assembly.encoder_angle_deg", "sequencer.command", "sequencer.target_angle_deg",
        "modes.mode", "faults",
    ),
}  # fmt: skip
"""Fields of each side's memory that are outputs."""

_LINK = re.compile(r"\[(.*?)\]\(.*?\)")
_UNIT = re.compile(r"(rad/s²|rad/s|m/s²|m/s|rad|m|s|ns|ppm)(?=[,;]|$)")


@dataclass(frozen=True)
class Variable:
    """A number that an FMU shows or takes.

    Attributes
    ----------
    name, text, unit : str
        The unit may be empty.
    is_integer : bool
    offset : int
        Of a number in memory; -1 of a parameter.
    start : float, optional
        Of a parameter.
    """

    name: str
    text: str
    unit: str = ""
    is_integer: bool = False
    offset: int = -1
    start: float | None = None


@dataclass(frozen=True)
class Effect:
    """A number in memory that follows parameters: ``base + Σ slope × parameter``."""

    offset: int
    parameter: int  #: index
    slope: float
    base: float = 0.0  #: of the first with its offset


@dataclass(frozen=True)
class Variables:
    """All that an FMU has beside its frames.

    Attributes
    ----------
    outputs, parameters : sequence of Variable
        The first parameter is what the shell has a part in: other noise, or the clock's error.
    effects : sequence of Effect
        Of the parameters, by offset.
    flags : sequence of Effect
        Bytes that become 1 as a parameter gets another value than its start.
    noises : sequence of int
        Offsets of the states of random numbers.
    """

    outputs: Sequence[Variable]
    parameters: Sequence[Variable]
    effects: Sequence[Effect]
    flags: Sequence[Effect] = ()
    noises: Sequence[int] = ()


def firmware_variables(scenario: Scenario, images: Images) -> Variables:
    """Return those of the firmware: parameters are the numbers of its set-up."""
    found = list(_numbers(Ram, images.ram.dtype, ("parameters",)))
    single = [one for one in found if not one.is_integer and "[" not in one.name]
    memory = images.ram.tobytes()
    fast = scenario.firmware.clock_error_ppm
    error = Variable("clock_error_ppm", "By how much its clock runs fast.", "ppm", start=fast)
    return Variables(
        _shown("firmware", Ram, images.ram.dtype),
        (error, *(replace(one, start=_number(memory, one.offset), offset=-1) for one in single)),
        [Effect(one.offset, k, 1.0) for k, one in enumerate(single, 1)],
    )


def hardware_variables(settings: Settings) -> Variables:
    """Return those of the hardware: parameters are the keys of its tables."""
    seed = Variable("seed", "Draws other noise than the scenario's if not 0.", "", True, start=0)
    settings = _with_numbers_by_sensor(settings)
    probe = _Probe(settings)
    parameters: list[Variable] = [seed]
    effects: list[Effect] = []
    flags: list[Effect] = []
    for path, table in _tables(settings, ()):
        for key in type(table).model_fields:
            value = getattr(table, key)
            for place in range(len(value)) if isinstance(value, tuple) else (None,):
                found = probe.effects((*path, key), place, len(parameters))
                if found[0]:
                    parameters.append(_parameter(path, table, key, place))
                    effects += found[0]
                    flags += found[1]
    states = (one for one in _numbers(Plant, Plant.dtype) if ".noise_state[" in one.name)
    return Variables(
        _shown("hardware", Plant, Plant.dtype),
        parameters,
        _with_bases(effects, parameters, probe.image),
        flags,
        [one.offset for one in states],
    )


class _Probe:
    """Sets the hardware up with other values of a key, to see what they do.

    Attributes
    ----------
    image : bytes
        The memory without other values.
    """

    _TRIED = 1.0, 2.0, 24.0
    _TOLERANCE = 1e-9

    def __init__(self, settings: Settings) -> None:
        leaves = tuple(_numbers(Plant, Plant.dtype, (), ("<f8", "?")))
        self._settings = settings
        self._numbers = np.array([one.offset for one in leaves if not one.is_integer])
        self._flags = np.array([one.offset for one in leaves if one.is_integer])
        self.image = power_on(settings).tobytes()

    def effects(
        self, path: Sequence[str], place: int | None, parameter: int
    ) -> tuple[list[Effect], list[Effect]]:
        """Return the effects of a key on numbers and on flags; none if it is not a parameter.

        Parameters
        ----------
        path : sequence of str
            Of the key.
        place : int, optional
            In a value of several numbers.
        parameter : int
            Its index.
        """
        value = _value(self._settings, path)
        start = value if place is None else value[place]
        nothing: tuple[list[Effect], list[Effect]] = [], []
        if not isinstance(start, float):
            return nothing
        images = [self._with(path, place, tried) for tried in self._TRIED]
        rest, flags, f0 = self._parts(self.image)
        parts = [self._parts(image) for image in images]
        if any(other != rest for other, _, _ in parts):
            return nothing
        f1, f2, f24 = (numbers for _, _, numbers in parts)
        slope = np.where(f2 == 2 * f1, f1, f2 - f1)
        bound = self._TOLERANCE * (np.abs(f1) + np.abs(slope))
        for at, numbers in (self._TRIED[2], f24), (start, f0):
            if np.any(np.abs(f1 + (at - 1) * slope - numbers) > bound):
                return nothing
        raised = self._flags[(parts[0][1] != 0) & (flags == 0)]
        changed = np.flatnonzero(slope * (f1 != f2))
        return (
            [Effect(int(self._numbers[k]), parameter, float(slope[k])) for k in changed],
            [Effect(int(at), parameter, 1.0) for at in raised],
        )

    def _with(self, path: Sequence[str], place: int | None, number: float) -> bytes:
        value: Any = number
        if place is not None:
            old = _value(self._settings, path)
            value = (*old[:place], number, *old[place + 1 :])
        return power_on(_changed(self._settings, path, value)).tobytes()

    def _parts(self, image: bytes) -> tuple[bytes, Any, Floats]:
        """Return what of a memory is neither number nor flag, its flags, its numbers."""
        memory = np.frombuffer(image, np.uint8).copy()
        places = self._numbers[:, None] + np.arange(8)
        numbers, flags = memory[places].view("<f8")[:, 0], memory[self._flags]
        memory[places] = 0
        memory[self._flags] = 0
        return memory.tobytes(), flags, numbers


def _with_bases(
    effects: Sequence[Effect], parameters: Sequence[Variable], image: bytes
) -> list[Effect]:
    """Return effects by offset, the first of each with the number that the others add to."""
    by_offset: dict[int, list[Effect]] = {}
    for effect in effects:
        by_offset.setdefault(effect.offset, []).append(effect)
    found = []
    for offset, group in sorted(by_offset.items()):
        terms = [each.slope * (parameters[each.parameter].start or 0.0) for each in group]
        base = _number(image, offset) - sum(terms)
        if abs(base) < 1e-9 * max(map(abs, terms)):
            base = 0.0
        found += [replace(group[0], base=base), *group[1:]]
    return found


def _number(image: bytes, offset: int) -> float:
    return float(np.frombuffer(image, "<f8", 1, offset)[0])


def _shown(side: str, kind: type[Record], dtype: np.dtype[np.void]) -> list[Variable]:
    return [one for path in SHOWN[side] for one in _numbers(kind, dtype, tuple(path.split(".")))]


def _numbers(
    kind: type[Record],
    dtype: np.dtype[np.void],
    path: tuple[str, ...] = (),
    kinds: Sequence[str] = ("<f8", "<i8", "<u8"),
    name: str = "",
    offset: int = 0,
) -> Iterator[Variable]:
    """Return the numbers of a record of some kinds, below a path of fields."""
    assert dtype.fields is not None
    texts = kind.texts()
    for member in kind.members():
        if path and member.name != path[0]:
            continue
        field, at = dtype.fields[member.name][:2]
        for k, place in enumerate(np.ndindex(field.shape)):
            index = f"[{','.join(str(i + 1) for i in place)}]" if place else ""
            here = offset + at + k * field.base.itemsize
            full = f"{name}{member.name}{index}"
            if not isinstance(member.kind, str):
                yield from _numbers(member.kind, field.base, path[1:], kinds, f"{full}.", here)
            elif member.kind in kinds:
                text = texts.get(member.name, "")
                yield Variable(full, text, _unit(member.name, text), member.kind != "<f8", here)


def _unit(name: str, text: str) -> str:
    found = _UNIT.match(text)
    return found[0] if found else split(name)[1].symbol


def _parameter(path: Sequence[str], table: BaseModel, key: str, place: int | None) -> Variable:
    value = getattr(table, key)
    index = "" if place is None else f"[{place + 1}]"
    return Variable(
        ".".join((*path, key)) + index,
        _LINK.sub(r"\1", meaning(type(table), key)),
        split(key)[1].symbol,
        start=value if place is None else value[place],
    )


def _tables(owner: object, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], BaseModel]]:
    """Return the tables within settings or within a table, with their paths."""
    for name, value in vars(owner).items():
        if isinstance(value, BaseModel):
            yield (*path, name), value
            yield from _tables(value, (*path, name))


def _with_numbers_by_sensor(settings: Settings) -> Settings:
    """Return settings with a number for each sensor where one stands for all."""
    for name, axes in (
        ("gyros", settings.gyro_axes_deg),
        ("accelerometers", settings.accelerometer_axes_deg),
    ):
        table: BaseModel = getattr(settings, name)
        for key, field in type(table).model_fields.items():
            value = getattr(table, key)
            is_by_sensor = any(get_origin(one) is tuple for one in get_args(field.annotation))
            if is_by_sensor and isinstance(value, float):
                settings = _changed(settings, (name, key), (value,) * len(axes))
    return settings


def _value(owner: object, path: Sequence[str]) -> Any:
    return functools.reduce(getattr, path, owner)


def _changed(owner: Any, path: Sequence[str], value: object) -> Any:
    """Return settings or a table with another value of a key."""
    head, *rest = path
    new = _changed(getattr(owner, head), rest, value) if rest else value
    if isinstance(owner, BaseModel):
        return owner.model_copy(update={head: new})
    return replace(owner, **{head: new})
