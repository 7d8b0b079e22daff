"""Every request that the firmware understands, with its response, from the diagnostic table.

This module knows nothing of ODX: an exchange consists of the table's own fields and a few parts
that they cannot express.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from rrins.firmware_py.core.records.troubles import ALL_RECORDS
from rrins.firmware_py.diagnostics import access, table
from rrins.firmware_py.diagnostics.access import Access, Session
from rrins.firmware_py.diagnostics.codecs import Field
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.identifiers import IOControl
from rrins.firmware_py.diagnostics.responses import SUPPRESS_BIT, Service
from rrins.firmware_py.diagnostics.routines import Routine

IDENTIFIERS: Final = "identifiers"
EXTENDED_DATA: Final = "extended_data"


@dataclass(frozen=True)
class Constant:
    """A number that is always the same; big-endian."""

    name: str
    value: int
    size: int = 1  #: bytes


@dataclass(frozen=True)
class Bytes:
    """Bytes without a meaning of their own."""

    name: str
    size: int | None = None  #: None: all that follow
    least: int = 0  #: without a size
    most: int | None = None  #: without a size


@dataclass(frozen=True)
class Code:
    """The number of a trouble code."""

    name: str = "dtc"


@dataclass(frozen=True)
class StatusByte:
    """The status byte of a trouble code: a bit for each of its states."""

    name: str = "status"


@dataclass(frozen=True)
class Number:
    """The number of a data identifier."""

    name: str = "identifier"


@dataclass(frozen=True)
class Record:
    """A number and the values that belong to it."""

    name: str
    of: str  #: which numbers: `IDENTIFIERS` or `EXTENDED_DATA`


@dataclass(frozen=True)
class Repeated:
    """Parts that recur: until the end, or as often as the byte before says."""

    name: str
    parts: tuple[Part, ...]
    is_counted: bool = False


Part = Field | Constant | Bytes | Code | StatusByte | Number | Record | Repeated


@dataclass(frozen=True)
class Exchange:
    """A request and its positive response."""

    name: str
    text: str
    service: Service
    access: Access
    request: tuple[Part, ...]  #: after the service identifier
    #: after the service identifier; None if the request asks for no positive response
    response: tuple[Part, ...] | None
    enters: Session | None = None  #: the session that the response begins
    unlocks: bool = False


_ADDRESS_FORMAT = 0x44  # four bytes of address and size
_MEMORY_FORMAT = 0x24  # four bytes of address, two of size
_PLAIN = 0x00  # neither compressed nor encrypted
_LENGTH_FORMAT = 0x20  # of maxNumberOfBlockLength
_COUNTER = Field("block_sequence_counter", "u8", text="of the blocks, from 1; 255 is followed by 0")
_CRC = Field("crc32", "u32", text="of all data of the transfer")
_MASK = Field("status_mask", "u8", text="trouble codes with any of these status bits")
_SUPPORTED = Field("status_availability_mask", "u8", text="status bits that the computer supports")
_RECORD_NUMBER = Field("record_number", "u8", text=f"0x{ALL_RECORDS:02X}: all")
_TYPES = Field(
    "communication_type",
    "u8",
    minimum=0x01,
    maximum=0x03,
    text="1: normal messages, 2: network management, 3: both",
)
_SUBFUNCTION, _IDENTIFIER, _OPTION = "sub_function", "identifier", "control_option"
_QUIET = (0x10, 0x11, 0x28, 0x3E, 0x85)  # whose positive response tools suppress


def exchanges() -> Iterator[Exchange]:
    """Yield all exchanges; names are unique."""
    yield from _with_subfunctions()
    yield from _data()
    yield from _troubles()
    for routine in table.ROUTINES:
        yield from _routine(routine)
    yield from _transfers()


def _with_subfunctions() -> Iterator[Exchange]:
    """Yield the services with a sub-function and fixed data, and their quiet variants."""
    request: dict[int, tuple[Part, ...]] = {0x28: (_TYPES,)}
    response: dict[int, tuple[Part, ...]] = {
        0x10: (
            Field("p2_ms", "u16", "ms", text="P2server_max"),
            Field("p2_star_10ms", "u16", text="P2*server_max, in steps of 10 ms"),
        )
    }
    for number in _QUIET:
        service = table.service(number)
        for chosen, name in service.subfunctions.items():
            enters = Session(chosen) if number == 0x10 else None
            rights = service.only_in.get(chosen, service.access)
            full = f"{_snake(service.name)}_{_snake(name)}"
            own = request.get(number, ())
            echo = Constant(_SUBFUNCTION, chosen)
            text = f"{service.text} Sub-function {name}."
            yield Exchange(
                full, text, service, rights, (echo, *own), (echo, *response.get(number, ())), enters
            )
            quiet = Constant(_SUBFUNCTION, chosen | SUPPRESS_BIT)
            yield Exchange(
                f"{full}_quiet",
                f"{text} Without a positive response.",
                service,
                rights,
                (quiet, *own),
                None,
                enters,
            )
    yield from _security()


def _security() -> Iterator[Exchange]:
    service = table.service(0x27)
    seed = Constant(_SUBFUNCTION, access.SEED_SUBFUNCTION)
    key = Constant(_SUBFUNCTION, access.KEY_SUBFUNCTION)
    yield Exchange("security_access_request_seed", f"{service.text} All zero: it is unlocked.",
        service, service.access, (seed,), (seed, Bytes("seed", access.SEED_SIZE)))  # fmt: skip
    yield Exchange("security_access_send_key", service.text,
        service, service.access, (key, Bytes("key", access.KEY_SIZE)), (key,),
        unlocks=True)  # fmt: skip


def _data() -> Iterator[Exchange]:
    """Yield what reads, writes and controls identifiers, and reads the memory."""
    read = table.service(0x22)
    for did in table.IDENTIFIERS:
        number = _number_of(did)
        yield Exchange(f"read_{did.name}", did.text, read, did.read,
            (number,), (number, *did.fields))  # fmt: skip
    yield Exchange("read_identifiers", f"{read.text} The response has those that exist.",
        read, read.access, (Repeated("identifiers", (Number(),)),),
        (Repeated("records", (Record("record", IDENTIFIERS),)),))  # fmt: skip
    for did in table.IDENTIFIERS:
        if did.write is not None:
            number = _number_of(did)
            yield Exchange(f"write_{did.name}", f"{did.text} Takes effect at the next reset.",
                table.service(0x2E), did.write, (number, *did.fields), (number,))  # fmt: skip
        if did.control is not None:
            yield from _control(did, did.control)
    memory = table.service(0x23)
    yield Exchange("read_memory", memory.text, memory, memory.access,
        (Constant("length_formats", _MEMORY_FORMAT), Field("address", "u32"),
            Field("size", "u16", "bytes", minimum=1, maximum=access.MESSAGE_CAPACITY - 1)),
        (Bytes("data", least=1),))  # fmt: skip


def _control(did: DataIdentifier, rights: Access) -> Iterator[Exchange]:
    number = _number_of(did)
    for option in IOControl:
        how = Constant(_OPTION, option)
        own = did.fields if option == IOControl.SHORT_TERM_ADJUSTMENT else ()
        yield Exchange(f"control_{did.name}_{option.name.lower()}", did.text, table.service(0x2F),
            rights, (number, how, *own), (number, how, *did.fields))  # fmt: skip


def _troubles() -> Iterator[Exchange]:
    clear = table.service(0x14)
    yield Exchange("clear_trouble_codes", clear.text, clear, clear.access,
        (Field("group_of_dtc", "u24", text="0xFFFFFF: all"),), ())  # fmt: skip
    listed = Repeated("trouble_codes", (Code(), StatusByte()))
    one = (Code(), _RECORD_NUMBER)
    kinds: dict[int, tuple[tuple[Part, ...], tuple[Part, ...]]] = {
        0x01: ((_MASK,), (_SUPPORTED, Field("format", "u8"), Field("count", "u16"))),
        0x02: ((_MASK,), (_SUPPORTED, listed)),
        0x03: ((), (Repeated("records", (Code(), Field("record_number", "u8"))),)),
        0x04: (one, (Code(), StatusByte(), Repeated("freeze_frames", (
            Field("record_number", "u8"),
            Repeated("values", (Record("record", IDENTIFIERS),), is_counted=True))))),
        0x06: (one, (Code(), StatusByte(),
            Repeated("extended_data", (Record("record", EXTENDED_DATA),)))),
        0x0A: ((), (_SUPPORTED, listed)),
        0x14: ((), (Repeated("trouble_codes",
            (Code(), Field("fault_detection_counter", "u8"))),)),
    }  # fmt: skip
    service = table.service(0x19)
    for chosen, name in service.subfunctions.items():
        request, response = kinds[chosen]
        echo = Constant(_SUBFUNCTION, chosen)
        yield Exchange(_snake(name), f"{service.text} Sub-function {name}.",
            service, service.access, (echo, *request), (echo, *response))  # fmt: skip


def _routine(routine: Routine) -> Iterator[Exchange]:
    service = table.service(0x31)
    number = Constant("routine", routine.number, 2)
    for chosen, name in service.subfunctions.items():
        if name == "stopRoutine" and not routine.can_stop:
            continue
        echo = Constant(_SUBFUNCTION, chosen)
        own = routine.arguments if name == "startRoutine" else ()
        verb = {"startRoutine": "start", "stopRoutine": "stop"}.get(name, "result_of")
        yield Exchange(f"{verb}_{routine.name}", routine.text, service, routine.access,
            (echo, number, *own), (echo, number, *routine.results))  # fmt: skip


def _transfers() -> Iterator[Exchange]:
    accepted = (
        Constant("length_format", _LENGTH_FORMAT),
        Field("most_block_length", "u16", "bytes", text="of TransferData, with its two first"),
    )
    for number, name in ((0x34, "request_download"), (0x35, "request_upload")):
        service = table.service(number)
        yield Exchange(name, service.text, service, service.access,
            (Constant("data_format", _PLAIN), Constant("length_formats", _ADDRESS_FORMAT),
                Field("address", "u32"), Field("size", "u32", "bytes")), accepted)  # fmt: skip
    block, ending = table.service(0x36), table.service(0x37)
    yield Exchange("transfer_data", f"{block.text} The data are in the request of a download, and "
        "in the response of an upload.", block, block.access,
        (_COUNTER, Bytes("data")), (_COUNTER, Bytes("data")))  # fmt: skip
    yield Exchange("request_transfer_exit", f"{ending.text} An upload needs no CRC in the request.",
        ending, ending.access, (Bytes(_CRC.name, most=_CRC.size),), (_CRC,))  # fmt: skip


def _number_of(did: DataIdentifier) -> Constant:
    return Constant(_IDENTIFIER, did.number, 2)


def _snake(name: str) -> str:
    """Return a name of ISO 14229-1 such as ``hardReset`` or ``ECUReset`` in lower case."""
    letters = []
    for k, letter in enumerate(name):
        before, after = name[k - 1 : k], name[k + 1 : k + 2]
        starts = letter.isupper() and (before.islower() or (before.isupper() and after.islower()))
        letters.append(f"_{letter.lower()}" if starts else letter.lower())
    return "".join(letters)
