"""Calibration pages: of each segment a working page that a tool changes, and a reference page.

The reference page holds the values of power-on. A page is the numbers of `characteristics`; the
rest of a segment is the computer's own and stays. What a page says takes effect between two steps,
number by number: one of which only some bytes have come waits for the others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Records
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.xcp.characteristics import SEGMENTS, Characteristic, by_segment
from rrins.firmware_py.xcp.protocol import Fault, require

WORKING, REFERENCE = 0, 1
"""Numbers of the pages."""
PAGES = 2

_Bytes = NDArray[np.uint8]


class Segment:
    """A memory segment.

    Attributes
    ----------
    address, size : int
        Of the record, in the RAM image.
    computer_page, tool_page : int
        Pages that the computer uses and that the tool reads.
    """

    def __init__(self, name: str, image: _Bytes) -> None:
        assert Ram.dtype.fields is not None
        dtype, offset = Ram.dtype.fields[name][:2]
        self.name = name
        self.address, self.size = int(offset), dtype.itemsize
        self._live = image[self.address : self.address + self.size]
        self._number = np.full(self.size, -1)  # of the number that a byte belongs to
        self._numbers: list[tuple[slice, Characteristic]] = []
        for one in by_segment(name):
            for k in range(one.field.count):
                begin = one.field.address - self.address + k * one.field.dtype.itemsize
                place = slice(begin, begin + one.field.dtype.itemsize)
                self._number[place] = len(self._numbers)
                self._numbers.append((place, one))
        self._is_page = self._number >= 0
        self.power_on()

    def power_on(self) -> None:
        """Begin with the values of the RAM image on both pages."""
        self._pages = (self._live.copy(), self._live.copy())
        self._written = np.zeros(self.size, dtype=bool)
        self._draft = self._live.copy()
        self.computer_page = self.tool_page = WORKING

    def overlay(self, first: int, data: _Bytes) -> None:
        """Replace what of ``data``, read from byte `first` on, is on the tool's page."""
        part = slice(first, first + len(data))
        chosen = self._is_page[part]
        data[chosen] = self._pages[self.tool_page][part][chosen]

    def write(self, first: int, data: _Bytes, is_whole: bool = False) -> None:
        """Change the working page from byte `first` on.

        Parameters
        ----------
        first : int
        data : array of bytes
        is_whole : bool
            Whether numbers of which only some bytes are written do not wait for the others.

        Raises
        ------
        XcpError
            When a byte is not of a parameter, the tool does not see the working page, or a value
            is out of its limits; nothing has changed then.
        """
        part = slice(first, first + len(data))
        touched = np.unique(self._number[part]).tolist()
        require(touched[0] >= 0 and self.tool_page == WORKING, Fault.WRITE_PROTECTED)
        page = self._pages[WORKING]
        draft, written = self._draft, self._written
        for place, _ in (self._numbers[k] for k in touched):
            draft[place][~written[place]] = page[place][~written[place]]
        draft[part] = data
        written[part] = True
        due = [self._numbers[k] for k in touched if is_whole or written[self._numbers[k][0]].all()]
        is_within = all(_is_within(draft[place], one) for place, one in due)
        for place, _ in due:
            written[place] = False
            if is_within:
                page[place] = draft[place]
        require(is_within, Fault.OUT_OF_RANGE)
        self.apply()

    def restore(self) -> None:
        """Copy the reference page to the working page."""
        self._pages[WORKING][:] = self._pages[REFERENCE]
        self._written[:] = False
        self.apply()

    def apply(self) -> None:
        """Give the computer the numbers of its page."""
        self._live[self._is_page] = self._pages[self.computer_page][self._is_page]


def _is_within(number: _Bytes, one: Characteristic) -> bool:
    (value,) = number.copy().view("u1" if one.field.dtype == bool else one.field.dtype)
    return bool(one.minimum <= value <= one.maximum)


class Pages:
    """All segments.

    Parameters
    ----------
    ram : Records[Ram]
        One record, changed in place.
    """

    def __init__(self, ram: Records[Ram]) -> None:
        image = ram.view(np.uint8)
        self.segments = tuple(Segment(name, image) for name in SEGMENTS)

    def power_on(self) -> None:
        """Begin anew after a reset."""
        for segment in self.segments:
            segment.power_on()

    def segment(self, number: int) -> Segment:
        """Return a segment; `XcpError` is raised without one."""
        require(number < len(self.segments), Fault.SEGMENT_NOT_VALID)
        return self.segments[number]

    def overlay(self, address: int, data: _Bytes) -> None:
        """Replace what of bytes read from the RAM image is on the tool's pages."""
        for segment in self.segments:
            first = max(address, segment.address)
            end = min(address + len(data), segment.address + segment.size)
            if first < end:
                segment.overlay(first - segment.address, data[first - address : end - address])

    def write(self, address: int, data: bytes, is_whole: bool = False) -> None:
        """Change a working page, as `Segment.write` does."""
        values = np.frombuffer(data, dtype=np.uint8)
        for segment in self.segments:
            first = address - segment.address
            if first >= 0 and first + len(data) <= segment.size:
                segment.write(first, values, is_whole)
                return
        require(False, Fault.WRITE_PROTECTED)
