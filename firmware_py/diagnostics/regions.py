"""The table of memory regions: the RAM image, and the calibration file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rrins.firmware_py.diagnostics.access import EXTENDED, Access

CALIBRATION_ADDRESS = 0x1000_0000
"""Address of the calibration file in RequestDownload and RequestUpload."""

CALIBRATION_CAPACITY = 0x4000
"""Largest calibration file, bytes."""

BLOCK_LENGTH = 1026
"""maxNumberOfBlockLength: longest TransferData, including its two leading bytes."""


@dataclass(frozen=True)
class Region:
    """A part of the memory.

    Attributes
    ----------
    address, size : int
        In bytes.
    """

    name: str
    address: int
    size: int
    access: Access  #: of ReadMemoryByAddress
    dtype: np.dtype[np.generic]  #: of the contents, little-endian


def regions_of(ram: np.dtype[np.void]) -> tuple[Region, ...]:
    """Return the regions of a RAM image: the whole, and each of its fields."""
    assert ram.fields is not None
    whole = Region("ram", 0, ram.itemsize, EXTENDED, ram)
    parts = (
        Region(name, int(offset), dtype.itemsize, EXTENDED, dtype)
        for name, (dtype, offset, *_) in ram.fields.items()
    )
    return whole, *parts
