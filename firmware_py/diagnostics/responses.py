"""Services and negative responses (ISO 14229-1, tables 2 and A.1), with their meanings here."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

from rrins.firmware_py.diagnostics.access import ANYWHERE, EXTENDED, PROGRAMMING, Access

NEGATIVE = 0x7F
"""First byte of a negative response."""

POSITIVE_OFFSET = 0x40
"""Added to a service's identifier in its positive response."""

SUPPRESS_BIT = 0x80
"""suppressPosRspMsgIndicationBit of a sub-function: send no positive response."""


class Code(IntEnum):
    """Negative response codes that the firmware uses."""

    SERVICE_NOT_SUPPORTED = 0x11
    SUB_FUNCTION_NOT_SUPPORTED = 0x12
    INCORRECT_MESSAGE_LENGTH = 0x13
    RESPONSE_TOO_LONG = 0x14
    BUSY_REPEAT_REQUEST = 0x21
    CONDITIONS_NOT_CORRECT = 0x22
    REQUEST_SEQUENCE_ERROR = 0x24
    REQUEST_OUT_OF_RANGE = 0x31
    SECURITY_ACCESS_DENIED = 0x33
    INVALID_KEY = 0x35
    EXCEEDED_NUMBER_OF_ATTEMPTS = 0x36
    REQUIRED_TIME_DELAY_NOT_EXPIRED = 0x37
    TRANSFER_DATA_SUSPENDED = 0x71
    GENERAL_PROGRAMMING_FAILURE = 0x72
    WRONG_BLOCK_SEQUENCE_COUNTER = 0x73
    RESPONSE_PENDING = 0x78
    SUB_FUNCTION_NOT_SUPPORTED_IN_ACTIVE_SESSION = 0x7E
    SERVICE_NOT_SUPPORTED_IN_ACTIVE_SESSION = 0x7F


MEANINGS = {
    Code.SERVICE_NOT_SUPPORTED: "no such service",
    Code.SUB_FUNCTION_NOT_SUPPORTED: "no such sub-function",
    Code.INCORRECT_MESSAGE_LENGTH: "the request is too short or too long",
    Code.RESPONSE_TOO_LONG: "the response would exceed 4095 bytes",
    Code.BUSY_REPEAT_REQUEST: "the previous request is still being processed",
    Code.CONDITIONS_NOT_CORRECT: "not possible in the current state",
    Code.REQUEST_SEQUENCE_ERROR: "another request must come first",
    Code.REQUEST_OUT_OF_RANGE: "no such identifier, or a value beyond its limits",
    Code.SECURITY_ACCESS_DENIED: "the computer is locked",
    Code.INVALID_KEY: "wrong key",
    Code.EXCEEDED_NUMBER_OF_ATTEMPTS: "wrong key, and no attempts left",
    Code.REQUIRED_TIME_DELAY_NOT_EXPIRED: "no seed until the delay after wrong keys has expired",
    Code.TRANSFER_DATA_SUSPENDED: "more data than announced",
    Code.GENERAL_PROGRAMMING_FAILURE: "wrong CRC, not a calibration file, or storing failed",
    Code.WRONG_BLOCK_SEQUENCE_COUNTER: "a block is missing",
    Code.RESPONSE_PENDING: "processing takes longer; the response follows",
    Code.SUB_FUNCTION_NOT_SUPPORTED_IN_ACTIVE_SESSION: "sub-function not available in this session",
    Code.SERVICE_NOT_SUPPORTED_IN_ACTIVE_SESSION: "not available in this session",
}


@dataclass(frozen=True)
class Service:
    """A service that the firmware supports."""

    number: int  #: the service identifier
    name: str
    access: Access  #: of the service as a whole; an identifier or routine may require more
    text: str
    subfunctions: dict[int, str]  #: empty when the service has no sub-function
    #: Sub-functions that require more than the service
    only_in: dict[int, Access] = field(default_factory=dict)

    @property
    def positive(self) -> int:
        """First byte of the positive response."""
        return self.number + POSITIVE_OFFSET


SERVICES = (
    Service(0x10, "DiagnosticSessionControl", ANYWHERE,
        "Changes the session; the programming session can only be entered from the extended one. "
        "Every change locks the computer again; in the default session, everything held for the "
        "tool is released.",
        {0x01: "default", 0x02: "programming", 0x03: "extended"}, {0x02: EXTENDED}),
    Service(0x11, "ECUReset", EXTENDED,
        "Restarts the computer once the response has been sent; in FINE_ALIGNMENT and NAVIGATION_* "
        "only if it is unlocked. A hard reset reads the parameter memory again and begins an "
        "operation cycle; a soft reset does neither.",
        {0x01: "hardReset", 0x03: "softReset"}),
    Service(0x14, "ClearDiagnosticInformation", ANYWHERE,
        "Clears one trouble code, or all (0xFFFFFF), with their freeze frames.", {}),
    Service(0x19, "ReadDTCInformation", ANYWHERE,
        "Reads trouble codes, their freeze frames and their counters.",
        {0x01: "reportNumberOfDTCByStatusMask", 0x02: "reportDTCByStatusMask",
         0x03: "reportDTCSnapshotIdentification", 0x04: "reportDTCSnapshotRecordByDTCNumber",
         0x06: "reportDTCExtDataRecordByDTCNumber", 0x0A: "reportSupportedDTC",
         0x14: "reportDTCFaultDetectionCounter"}),
    Service(0x22, "ReadDataByIdentifier", ANYWHERE, "Reads up to 16 identifiers at once.", {}),
    Service(0x23, "ReadMemoryByAddress", EXTENDED,
        "Reads the RAM image; an address is an offset into it.", {}),
    Service(0x27, "SecurityAccess", EXTENDED,
        "Unlocks requests that change the computer. After three wrong keys, no seed for 10 s.",
        {0x01: "requestSeed", 0x02: "sendKey"}),
    Service(0x28, "CommunicationControl", EXTENDED,
        "Stops or resumes the cyclic messages: normal messages (type 0x01: status, faults, "
        "navigation), network management (0x02: heartbeat), or both (0x03). The axis commands are "
        "always sent.",
        {0x00: "enableRxAndTx", 0x01: "enableRxAndDisableTx"}),
    Service(0x2E, "WriteDataByIdentifier", EXTENDED,
        "Writes a parameter to the parameter memory; it takes effect at the next reset.", {}),
    Service(0x2F, "InputOutputControlByIdentifier", EXTENDED,
        "Takes control of an output from the navigation computer, or returns it.", {}),
    Service(0x31, "RoutineControl", EXTENDED, "Starts and stops routines, and reads their results.",
        {0x01: "startRoutine", 0x02: "stopRoutine", 0x03: "requestRoutineResults"}),
    Service(0x34, "RequestDownload", PROGRAMMING,
        "Begins the download (push) of a calibration file.", {}),
    Service(0x35, "RequestUpload", EXTENDED, "Begins the upload (pull) of the calibration file.",
        {}),
    Service(0x36, "TransferData", EXTENDED, "Transfers a block of the file.", {}),
    Service(0x37, "RequestTransferExit", EXTENDED,
        "Ends a transfer, with the CRC-32 of all data; a calibration file is checked and stored.",
        {}),
    Service(0x3E, "TesterPresent", ANYWHERE, "Keeps the session alive.", {0x00: "zeroSubFunction"}),
    Service(0x85, "ControlDTCSetting", EXTENDED, "Stops or resumes the setting of trouble codes.",
        {0x01: "on", 0x02: "off"}),
)  # fmt: skip
"""The services, by number."""
