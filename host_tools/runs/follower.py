"""Follows a firmware by its frames alone: mode, fault counters and navigation, as the bus tells.

For a firmware that is the user's own program, this is all that a rehearsal knows of it.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np

from rrins.dbc.codec import load, to_physical, unpack
from rrins.dbc.contract import load_contract
from rrins.dbc.e2e import crc_holds, fill
from rrins.dbc.frame import FrameArray, frame_array
from rrins.firmware_py.core.memory import NavigationOutput
from rrins.firmware_py.core.modes import FirmwareFault, Mode
from rrins.host_tools.files import JsonObject
from rrins.host_tools.runs.samples import NAVIGATION_SAMPLES, SampleBuffer, SampleFile

_PARTS: Final = ("nav_latitude", "nav_longitude", "nav_velocity", "nav_height", "nav_attitude")
_COUNTERS: Final = (
    "crc_errors",
    "counter_errors",
    "missing_frames",
    "bridged_epochs",
    "overruns",
)
_AXIS_COMMANDS: Final = 2  # what comes in every epoch


class Follower:
    """Listens to a firmware's frames.

    Parameters
    ----------
    path : Path or None
        File for the navigation samples (`rrins.host_tools.runs.samples`).

    Attributes
    ----------
    frames : int
        Received so far.
    is_heard : bool
        Whether any message of a navigation computer has come.
    """

    def __init__(self, path: Path | None) -> None:
        self._contract = load_contract()[0]
        self._names = {
            int(getattr(self._contract, name).message.can_id): name
            for name in (*_PARTS, "firmware_status", "firmware_faults")
        }
        self._words: dict[str, np.uint64] = {}
        self._file = SampleFile(path)
        self._rows = SampleBuffer(NavigationOutput, self._file)
        self._row = NavigationOutput.zeros(1)
        self._mode = Mode.POWER_ON
        self._fault = FirmwareFault.NONE
        self._counters = dict.fromkeys(_COUNTERS, 0)
        self._position = 0
        self._cycle = 0
        self._not_following = [False, False]
        self._first_epoch = -1
        self.frames = 0
        self.is_heard = False

    def take(self, frames: FrameArray, count: int, epoch: int) -> None:
        """Take what the firmware has sent in the hardware's epoch `epoch`."""
        self.frames += count
        if count <= _AXIS_COMMANDS:
            return
        for can_id, k in zip(frames["can_id"][:count].tolist(), range(count), strict=True):
            name = self._names.get(can_id)
            if name is None:
                continue
            if not crc_holds(frames[k], getattr(self._contract, name).message):
                continue
            word = np.uint64(frames[k]["data"])
            self.is_heard = True
            if name == "firmware_status":
                self._note_status(word)
            elif name == "firmware_faults":
                for counter in _COUNTERS:
                    self._counters[counter] = self._raw(name, counter, word)
            else:
                self._words[name] = word
                if name == _PARTS[-1] and len(self._words) == len(_PARTS):
                    self._note_fix(epoch)

    def _raw(self, message: str, signal: str, word: np.uint64) -> int:
        return int(unpack(word, getattr(getattr(self._contract, message), signal)))

    def _value(self, message: str, signal: str) -> float:
        layout = getattr(getattr(self._contract, message), signal)
        return float(to_physical(unpack(self._words[message], layout), layout))

    def _note_status(self, word: np.uint64) -> None:
        mode = self._raw("firmware_status", "mode", word)
        fault = self._raw("firmware_status", "fault", word)
        self._mode = Mode(mode) if mode in tuple(Mode) else self._mode
        self._fault = FirmwareFault(fault) if fault in tuple(FirmwareFault) else self._fault
        self._position = self._raw("firmware_status", "scheme_position", word)
        self._cycle = self._raw("firmware_status", "scheme_cycle", word)
        self._not_following = [
            bool(self._raw("firmware_status", f"axis_{axis}_not_following", word))
            for axis in ("inner", "outer")
        ]

    def _note_fix(self, now: int) -> None:
        """Keep a whole group of navigation frames; its epoch is told modulo 2^12."""
        layout = self._contract.nav_latitude.epoch
        modulus = 1 << int(layout.length)
        told = self._raw("nav_latitude", "epoch", self._words["nav_latitude"])
        epoch = now - (now - told) % modulus
        row = self._row[0]
        if self._first_epoch < 0:
            self._first_epoch = epoch
        elif epoch <= int(row["epoch"]):
            return  # a repetition
        row["epoch"] = epoch
        row["mode"] = int(self._mode)
        row["latitude"] = math.radians(self._value("nav_latitude", "latitude_deg"))
        row["longitude"] = math.radians(self._value("nav_longitude", "longitude_deg"))
        row["height"] = self._value("nav_height", "height")
        row["velocity_n"] = (
            self._value("nav_velocity", "velocity_east"),
            self._value("nav_velocity", "velocity_north"),
            self._value("nav_height", "velocity_up"),
        )
        for name in ("roll", "pitch", "heading"):
            row[name] = math.radians(self._value("nav_attitude", f"{name}_deg"))
        self._rows.append(self._row)
        self._words.clear()

    @property
    def _epochs_navigated(self) -> int:
        return 0 if self._first_epoch < 0 else int(self._row[0]["epoch"]) - self._first_epoch + 1

    def summary(self, epoch: int) -> JsonObject:
        """Return what is known of the firmware, by the keys of its own summary."""
        return {
            "mode": self._mode.name,
            "fault": self._fault.name,
            "epoch": epoch,
            "epochs_navigated": self._epochs_navigated,
            "navigation_sha256": None,
            "scheme_cycles": self._cycle,
            "axes_not_following": self._not_following,
            "frames_sent": self.frames,
            "faults": dict(self._counters),
        }

    def progress(self, epoch: int) -> JsonObject:
        """Return mode, position and scheme, for a progress line."""
        row = self._row[0]
        return {
            "epoch": epoch,
            "mode": self._mode.name,
            "fault": self._fault.name,
            "position": self._position,
            "navigating": self._mode in (Mode.NAVIGATION_STRAPDOWN, Mode.NAVIGATION_ROTATING)
            and self._first_epoch >= 0,
            "latitude": float(row["latitude"]),
            "longitude": float(row["longitude"]),
            "overruns": self._counters["overruns"],
        }

    def close(self) -> None:
        """Write the samples that are left."""
        self._rows.flush()
        self._file.close()


def _prepare() -> None:
    """Let a spare follower take one frame of each kind, so that all code is compiled or loaded."""
    contract = load_contract()[0]
    frames = frame_array(len(_PARTS) + 2)
    for frame, name in zip(frames, ("firmware_status", "firmware_faults", *_PARTS), strict=True):
        fill(frame, getattr(contract, name).message, np.uint64(0), 0)
    Follower(None).take(frames, len(frames), 0)


def follower_of(folder: Path | None) -> Follower:
    """Return a follower that writes its samples where the firmware's own would be.

    What it needs is there after that: nothing is left to compile while time is real.
    """
    load()
    _prepare()
    return Follower(None if folder is None else folder / NAVIGATION_SAMPLES)
