"""Follows a firmware by its frames alone: mode, fault counters and navigation, as the bus tells.

For a firmware that is the user's own program, this is all that a rehearsal knows of it.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Final

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.compiled.record import I8, Integers, Record, Records, Words
from rrins.dbc.codec import SignalLayout, load, to_physical, unpack
from rrins.dbc.contract import Contract, MessageSignals, load_contract
from rrins.dbc.e2e import crc_holds, fill
from rrins.dbc.frame import FrameArray, frame_array
from rrins.firmware_py.core.modes.modes import FirmwareFault, Mode
from rrins.firmware_py.core.records.memory import NavigationOutput
from rrins.host_tools.files import JsonObject
from rrins.host_tools.runs.results.samples import NAVIGATION_SAMPLES, SampleBuffer, SampleFile

_COUNTERS: Final = ("crc_errors", "counter_errors", "missing_frames", "bridged_epochs", "overruns")
_AXIS_COMMANDS: Final = 2  # what comes in every epoch

_LATITUDE, _LONGITUDE, _VELOCITY, _HEIGHT, _ATTITUDE = range(5)
_PARTS: Final = 5
_WHOLE_FIX: Final = (1 << _PARTS) - 1
_MODES, _FAULTS = len(Mode), len(FirmwareFault)


class Followed(Record):
    """State of a firmware as its frames report it."""

    frames: I8  #: received so far
    mode: I8  #: a `Mode`
    fault: I8  #: a `FirmwareFault`
    position: I8  #: of the scheme
    cycle: I8  #: of the scheme
    not_following: Annotated[Integers, 2]  #: whether an axis does not follow: inner, outer
    counter: Annotated[Integers, len(_COUNTERS)]  #: of FIRMWARE_FAULTS, in the order of `_COUNTERS`
    arrived: I8  #: navigation frames of the group that is coming, one bit each
    word: Annotated[Words, _PARTS]  #: their payloads
    first_epoch: I8  #: of the first fix; -1: none has come
    fix: NavigationOutput  #: the latest


@compiled
def _value(word: np.uint64, signal: SignalLayout) -> float:
    return to_physical(unpack(word, signal), signal)


@compiled
def _note_status(followed: Followed, word: np.uint64, message: MessageSignals) -> None:
    mode, fault = unpack(word, message.mode), unpack(word, message.fault)
    if mode < _MODES:
        followed.mode = mode
    if fault < _FAULTS:
        followed.fault = fault
    followed.position = unpack(word, message.scheme_position)
    followed.cycle = unpack(word, message.scheme_cycle)
    followed.not_following[0] = unpack(word, message.axis_inner_not_following)
    followed.not_following[1] = unpack(word, message.axis_outer_not_following)


@compiled
def _note_counters(followed: Followed, word: np.uint64, message: MessageSignals) -> None:
    followed.counter[0] = unpack(word, message.crc_errors)
    followed.counter[1] = unpack(word, message.counter_errors)
    followed.counter[2] = unpack(word, message.missing_frames)
    followed.counter[3] = unpack(word, message.bridged_epochs)
    followed.counter[4] = unpack(word, message.overruns)


@compiled
def _part_of(contract: Contract, can_id: int) -> int:
    """Return which part of a navigation fix a frame is, -1 for none."""
    if can_id == contract.nav_latitude.message.can_id:
        return _LATITUDE
    if can_id == contract.nav_longitude.message.can_id:
        return _LONGITUDE
    if can_id == contract.nav_velocity.message.can_id:
        return _VELOCITY
    if can_id == contract.nav_height.message.can_id:
        return _HEIGHT
    if can_id == contract.nav_attitude.message.can_id:
        return _ATTITUDE
    return -1


@compiled
def _holds(contract: Contract, frames: FrameArray, k: int, part: int) -> bool:
    """Return whether the CRC of a part of a fix holds."""
    if part == _LATITUDE:
        return crc_holds(frames[k], contract.nav_latitude.message)
    if part == _LONGITUDE:
        return crc_holds(frames[k], contract.nav_longitude.message)
    if part == _VELOCITY:
        return crc_holds(frames[k], contract.nav_velocity.message)
    if part == _HEIGHT:
        return crc_holds(frames[k], contract.nav_height.message)
    return crc_holds(frames[k], contract.nav_attitude.message)


@compiled
def _note_fix(followed: Followed, contract: Contract, now: int) -> bool:
    """Keep a whole group of navigation frames; return whether it is newer than the one before.

    Its epoch is told modulo 2^12.
    """
    fix, word = followed.fix, followed.word
    layout = contract.nav_latitude.epoch
    modulus = 1 << layout.length
    told = unpack(word[_LATITUDE], layout)
    epoch = now - (now - told) % modulus
    followed.arrived = 0
    if followed.first_epoch < 0:
        followed.first_epoch = epoch
    elif epoch <= fix.epoch:
        return False
    velocity, height, attitude = contract.nav_velocity, contract.nav_height, contract.nav_attitude
    fix.epoch = epoch
    fix.mode = followed.mode
    fix.latitude = math.radians(_value(word[_LATITUDE], contract.nav_latitude.latitude_deg))
    fix.longitude = math.radians(_value(word[_LONGITUDE], contract.nav_longitude.longitude_deg))
    fix.height = _value(word[_HEIGHT], height.height)
    fix.velocity_n[0] = _value(word[_VELOCITY], velocity.velocity_east)
    fix.velocity_n[1] = _value(word[_VELOCITY], velocity.velocity_north)
    fix.velocity_n[2] = _value(word[_HEIGHT], height.velocity_up)
    fix.roll = math.radians(_value(word[_ATTITUDE], attitude.roll_deg))
    fix.pitch = math.radians(_value(word[_ATTITUDE], attitude.pitch_deg))
    fix.heading = math.radians(_value(word[_ATTITUDE], attitude.heading_deg))
    return True


@compiled
def _follow(
    follower: Records[Followed],
    contracts: Records[Contract],
    frames: FrameArray,
    begin: int,
    end: int,
    now: int,
) -> int:
    """Take the frames of an epoch from `begin` on.

    Return the number of the frame after one that completes a new fix; 0 if none does.
    """
    followed, contract = follower[0], contracts[0]
    status, faults = contract.firmware_status, contract.firmware_faults
    for k in range(begin, end):
        can_id, word = frames[k].can_id, frames[k]["data"]
        if can_id == status.message.can_id:
            if crc_holds(frames[k], status.message):
                _note_status(followed, word, status)
            continue
        if can_id == faults.message.can_id:
            if crc_holds(frames[k], faults.message):
                _note_counters(followed, word, faults)
            continue
        part = _part_of(contract, can_id)
        if part < 0 or not _holds(contract, frames, k, part):
            continue
        followed.word[part] = word
        followed.arrived |= 1 << part
        is_whole = part == _ATTITUDE and followed.arrived == _WHOLE_FIX
        if is_whole and _note_fix(followed, contract, now):
            return k + 1
    return 0


class Follower:
    """Listens to a firmware's frames.

    Parameters
    ----------
    path : Path or None
        File for the navigation samples (`rrins.host_tools.runs.results.samples`).
    """

    def __init__(self, path: Path | None) -> None:
        self._contract = load_contract()
        self._file = SampleFile(path)
        self._rows = SampleBuffer(NavigationOutput, self._file)
        self._followed = Followed.zeros(1)
        self._followed[0].first_epoch = -1
        self._row = NavigationOutput.zeros(1)

    def take(self, frames: FrameArray, count: int, epoch: int) -> None:
        """Take what the firmware has sent in the hardware's epoch `epoch`."""
        self._followed["frames"] += count
        if count <= _AXIS_COMMANDS:
            return
        begin = 0
        while begin := _follow(self._followed, self._contract, frames, begin, count, epoch):
            self._row[0] = self._followed[0].fix
            self._rows.append(self._row)

    def _counters(self) -> dict[str, int]:
        return dict(zip(_COUNTERS, self._followed[0].counter.tolist(), strict=True))

    @property
    def _epochs_navigated(self) -> int:
        followed = self._followed[0]
        first = int(followed.first_epoch)
        return 0 if first < 0 else int(followed.fix.epoch) - first + 1

    def summary(self, epoch: int) -> JsonObject:
        """Return what is known of the firmware, by the keys of its own summary."""
        followed = self._followed[0]
        return {
            "mode": Mode(int(followed.mode)).name,
            "fault": FirmwareFault(int(followed.fault)).name,
            "epoch": epoch,
            "epochs_navigated": self._epochs_navigated,
            "navigation_sha256": None,
            "scheme_cycles": int(followed.cycle),
            "axes_not_following": [bool(flag) for flag in followed.not_following],
            "frames_sent": int(followed.frames),
            "faults": self._counters(),
        }

    def progress(self, epoch: int) -> JsonObject:
        """Return mode, position and scheme, for a progress line."""
        followed = self._followed[0]
        mode = Mode(int(followed.mode))
        return {
            "epoch": epoch,
            "mode": mode.name,
            "fault": FirmwareFault(int(followed.fault)).name,
            "position": int(followed.position),
            "navigating": mode in (Mode.NAVIGATION_STRAPDOWN, Mode.NAVIGATION_ROTATING)
            and int(followed.first_epoch) >= 0,
            "latitude": float(followed.fix.latitude),
            "longitude": float(followed.fix.longitude),
            "overruns": self._counters()["overruns"],
        }

    def close(self) -> None:
        """Write the samples that are left."""
        self._rows.flush()
        self._file.close()


def _prepare() -> None:
    """Let a spare follower take some frames, so that all code is compiled or loaded."""
    frames = frame_array(_AXIS_COMMANDS + 1)
    for frame in frames:
        fill(frame, load_contract()[0].firmware_status.message, np.uint64(0), 0)
    Follower(None).take(frames, len(frames), 0)


def follower_of(folder: Path | None) -> Follower:
    """Return a follower that writes its samples where the firmware's own would be.

    What it needs is there after that: nothing is left to compile while time is real.
    """
    load()
    _prepare()
    return Follower(None if folder is None else folder / NAVIGATION_SAMPLES)
