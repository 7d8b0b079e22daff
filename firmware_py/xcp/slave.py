"""The XCP slave: a command packet in, packets out."""

from __future__ import annotations

from rrins.firmware_py.xcp.calibration import Calibration
from rrins.firmware_py.xcp.measurement import Measurement
from rrins.firmware_py.xcp.protocol import MAX_CTO, Command, Fault, Packet, XcpError, require
from rrins.firmware_py.xcp.session import Session

_DATA = MAX_CTO - 1


class Slave:
    """Answers commands.

    Attributes
    ----------
    commands : int
        Commands that were answered since power-on.
    """

    def __init__(
        self, session: Session, calibration: Calibration, measurement: Measurement
    ) -> None:
        self._session = session
        self._calibration = calibration
        rows = (*session.rows(), *calibration.rows(), *measurement.rows())
        self._rows = {int(row.command): row for row in rows}
        self.commands = 0

    def handle(self, packet: bytes) -> list[bytes]:
        """Return the response to a command, as packets without padding.

        None while the tool is not connected, and within a block.
        """
        if not self._session.is_connected and packet[0] != Command.CONNECT:
            return []
        self.commands += 1
        try:
            body = self._answer(packet)
        except XcpError as error:
            return [bytes([Packet.ERROR, error.fault]) + error.details]
        if body is None:
            return []
        head = bytes([Packet.RESPONSE])
        return [head + body[k : k + _DATA] for k in range(0, max(1, len(body)), _DATA)]

    def _answer(self, packet: bytes) -> bytes | None:
        row = self._rows.get(packet[0])
        if row is None:
            raise XcpError(Fault.CMD_UNKNOWN)
        if row.command != Command.DOWNLOAD_NEXT:
            self._calibration.forget_block()
        require(not row.resource & self._session.protection, Fault.ACCESS_LOCKED)
        require(len(packet) > row.size, Fault.CMD_SYNTAX)
        return row.handler(packet[1:])
