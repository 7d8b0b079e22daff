"""Variants of the firmware: what its step does, and how large its memory is for that."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from rrins.compiled.record import Member, Record, Records
from rrins.firmware_py.core.navigation import inertial_alignment, transfer
from rrins.firmware_py.core.records.estimator_records import Estimator, EstimatorSecond
from rrins.firmware_py.core.records.integrity_records import Fault, Integrity
from rrins.firmware_py.core.records.memory import Antenna, InertialAlignment, Ram, Wheel
from rrins.firmware_py.core.records.redundancy_records import (
    Learner,
    Parity,
    ParityBefore,
    ParitySecond,
    Repair,
    Sums,
)
from rrins.firmware_py.core.records.transfer_records import Transfer

_OF_COMPARING = {Parity, ParityBefore, ParitySecond, Learner, Sums, Repair}
_OF_ESTIMATING = {Estimator, EstimatorSecond}
_OF_INTEGRITY = {Integrity, Fault}
_SMALL = 1600
"""Bytes up to which an array stays as it is."""


@dataclass(frozen=True)
class Variant:
    """The work of a step: it decides what is compiled, and what the memory has room for.

    Attributes
    ----------
    compares : bool
        Redundant sensors.
    estimates : bool
        Whether it has the estimator.
    bounds : bool
        Whether it states protection levels.
    has_odometer, has_antenna : bool
        Whether the wheel's, the antenna's way is kept.
    aligns_in_motion, is_transferred : bool
        How it aligns.
    is_whole : bool
        Whether the memory has room for all, as that of this machine's own code has.
    """

    compares: bool
    estimates: bool
    bounds: bool
    has_odometer: bool
    has_antenna: bool
    aligns_in_motion: bool
    is_transferred: bool
    is_whole: bool = False

    @classmethod
    def whole(cls, ram: Records[Ram]) -> Variant:
        """Return the variant that a memory at power-on asks for, with room for all."""
        asked = cls.of(ram)
        return cls(asked.compares, asked.estimates, True, True, True, True, True, is_whole=True)

    @classmethod
    def of(cls, ram: Records[Ram]) -> Variant:
        """Return the variant that a memory at power-on asks for."""
        state = ram[0]
        return cls(
            compares=bool(state.redundancy.enabled),
            estimates=bool(state.estimator.enabled),
            bounds=bool(state.integrity.enabled),
            has_odometer=bool(state.odometer.interval_epochs > 0),
            has_antenna=bool(state.antenna.present),
            aligns_in_motion=bool(inertial_alignment.is_wanted(state)),
            is_transferred=bool(transfer.is_wanted(state)),
        )

    @property
    def memory(self) -> np.dtype[np.void]:
        """The dtype of its memory: `Ram`, without room for what it never keeps."""
        if self.is_whole:
            return Ram.dtype
        unused: set[type[Record]] = set()
        for is_used, classes in (
            (self.compares, _OF_COMPARING),
            (self.estimates, _OF_ESTIMATING),
            (self.bounds, _OF_INTEGRITY),
            (self.has_odometer, {Wheel}),
            (self.has_antenna, {Antenna}),
            (self.aligns_in_motion, {InertialAlignment}),
            (self.is_transferred, {Transfer}),
        ):
            if not is_used:
                unused |= classes

        def is_short(owner: type[Record], member: Member) -> bool:
            return owner in unused and np.dtype([member.field()]).itemsize > _SMALL

        return Ram.sized(is_short)


def shortened(values: np.ndarray[Any, Any], dtype: np.dtype[Any]) -> np.ndarray[Any, Any]:
    """Return records in a variant of their dtype: of a shorter array its first elements."""
    short = np.zeros(values.shape, dtype)
    _shorten(values, short)
    return short


def _shorten(values: np.ndarray[Any, Any], short: np.ndarray[Any, Any]) -> None:
    if values.dtype == short.dtype and values.shape == short.shape:
        short[...] = values
    elif short.dtype.names is None:
        short[...] = values[tuple(slice(length) for length in short.shape)]
    else:
        values = values[tuple(slice(length) for length in short.shape)]
        for name in short.dtype.names:
            _shorten(cast(Any, values[name]), cast(Any, short[name]))
