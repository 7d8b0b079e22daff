"""Stimulation: increments from outside in the place of a sensor's, epoch by epoch.

A tool names `assembly.gyro_dtheta` or `assembly.accelerometer_dv` of a sensor in a list of data for
stimulation. Data that have come completely before a step are used in that step, and in no other.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Records
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.xcp.layout import MemoryField, by_path
from rrins.firmware_py.xcp.protocol import Fault, require

_DOUBLE = struct.Struct("<d")
_KINDS = (("gyros", "gyro_dtheta"), ("accelerometers", "accelerometer_dv"))


def targets() -> tuple[MemoryField, ...]:
    """Return the fields that can be stimulated."""
    return tuple(by_path()[f"assembly.{name}"] for _, name in _KINDS)


@dataclass(frozen=True)
class _Target:
    sensors: str
    increments: str
    index: int
    largest: float  #: increment that the sensor's frame can carry


class Stimulation:
    """Gives a tool's increments to the next step.

    Parameters
    ----------
    ram : Records[Ram]
    limits : tuple of float
        Largest increments of a gyro, rad, and an accelerometer, m/s.

    Attributes
    ----------
    epochs : int
        Epochs with increments of a tool.
    refused : int
        Increments that were not used, as no sensor could have sent them.
    """

    def __init__(self, ram: Records[Ram], limits: tuple[float, float]) -> None:
        self._given = ram["stimulation"]
        self._targets: dict[int, _Target] = {}
        for (sensors, increments), field, largest in zip(_KINDS, targets(), limits, strict=True):
            for k in range(SENSOR_GROUPS):
                address = field.address + _DOUBLE.size * k
                self._targets[address] = _Target(sensors, increments, k, largest)
        self.epochs = 0
        self.refused = 0

    def check(self, addresses: frozenset[int]) -> None:
        """Raise `XcpError` unless these bytes are whole increments."""
        covered = {
            byte
            for address in self._targets
            if (number := range(address, address + _DOUBLE.size)) and addresses.issuperset(number)
            for byte in number
        }
        require(bool(addresses) and covered == addresses, Fault.ACCESS_DENIED)

    def give(self, values: Mapping[int, int]) -> None:
        """Set the increments of the next step from bytes by address."""
        given = self._given[0]
        for address, target in self._targets.items():
            if address not in values:
                continue
            number = bytes(values[address + k] for k in range(_DOUBLE.size))
            (increment,) = _DOUBLE.unpack(number)
            if not np.isfinite(increment) or abs(increment) > target.largest:
                self.refused += 1
                continue
            given[target.increments][target.index] = increment
            given[target.sensors] |= 1 << target.index
        self.epochs += 1
