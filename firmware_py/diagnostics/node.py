"""Diagnostics between two steps of the firmware: frames in, frames out, and the memories."""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Records
from rrins.dbc.contract import Contract
from rrins.dbc.frame import FrameArray, frame_array
from rrins.firmware_py.core.records.diagnostic_records import ATTENTION_FRAMES, ATTENTION_TROUBLES
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.settings import power_on
from rrins.firmware_py.diagnostics import access, table
from rrins.firmware_py.diagnostics.computer import Computer
from rrins.firmware_py.diagnostics.fault_memory import FaultMemory
from rrins.firmware_py.diagnostics.outbox import put_before_last
from rrins.firmware_py.diagnostics.parameter_memory import ParameterMemory
from rrins.firmware_py.diagnostics.server import Reset, Server, pending_before
from rrins.firmware_py.diagnostics.services.control import Control
from rrins.firmware_py.diagnostics.services.data import Data
from rrins.firmware_py.diagnostics.services.routines import Routines
from rrins.firmware_py.diagnostics.services.session import (
    Communication,
    DTCSetting,
    Lock,
    Restart,
    handlers,
)
from rrins.firmware_py.diagnostics.services.transfer import Transfers
from rrins.firmware_py.diagnostics.services.troubles import Troubles
from rrins.firmware_py.diagnostics.store import TwoCopyStore
from rrins.firmware_py.diagnostics.transport import Transport, slots_per_epoch
from rrins.firmware_py.diagnostics.writer import DirectWriter, WriteJob, Writer

_NORMAL = (
    "firmware_status",
    "firmware_faults",
    "nav_latitude",
    "nav_longitude",
    "nav_velocity",
    "nav_height",
    "nav_attitude",
)
_MANAGEMENT = ("heartbeat_firmware",)
SILENCED = (*_NORMAL, *_MANAGEMENT)
"""Cyclic messages that a tool can stop."""
LONG_SENDING_NS = access.P2_MS * 1_000_000 // 2
"""Sending that takes longer is announced: it leaves the other half of P2 to flow control."""


class Diagnostics:
    """Diagnostics of a computer.

    Parameters
    ----------
    fault_store : TwoCopyStore, optional
        Stores the trouble codes across power-off.
    secret : bytes
        Of SecurityAccess.
    random_bytes : callable
        Returns the seeds.

    Attributes
    ----------
    is_awake : bool
        Whether `run` must be called even without a diagnostic frame.
    reset_due : bool
        Whether `restart` must be called before the next step.
    """

    def __init__(
        self,
        ram: Records[Ram],
        contract: Records[Contract],
        parameters: ParameterMemory,
        fault_store: TwoCopyStore | None = None,
        secret: bytes = access.DEFAULT_SECRET,
        random_bytes: Callable[[int], bytes] = os.urandom,
    ) -> None:
        self.is_awake = False
        self.reset_due = False
        self.parameters = parameters
        self._ram = ram
        self._contract = contract
        self._fault_store = fault_store
        self._writer: Writer = DirectWriter()
        self._job: WriteJob | None = None
        self._are_faults_new = False
        self._attention = ram["diagnostics"]["attention"]
        self._steps = ram["steps"]
        self._steps_before = 0  # before the last reset
        self._period_ns = int(ram[0].parameters.period_ns)
        self.faults = FaultMemory(ram, contract)
        self._begin(fault_store)
        self._communication = Communication()
        self._routines: Routines
        self.server = self._make_server(secret, random_bytes)
        self._transport = Transport(self._period_ns)
        self._request_ids = (table.request_id(), table.functional_id())
        self._silenced = silenced_types(contract)
        self._response = _blank_response(slots_per_epoch(self._period_ns))

    @staticmethod
    def capacity(period_ns: int) -> int:
        """Return the most frames that `run` adds to an epoch."""
        return slots_per_epoch(period_ns)

    def _begin(self, store: TwoCopyStore | None) -> None:
        """Recall the trouble codes, and begin an operation cycle."""
        self._ram[0].diagnostics.memory_faults = self.parameters.faults
        if store is None:
            return
        found = store.read().image
        if found is not None:
            self.faults.recall(found)
            self.faults.begin_cycle()
        self._are_faults_new = self.is_awake = True  # the power may fail before anything else

    def _make_server(self, secret: bytes, random_bytes: Callable[[int], bytes]) -> Server:
        server = Server()
        computer = Computer(self._ram, self.parameters, self.faults, lambda: int(server.session))
        lock, setting = Lock(secret, random_bytes), DTCSetting(computer)
        control, transfers = Control(computer), Transfers(computer)
        self._routines = Routines(computer)
        self._computer = computer
        server.parts = [lock, self._communication, setting, control, transfers, self._routines]
        server.handlers = (
            handlers(lock, self._communication, setting, Restart(computer))
            | Troubles(computer, self._note_faults).handlers()
            | Data(computer).handlers()
            | control.handlers()
            | transfers.handlers()
            | self._routines.handlers()
        )
        return server

    @property
    def writer(self) -> Writer:
        """Writer of both memories."""
        return self._writer

    @writer.setter
    def writer(self, writer: Writer) -> None:
        self._writer = writer
        self.parameters.writer = writer

    def _note_faults(self) -> None:
        self._are_faults_new = True

    @property
    def now_ns(self) -> int:
        """Time since power-on, by the number of steps."""
        return (self._steps_before + int(self._steps[0])) * self._period_ns

    def run(self, inbox: FrameArray, start: int, end: int, outbox: FrameArray, sent: int) -> int:
        """Do one epoch's share of the work.

        Parameters
        ----------
        inbox : array of frames
            The diagnostic frames in ``inbox[start:end]`` are processed.
        outbox : array of frames
            The first `sent` are the epoch's frames; the last of them stays last.

        Returns
        -------
        int
            Frames in `outbox` now.
        """
        attention = int(self._attention[0])
        self._attention[0] = 0
        if attention & ATTENTION_FRAMES:
            self._receive(inbox[start:end])
        if attention & ATTENTION_TROUBLES:
            self._are_faults_new = True
        self._save_faults()
        if attention & ATTENTION_FRAMES or self.is_awake:
            responses = self._serve()
            sent = self._without_silenced(outbox, sent)
            words = [int.from_bytes(frame, "little") for frame in responses]
            sent = put_before_last(words, self._response, outbox, sent)
        self.is_awake = not self._is_idle()
        return sent

    def _is_idle(self) -> bool:
        return (
            self._transport.is_idle
            and self.server.is_idle
            and not self._communication.silent
            and not self._is_saving
        )

    def _receive(self, frames: FrameArray) -> None:
        ids = frames["can_id"]
        theirs = np.flatnonzero((ids == self._request_ids[0]) | (ids == self._request_ids[1]))
        for k in theirs.tolist():
            frame = frames[k]
            payload = int(frame["data"]).to_bytes(8, "little")[: min(8, int(frame["length"]))]
            self._transport.put(int(frame["can_id"]), payload)

    def _serve(self) -> list[bytes]:
        """Let the server process at most one request; return the frames to send."""
        now_ns, transport, server = self.now_ns, self._transport, self.server
        transport.begin(now_ns)
        if transport.is_sending or transport.is_receiving:
            server.keep_session(now_ns)
        response = server.poll(now_ns)
        if response is None and not transport.is_sending:
            request = transport.receive_functional()
            is_functional = request is not None
            if request is None:
                request = transport.receive()
            if request is not None:
                response = server.handle(request, is_functional, now_ns)
        if response is not None:
            # Many tools count P2 to the last frame of a response, not to the first.
            if transport.sending_ns(response) > LONG_SENDING_NS:
                transport.send(pending_before(response))
            transport.send(response)
        frames = transport.end()
        self.reset_due = server.reset_wanted is not None and not transport.is_sending
        return frames

    def _without_silenced(self, outbox: FrameArray, sent: int) -> int:
        """Remove the cyclic messages that a tool has stopped."""
        silent = self._communication.silent
        if not silent:
            return sent
        kept = [k for k in range(sent) if not self._silenced[outbox["can_id"][k]] & silent]
        outbox[: len(kept)] = outbox[:sent][kept]
        return len(kept)

    @property
    def _is_saving(self) -> bool:
        return self._job is not None or self._are_faults_new

    def _save_faults(self) -> None:
        """Store changed trouble codes, once the previous write is done."""
        if self._fault_store is None:
            self._are_faults_new = False
            return
        if self._job is not None and self._job.done:
            self._job = None
        if self._are_faults_new and self._job is None:
            self._are_faults_new = False
            self._job = self._writer.submit(self._fault_store, self.faults.image())

    def restart(self) -> None:
        """Restart the computer, as ECUReset requested."""
        is_hard = self.server.reset_wanted == Reset.HARD
        if is_hard:
            self._writer.close()
            self.parameters.load()
        kept = self.faults.keep()
        self._steps_before += int(self._steps[0])
        self._ram[:] = power_on(self.parameters.settings(), self._contract)
        self._ram[0].diagnostics.memory_faults = self.parameters.faults
        self.faults.set_up()
        self.faults.restore(kept)
        self.faults.begin_test()
        if is_hard:
            self.faults.begin_cycle()
            self._are_faults_new = True
        self._computer.power_on()
        self._routines.power_on()
        self._transport.reset()
        self.server.power_on()
        self.reset_due = False
        self.is_awake = True

    def close(self) -> None:
        """Switch off: wait until both memories are stored, then release them."""
        if self._fault_store is not None:
            self._writer.submit(self._fault_store, self.faults.image())
        self.parameters.close()
        self._writer.close()
        if self._fault_store is not None:
            self._fault_store.close()


def silenced_types(contract: Records[Contract]) -> NDArray[np.uint8]:
    """Return the communication types of every identifier, one bit each."""
    types = np.zeros(2048, dtype=np.uint8)
    for bit, names in ((1, _NORMAL), (2, _MANAGEMENT)):
        for name in names:
            types[int(contract[0][name].message.can_id)] = bit
    return types


def _blank_response(count: int) -> FrameArray:
    frames = frame_array(count)
    frames["can_id"] = table.response_id()
    frames["length"] = 8
    return frames
