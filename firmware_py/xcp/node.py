"""XCP between two steps of the firmware: frames in, frames out."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from typing import TypedDict

import numpy as np

from rrins.compiled.record import Records
from rrins.dbc.codec import SignalLayout, load
from rrins.dbc.contract import Contract
from rrins.dbc.frame import FrameArray, frame_array
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.settings import XcpSettings
from rrins.firmware_py.diagnostics import access
from rrins.firmware_py.diagnostics.outbox import put_before_last
from rrins.firmware_py.diagnostics.seed_and_key import SeedAndKey
from rrins.firmware_py.xcp.calibration import Calibration
from rrins.firmware_py.xcp.daq import DaqLists, EventChannel
from rrins.firmware_py.xcp.measurement import Measurement
from rrins.firmware_py.xcp.memory import Memory
from rrins.firmware_py.xcp.protocol import FIRST_COMMAND, MAX_DTO, Event, Packet
from rrins.firmware_py.xcp.session import Session
from rrins.firmware_py.xcp.slave import Slave
from rrins.firmware_py.xcp.stimulation import Stimulation

_NS_PER_S = 1_000_000_000
_COMMANDS_PER_EPOCH = 64
_WAITING_CAPACITY = 4096  # packets of responses
_OF_EPOCH = bytes([0, 0, EventChannel.EPOCH, 0])  # an event channel's number, a timeout, which one


class XcpSummary(TypedDict):
    """Use of XCP in a run."""

    commands: int  #: that were answered
    frames_sent: int
    samples: int  #: of lists of measured data
    overloads: int  #: samples that were left out, for the bus share was used up
    stimulated_epochs: int  #: with increments of a tool
    stimulations_refused: int  #: increments that no sensor could have sent


class Xcp:
    """XCP of a computer.

    Parameters
    ----------
    ram : Records[Ram]
    contract : Records[Contract]
    settings : XcpSettings
    a2l : callable
        Returns the text of the A2L file.
    secret : bytes
        Of seed and key, as for SecurityAccess of UDS.
    random_bytes : callable
        Returns the seeds.

    Attributes
    ----------
    is_awake : bool
        Whether `run` must be called even without a frame.
    """

    def __init__(
        self,
        ram: Records[Ram],
        contract: Records[Contract],
        settings: XcpSettings,
        a2l: Callable[[], str],
        secret: bytes = access.DEFAULT_SECRET,
        random_bytes: Callable[[int], bytes] = os.urandom,
    ) -> None:
        period_ns = int(ram[0].parameters.period_ns)
        sensor = contract[0].sensor[0]
        self.memory = Memory(ram)
        self.daq = DaqLists(self.memory.image)
        self.session = Session(self.memory, self.daq, SeedAndKey(secret, random_bytes), a2l)
        limits = _largest(sensor.gyro_dtheta), _largest(sensor.accelerometer_dv)
        self._stimulation = Stimulation(ram, limits)
        self._measurement = Measurement(self.session, self._stimulation, period_ns)
        self.slave = Slave(self.session, Calibration(self.session), self._measurement)
        self._period_ns = period_ns
        self._epochs_per_s = _NS_PER_S // period_ns
        self._epoch = ram["epoch"]
        self._id = load().frame_id("XCP_COMMAND")
        self._share = self.capacity(settings, period_ns)
        self._blank = frame_array(self._share)
        self._blank["can_id"] = load().frame_id("XCP_RESPONSE")
        self._waiting: deque[bytes] = deque()
        self._is_overloaded = self._was_stimulated = False
        self._frames_sent = 0
        self.is_awake = False

    @staticmethod
    def capacity(settings: XcpSettings | None, period_ns: int) -> int:
        """Return the most frames that `run` adds to an epoch."""
        return 0 if settings is None else max(1, settings.frames_hz * period_ns // _NS_PER_S)

    def power_on(self) -> None:
        """Begin anew after a reset."""
        self.session.end()
        self.daq.free()
        self.memory.pages.power_on()
        self._waiting.clear()
        self.is_awake = False

    @property
    def stimulates(self) -> bool:
        """Whether `stimulate` must be called before each step."""
        return self.is_awake and self.daq.stimulates

    def stimulate(self, inbox: FrameArray, start: int, count: int) -> None:
        """Give the next step the increments that have come for it."""
        packets = [p for p in self._packets(inbox[start:count]) if p[0] < FIRST_COMMAND]
        is_given = False
        for values in self.daq.stimulation(packets):
            self._stimulation.give(values)
            is_given = True
        if self._was_stimulated and not is_given:
            self._tell(Event.STIM_TIMEOUT, _OF_EPOCH)
        self._was_stimulated = is_given

    def run(self, inbox: FrameArray, start: int, end: int, outbox: FrameArray, sent: int) -> int:
        """Do one epoch's share of the work.

        Parameters
        ----------
        inbox : array of frames
            The commands in ``inbox[start:end]`` are processed.
        outbox : array of frames
            The first `sent` are the epoch's frames; the last of them stays last.

        Returns
        -------
        int
            Frames in `outbox` now.
        """
        epoch = max(0, int(self._epoch[0]))
        self.session.now_ns = epoch * self._period_ns
        commands = [p for p in self._packets(inbox[start:end]) if p[0] >= FIRST_COMMAND]
        for packet in commands[:_COMMANDS_PER_EPOCH]:
            if len(self._waiting) < _WAITING_CAPACITY:
                self._waiting.extend(self.slave.handle(packet))
        if self.daq.is_running:
            self._sample(epoch)
        answers = [self._waiting.popleft() for _ in range(min(self._share, len(self._waiting)))]
        self._blank["length"] = MAX_DTO
        self._blank["length"][: len(answers)] = [len(packet) for packet in answers]
        words = [int.from_bytes(packet, "little") for packet in answers]
        words += self.daq.take(self._share - len(words))
        self._frames_sent += len(words)
        self.is_awake = self.daq.is_running or bool(self._waiting)
        return put_before_last(words, self._blank, outbox, sent)

    def _sample(self, epoch: int) -> None:
        is_second = epoch % self._epochs_per_s == 0
        channels = (EventChannel.EPOCH, EventChannel.SECOND)[: 2 if is_second else 1]
        time = self._measurement.time(epoch * self._period_ns)
        is_complete = self.daq.sample(channels, time)
        if not is_complete and not self._is_overloaded:
            self._tell(Event.DAQ_OVERLOAD)
        if is_second or not is_complete:
            self._is_overloaded = not is_complete

    def _tell(self, event: Event, details: bytes = b"") -> None:
        self._waiting.append(bytes([Packet.EVENT, event]) + details)

    def _packets(self, frames: FrameArray) -> list[bytes]:
        ours = np.flatnonzero(frames["can_id"] == self._id).tolist()
        packets = (
            int(frames[k]["data"]).to_bytes(8, "little")[: min(8, int(frames[k]["length"]))]
            for k in ours
        )
        return [packet for packet in packets if packet]

    def summary(self) -> XcpSummary:
        """Return how it was used."""
        return {
            "commands": self.slave.commands,
            "frames_sent": self._frames_sent,
            "samples": self.daq.samples,
            "overloads": self.daq.overloads,
            "stimulated_epochs": self._stimulation.epochs,
            "stimulations_refused": self._stimulation.refused,
        }


def _largest(signal: SignalLayout) -> float:
    """Return the largest value of a signal, in its unit."""
    return signal.raw_maximum * float(signal.scale)
