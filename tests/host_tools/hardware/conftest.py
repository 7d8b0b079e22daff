"""Hardware on the bench: settings, command frames made by hand, frames decoded by cantools."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rrins.dbc import codec
from rrins.dbc.e2e import protect
from rrins.dbc.frame import Frame, frame_array
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.memory import Plant
from rrins.host_tools.hardware.settings import Settings
from rrins.host_tools.hardware.tables import Accelerometers, Gyros, Thermal, Turntable

CODEC = codec.load()
NAMES = {message.frame_id: message.name for message in CODEC.database.messages}
TETRAHEDRON_DEG = ((180.0, 0.0), *((math.degrees(math.acos(1 / 3)), b) for b in (0, 120, 240)))
WIDE = {"range_dps": 60_000.0}, {"range_g": 100.0}


def make_settings(**changes: Any) -> Settings:
    values: dict[str, Any] = {
        "rate_hz": 200,
        "seed": 1,
        "latitude_deg": 40.0,
        "longitude_deg": 116.0,
        "height_m": 40.0,
        "roll_deg": 0.0,
        "pitch_deg": 0.0,
        "heading_deg": 0.0,
        "gyro_axes_deg": TETRAHEDRON_DEG,
        "accelerometer_axes_deg": TETRAHEDRON_DEG,
        "gyros": Gyros(**WIDE[0]),
        "accelerometers": Accelerometers(**WIDE[1]),
        "turntable": Turntable(),
        "thermal": Thermal(),
        "requests": (),
    }
    return Settings(**values | changes)


def make_frame(name: str, counter: int, **raws: int) -> np.void:
    """Return a protected frame of a message with raw signal values."""
    word = 0
    for signal, raw in raws.items():
        row = CODEC.signals[CODEC.signal_index(name, signal)]
        word |= (int(raw) & ((1 << int(row["length"])) - 1)) << int(row["shift"])
    message = CODEC.messages[CODEC.message_index(name)]
    frame = frame_array(1)
    frame["can_id"], frame["length"] = message["can_id"], message["length"]
    frame["data"] = protect(np.uint64(word), message, counter)
    return frame[0]


def make_command(
    axis: str, epoch: int, target_deg: float = 0.0, what: int = 2, rate_dps: float = 20.0
) -> np.void:
    """Return an axis command; `axis` is INNER or OUTER, `what` 0 off, 1 hold, 2 position."""
    return make_frame(
        f"AXIS_{axis}_COMMAND",
        epoch,
        command=what,
        target_angle_deg=round(target_deg * 2**26 / 360),
        rate_limit_dps=round(rate_dps * 1e3),
    )


def decode_frame(frame: np.void) -> tuple[str, dict[str, Any]]:
    """Return name and values of a frame, by cantools."""
    message = CODEC.database.get_message_by_frame_id(int(frame["can_id"]))
    payload = int(frame["data"]).to_bytes(8, "little")[: int(frame["length"])]
    return message.name, message.decode(payload, decode_choices=False)


class Sent(Mapping[str, dict[str, Any]]):
    """What an epoch sends, by message; decoded when somebody looks."""

    def __init__(self, frames: Iterable[np.void]) -> None:
        self._frames = {NAMES[int(frame["can_id"])]: frame for frame in frames}

    def __getitem__(self, name: str) -> dict[str, Any]:
        return decode_frame(self._frames[name])[1]

    def __iter__(self) -> Iterator[str]:
        return iter(self._frames)

    def __len__(self) -> int:
        return len(self._frames)


class Bench:
    """A hardware that is stepped epoch by epoch."""

    def __init__(self, **changes: Any) -> None:
        self.hardware = Hardware(make_settings(**changes))
        self.plant = self.hardware.plant[0]
        self.counters = self.plant["counters"]

    @property
    def epoch(self) -> int:
        """The epoch of the next step."""
        return int(self.plant["epoch"])

    def raw_step(self, frames: Any = ()) -> list[np.void]:
        inbox = np.array(list(frames), dtype=Frame.dtype) if len(frames) else frame_array(1)
        sent = self.hardware.step(inbox, len(frames))
        return [frame.copy() for frame in self.hardware.outbox[:sent]]

    def step(self, frames: Any = ()) -> Sent:
        """Run one epoch on frames; return what is sent, by message."""
        return Sent(self.raw_step(frames))

    def commanded_step(self, inner: dict[str, Any] | None = None, outer: Any = None) -> Any:
        """Run one epoch with the commands of the epoch before."""
        before = self.epoch - 1
        frames = [
            make_command(axis, before, **values or {"what": 1})
            for axis, values in (("INNER", inner), ("OUTER", outer))
        ]
        return self.step(frames if before >= 0 else ())


@pytest.fixture(scope="session")
def tools() -> SimpleNamespace:
    """Everything of this module that tests call."""
    return SimpleNamespace(
        Bench=Bench,
        codec=CODEC,
        command=make_command,
        decode=decode_frame,
        frame=make_frame,
        settings=make_settings,
        tetrahedron_deg=TETRAHEDRON_DEG,
    )


@pytest.fixture
def plant() -> Any:
    """Return a zeroed plant record."""
    return np.zeros(1, dtype=Plant.dtype)[0]
