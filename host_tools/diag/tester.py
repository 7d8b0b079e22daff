"""Requests to the navigation computer, in terms of the diagnostic table."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from udsoncan import DataFormatIdentifier, Dtc, MemoryLocation

from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.records.troubles import (
    ALL_GROUPS,
    ALL_RECORDS,
    FIRST_SNAPSHOT,
    LATEST_SNAPSHOT,
)
from rrins.firmware_py.diagnostics import access, table
from rrins.firmware_py.diagnostics.codecs import Value, Values
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.identifiers import IOControl
from rrins.firmware_py.diagnostics.parameters import (
    ACCELEROMETER_CALIBRATIONS,
    ACCELEROMETER_SIGMAS,
    GYRO_CALIBRATIONS,
    GYRO_SIGMAS,
)
from rrins.firmware_py.diagnostics.regions import CALIBRATION_ADDRESS, CALIBRATION_CAPACITY
from rrins.firmware_py.diagnostics.responses import Code
from rrins.firmware_py.diagnostics.routines import Routine
from rrins.host_tools.closing import Closing
from rrins.host_tools.diag.conversation import LOST_SESSION, Conversation
from rrins.host_tools.diag.target import Target
from rrins.host_tools.diag.trouble_table import REMEMBERED, TroubleReport, TroubleTable
from rrins.host_tools.diag.values import to_json
from rrins.host_tools.errors import DiagError
from rrins.host_tools.files import JsonObject

MOST_AT_ONCE = 16
"""Most data identifiers in one request."""

_LONGEST = 4000  # bytes of data in a response
_BLOCK_OVERHEAD = 2  # bytes of a TransferData before its data
_LOST_TRANSFER = (
    *LOST_SESSION,
    Code.REQUEST_SEQUENCE_ERROR,
    Code.CONDITIONS_NOT_CORRECT,  # another transfer is under way
    Code.WRONG_BLOCK_SEQUENCE_COUNTER,
)

RECORDS = {FIRST_SNAPSHOT: "first", LATEST_SNAPSHOT: "latest"}
"""Names of the records of freeze frames."""

Advice = Callable[[int], str]
"""Returns what to do about a negative response."""


class Tester(Closing):
    """Somebody who reads, writes and starts what the table describes.

    Everything raises what `Conversation.request` does.

    Parameters
    ----------
    target : Target
    is_securing : bool
        Whether to pass SecurityAccess where it is needed.
    secret : bytes
        Of the computer.

    Attributes
    ----------
    conversation : Conversation
        The session, and the connection under it.

    Raises
    ------
    BusError
        When the bus cannot be had.
    """

    def __init__(
        self,
        target: Target,
        is_securing: bool = False,
        secret: bytes = access.DEFAULT_SECRET,
    ) -> None:
        self.conversation = Conversation(target, is_securing, secret)
        self._client = self.conversation.client

    def close(self) -> None:
        """Leave the bus."""
        self.conversation.close()

    def has(self, dids: Iterable[DataIdentifier]) -> list[DataIdentifier]:
        """Return the identifiers that this computer has; no calibration of absent sensors."""
        sensors = self.read([table.identifier("sensors")])["sensors"]
        gyros, accelerometers = sensors["gyros"], sensors["accelerometers"]
        assert isinstance(gyros, int)
        assert isinstance(accelerometers, int)
        absent = {
            *GYRO_CALIBRATIONS[gyros:],
            *GYRO_SIGMAS[gyros:],
            *ACCELEROMETER_CALIBRATIONS[accelerometers:],
            *ACCELEROMETER_SIGMAS[accelerometers:],
        }
        return [did for did in dids if did not in absent]

    def read(self, dids: Sequence[DataIdentifier]) -> dict[str, Values]:
        """Return the values of identifiers, by name."""
        found: dict[str, Values] = {}
        for some in _portions(dids):
            numbers = [did.number for did in some]
            what = "read " + ", ".join(did.name for did in some)
            rights = (did.read for did in some if did.read != access.ANYWHERE)
            wanted = next(rights, access.ANYWHERE)
            response = self.conversation.request(
                what,
                wanted,
                partial(self._client.read_data_by_identifier, numbers),
                advice=_range_advice("see `rrins diag did list`"),
            )
            values = response.service_data.values
            found.update({did.name: values[did.number] for did in some})
        return found

    def write(self, did: DataIdentifier, values: Values) -> None:
        """Write a parameter; takes effect at the next reset."""
        assert did.write is not None
        self.conversation.request(
            f"write {did.name}",
            did.write,
            lambda: self._client.write_data_by_identifier(did.number, values),
        )

    def control(self, did: DataIdentifier, how: IOControl, values: Values | None = None) -> Values:
        """Take control of an output or return it; return its resulting values."""
        assert did.control is not None
        response = self.conversation.request(
            f"control {did.name}",
            did.control,
            lambda: self._client.io_control(did.number, int(how), values=values),
            advice=self._mode_advice(did.text),
        )
        decoded: Values = response.service_data.decoded_data
        return decoded

    def _mode_advice(self, text: str) -> Advice:
        def advice(code: int) -> str:
            if code != Code.CONDITIONS_NOT_CORRECT:
                return ""
            did = table.identifier("mode")
            mode = did.layout.named(self.read([did])["mode"])["mode"]
            return f"the mode is {mode}; allowed: {_mode_sentence(text)}"

        return advice

    # ---- routines

    def start(self, routine: Routine, arguments: Mapping[str, Value]) -> Values:
        """Start a routine; return its results so far."""
        data = routine.argument_layout.encode(arguments) if routine.arguments else None
        return self._routine(
            routine,
            "start",
            lambda: self._client.start_routine(routine.number, data),
            "it is already running",
        )

    def stop(self, routine: Routine) -> Values:
        """Stop a routine; return its results."""
        return self._routine(
            routine,
            "stop",
            lambda: self._client.stop_routine(routine.number),
            "it is not running",
        )

    def result(self, routine: Routine) -> Values:
        """Return a routine's results so far."""
        return self._routine(
            routine,
            "result",
            lambda: self._client.get_routine_result(routine.number),
            "it has not been started since power-on",
        )

    def _routine(
        self, routine: Routine, what: str, call: Callable[[], Any], sequence: str
    ) -> Values:
        by_mode = self._mode_advice(routine.text)

        def advice(code: int) -> str:
            return sequence if code == Code.REQUEST_SEQUENCE_ERROR else by_mode(code)

        response = self.conversation.request(
            f"routine {what} {routine.name}",
            routine.access,
            call,
            is_repeatable=what == "result",
            advice=advice,
        )
        return routine.result_layout.decode(response.service_data.routine_status_record)

    # ---- trouble codes

    def _dtcs(self, what: str, call: Callable[[], Any]) -> list[Any]:
        response = self.conversation.request(what, table.service(0x19).access, call)
        return list(response.service_data.dtcs)

    def troubles(self, mask: int = REMEMBERED) -> TroubleTable:
        """Return the trouble codes with any of these status bits set: those that fail or did."""
        dtcs = self._dtcs("dtc read", lambda: self._client.get_dtc_by_status_mask(mask))
        return TroubleTable(map(_trouble_report, dtcs))

    def all_troubles(self) -> TroubleTable:
        """Return all trouble codes that the computer supports; the table shows what fails."""
        dtcs = self._dtcs("dtc read", self._client.get_supported_dtc)
        return TroubleTable(map(_trouble_report, dtcs))

    def snapshots(self, number: int) -> dict[int, dict[str, Values]]:
        """Return a trouble code's freeze frames: values by record number and identifier."""
        found: dict[int, dict[str, Values]] = {}
        for dtc in self._dtcs(
            f"dtc 0x{number:06X}",
            lambda: self._client.get_dtc_snapshot_by_dtc_number(number, ALL_RECORDS),
        ):
            for snapshot in dtc.snapshots:
                name = table.identifier(snapshot.did).name
                found.setdefault(snapshot.record_number, {})[name] = snapshot.data
        return found

    def freeze_frames(self, number: int) -> JsonObject:
        """Return a trouble code's freeze frames for JSON, ``first`` and ``latest``."""
        return {
            RECORDS.get(record, str(record)): {
                name: to_json(table.identifier(name).layout, values)
                for name, values in frame.items()
            }
            for record, frame in self.snapshots(number).items()
        }

    def extended_data(self, number: int) -> Values:
        """Return a trouble code's counters."""
        found: Values = {}
        for dtc in self._dtcs(
            f"dtc 0x{number:06X}",
            lambda: self._client.get_dtc_extended_data_by_dtc_number(number, ALL_RECORDS),
        ):
            for record in dtc.extended_data:
                found |= table.EXTENDED_DATA[record.record_number].decode(record.raw_data)
        return found

    def clear(self, number: int = ALL_GROUPS) -> None:
        """Clear one trouble code, or all."""
        self.conversation.request(
            "dtc clear", table.service(0x14).access, lambda: self._client.clear_dtc(number)
        )

    # ---- memory, reset

    def read_memory(
        self, address: int, size: int, on_read: Callable[[int], None] = lambda size: None
    ) -> bytes:
        """Return bytes of the RAM image; `on_read` hears how many have come so far."""
        parts = []
        for start in range(address, address + size, _LONGEST):
            length = min(_LONGEST, address + size - start)
            location = MemoryLocation(start, length, 32, 16)
            response = self.conversation.request(
                f"memory read 0x{start:06X}",
                table.service(0x23).access,
                partial(self._client.read_memory_by_address, location),
                advice=_range_advice("see `rrins diag memory list`"),
            )
            parts.append(bytes(response.service_data.memory_block))
            on_read(start + length - address)
        return b"".join(parts)

    def reset(self, kind: int) -> None:
        """Reset the computer; one that navigates only if it may be unlocked."""
        service = table.service(0x11)
        self.conversation.request(
            "reset",
            access.UNLOCKED if self.conversation.is_securing else service.access,
            lambda: self._client.ecu_reset(kind),
            advice=self._reset_advice,
        )
        self.conversation.forget_session()

    def _reset_advice(self, code: int) -> str:
        words = self._mode_advice(table.service(0x11).text)(code)
        return f"{words} (--security)" if words else ""

    # ---- the calibration file

    def pull(self) -> bytes:
        """Return the calibration file.

        Raises
        ------
        DiagError
            If its CRC is wrong.
        """
        return self.conversation.request(
            "calibration pull",
            table.service(0x35).access,
            self._pull,
            lost=_LOST_TRANSFER,
            advice=_transfer_advice,
        )

    def _pull(self) -> bytes:
        did = table.identifier("calibration_file")
        description = self._client.read_data_by_identifier(did.number).service_data.values[
            did.number
        ]
        location = MemoryLocation(CALIBRATION_ADDRESS, CALIBRATION_CAPACITY, 32, 32)
        self._client.request_upload(location, DataFormatIdentifier())
        file = b""
        counter = 0
        while len(file) < description["length"]:
            counter += 1
            block = self._transfer("calibration pull", counter)
            file += block.service_data.parameter_records
        crc = bytes(self._client.request_transfer_exit().service_data.parameter_records)
        if int.from_bytes(crc, "big") != zlib.crc32(file):
            raise DiagError("calibration pull: the received file has a wrong CRC; try again")
        return file

    def push(self, file: bytes) -> None:
        """Replace all parameters by a calibration file; takes effect at the next reset."""
        self.conversation.request(
            "calibration push",
            table.service(0x34).access,
            lambda: self._push(file),
            lost=_LOST_TRANSFER,
            advice=_transfer_advice,
        )

    def _push(self, file: bytes) -> None:
        location = MemoryLocation(CALIBRATION_ADDRESS, len(file), 32, 32)
        accepted = self._client.request_download(location, DataFormatIdentifier())
        block = accepted.service_data.max_length - _BLOCK_OVERHEAD
        for counter, start in enumerate(range(0, len(file), block), 1):
            self._transfer("calibration push", counter, file[start : start + block])
        self._client.request_transfer_exit(zlib.crc32(file).to_bytes(4, "big"))

    def _transfer(self, what: str, counter: int, *data: bytes) -> Any:
        """Transfer a block; only the block is repeated if its response is lost."""
        return self.conversation.carry_out(
            what, lambda: self._client.transfer_data(counter & 0xFF, *data)
        )


def _portions(dids: Sequence[DataIdentifier]) -> Iterator[list[DataIdentifier]]:
    """Yield the identifiers in groups that fit into a request and its response."""
    some: list[DataIdentifier] = []
    size = 0
    for did in dids:
        length = 2 + did.layout.size
        if some and (len(some) == MOST_AT_ONCE or size + length > _LONGEST):
            yield some
            some, size = [], 0
        some.append(did)
        size += length
    if some:
        yield some


def _trouble_report(dtc: Dtc) -> TroubleReport:
    return TroubleReport(table.TROUBLE_BY_NUMBER.get(dtc.id), dtc.id, dtc.status.get_byte_as_int())


def _range_advice(words: str) -> Advice:
    return lambda code: words if code == Code.REQUEST_OUT_OF_RANGE else ""


def _transfer_advice(code: int) -> str:
    is_busy = code == Code.CONDITIONS_NOT_CORRECT
    return "another transfer is active; try again in 5 s, when it has timed out" if is_busy else ""


def _mode_sentence(text: str) -> str:
    """Return the sentence in a description that names modes."""
    for sentence in text.split(". "):
        if any(mode.name in sentence for mode in Mode):
            return sentence.removesuffix(".")
    return text
