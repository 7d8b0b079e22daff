"""The calibration file: parameters as bytes, with a CRC.

===========  ==================  ================================================================
bytes        type                what
===========  ==================  ================================================================
0            ``RRCA``            what it is
4            u16                 version of the format, 1
6            u16                 entries
8            per entry           u16 data identifier, u16 length, the data record
at the end   u32                 CRC-32 (ISO-HDLC, as in zlib) of all preceding bytes
===========  ==================  ================================================================

Numbers are big-endian. A data record is what ReadDataByIdentifier gives for the parameter.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping

from rrins.firmware_py.diagnostics.codecs import LengthError, ValueRangeError, Values
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.parameters import PARAMETERS

MAGIC = b"RRCA"
VERSION = 1

_HEAD = struct.Struct(">4sHH")
_ENTRY = struct.Struct(">HH")
_CRC = struct.Struct(">I")

_PARAMETERS = {parameter.number: parameter for parameter in PARAMETERS}

Parameters = dict[int, Values]
"""Values of parameters, by data identifier."""


class ImageError(ValueError):
    """The bytes are not a calibration file, or are damaged."""


def encode(parameters: Mapping[int, Values]) -> bytes:
    """Return the calibration file of parameters, ordered by number.

    Raises
    ------
    ImageError
        When a number does not belong to a parameter.
    ValueRangeError
        When values are missing, unknown, or do not fit.
    """
    body = bytearray(_HEAD.pack(MAGIC, VERSION, len(parameters)))
    for number, values in sorted(parameters.items()):
        data = _parameter(number).encode(values)
        body += _ENTRY.pack(number, len(data)) + data
    return bytes(body) + _CRC.pack(zlib.crc32(body))


def _parameter(number: int) -> DataIdentifier:
    parameter = _PARAMETERS.get(number)
    if parameter is None:
        raise ImageError(f"0x{number:04X} is not a parameter")
    return parameter


def entries(image: bytes) -> list[tuple[int, bytes]]:
    """Return numbers and data records of a calibration file.

    Raises
    ------
    ImageError
        When it is not a calibration file, has another version, is damaged, or repeats a number.
    """
    if len(image) < _HEAD.size + _CRC.size or not image.startswith(MAGIC):
        raise ImageError("not a calibration file")
    body, (crc,) = image[: -_CRC.size], _CRC.unpack(image[-_CRC.size :])
    if zlib.crc32(body) != crc:
        raise ImageError("CRC mismatch")
    _, version, count = _HEAD.unpack_from(body)
    if version != VERSION:
        raise ImageError(f"version {version}, not {VERSION}")
    found = list(_split(body))
    if len(found) != count or len({number for number, _ in found}) != count:
        raise ImageError(f"{len(found)} entries with duplicates, not {count}")
    return found


def _split(body: bytes) -> Iterator[tuple[int, bytes]]:
    start = _HEAD.size
    while start < len(body):
        if start + _ENTRY.size > len(body):
            raise ImageError("an entry is cut off")
        number, length = _ENTRY.unpack_from(body, start)
        start += _ENTRY.size
        if start + length > len(body):
            raise ImageError("an entry is cut off")
        yield number, body[start : start + length]
        start += length


def checked(number: int, data: bytes) -> Values:
    """Return the values of a parameter's data record.

    Raises
    ------
    ImageError
        When the number does not belong to a parameter, the length is wrong, or a value is beyond
        its limits.
    """
    parameter = _parameter(number)
    try:
        values = parameter.decode(data)
        parameter.layout.check(values)
    except (LengthError, ValueRangeError) as error:
        raise ImageError(f"{parameter.name}: {error}") from error
    return values


def decode(image: bytes) -> Parameters:
    """Return the parameters in a calibration file.

    Raises
    ------
    ImageError
        When it is not a calibration file, is damaged, or has an unknown parameter or a value
        beyond its limits.
    """
    return {number: checked(number, data) for number, data in entries(image)}


def tolerated(image: Iterable[tuple[int, bytes]]) -> tuple[Parameters, bool]:
    """Return the valid parameters among `entries`, and whether all are valid."""
    parameters: Parameters = {}
    is_whole = True
    for number, data in image:
        try:
            parameters[number] = checked(number, data)
        except ImageError:
            is_whole = False
    return parameters, is_whole
