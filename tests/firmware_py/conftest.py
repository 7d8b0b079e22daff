"""A navigation computer on the bench: frames made by hand, epochs stepped one by one."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba import njit

from rrins.dbc import codec
from rrins.dbc.contract import load_contract
from rrins.dbc.e2e import protect
from rrins.dbc.frame import Frame, frame_array
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.records.memory import Ins as InsRecord
from rrins.firmware_py.core.records.troubles import Status
from rrins.firmware_py.core.sensors.calibration import input_axes
from rrins.firmware_py.core.settings import Scheme, Settings, Turn
from rrins.firmware_py.diagnostics.store import Stores
from rrins.firmware_py.loop import Firmware

CODEC = codec.load()
TETRAHEDRON_DEG = (
    (180.0, 0.0),
    *((math.degrees(math.acos(1 / 3)), b) for b in (0.0, 120.0, 240.0)),
)
HALF_TURNS = [1, -2, 1, 2, 2, 1, -2, 1, -1, 2, -1, -2, -2, -1, 2, -1]
"""Table 1: 1 the inner axis, 2 the outer, each by half a turn."""


def make_scheme(turn_rate_dps: float = 60.0, stand_s: float = 0.5, positions: int = 16) -> Scheme:
    turns = tuple(
        Turn(axis="inner" if abs(half) == 1 else "outer", angle_deg=math.copysign(180, half))
        for half in HALF_TURNS[:positions]
    )
    return Scheme(turns=turns, turn_rate_dps=turn_rate_dps, stand_s=stand_s)


def make_settings(**changes: Any) -> Settings:
    values: dict[str, Any] = {
        "rate_hz": 200,
        "latitude_deg": 40.0,
        "longitude_deg": 116.0,
        "height_m": 40.0,
        "roll_deg": 0.0,
        "pitch_deg": 0.0,
        "heading_deg": 0.0,
        "gyro_axes_deg": TETRAHEDRON_DEG,
        "accelerometer_axes_deg": TETRAHEDRON_DEG,
        "initial_attitude": "given",
        "alignment_s": 0.1,
        "height_channel": "held",
        "bridge_s": 0.02,
        "axis_acceleration_dps2": 1e9,
        "follow_tolerance_deg": 5.0,
        "axis_silence_s": 0.1,
        "gyro_consistency_dph": 50.0,
        "accelerometer_consistency_ug": 5000.0,
        "scheme": make_scheme(),
    } | changes
    values.setdefault("gyro_weights", (1.0,) * len(values["gyro_axes_deg"]))
    values.setdefault("accelerometer_weights", (1.0,) * len(values["accelerometer_axes_deg"]))
    return Settings(**values)


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


def scale_of(message: str, signal: str) -> float:
    return float(CODEC.signals[CODEC.signal_index(message, signal)]["scale"])


def decode_frame(frame: np.void) -> tuple[str, dict[str, Any]]:
    """Return name and values of a frame, by cantools."""
    message = CODEC.database.get_message_by_frame_id(int(frame["can_id"]))
    payload = int(frame["data"]).to_bytes(8, "little")[: int(frame["length"])]
    return message.name, message.decode(payload, decode_choices=False)


def rotation(axis: int, angle: float) -> np.ndarray:
    """Return the elementary rotation by `angle` (rad) about an axis: 0 x, 1 y, 2 z."""
    c, s = math.cos(angle), math.sin(angle)
    matrix = np.eye(3)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    matrix[j, j], matrix[j, k], matrix[k, j], matrix[k, k] = c, -s, s, c
    return matrix


def skew(v: Any) -> np.ndarray:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def exponential(phi: Any) -> np.ndarray:
    """Return the matrix exponential of ``[phi x]`` by its series, scaled and squared."""
    small = skew(np.asarray(phi, dtype=float)) / 256
    term, total = np.eye(3), np.eye(3)
    for k in range(1, 15):
        term = term @ small / k
        total = total + term
    return np.linalg.matrix_power(total, 256)


def body_to_navigation(roll: float, pitch: float, heading: float) -> np.ndarray:
    return rotation(2, -heading) @ rotation(0, pitch) @ rotation(1, roll)


def earth_rate_n(latitude: float) -> np.ndarray:
    return earth.RATE * np.array([0.0, math.cos(latitude), math.sin(latitude)])


class Bench:
    """A firmware at a standing vehicle whose sensors are ideal but for counting."""

    def __init__(self, stores: Stores | None = None, **changes: Any) -> None:
        settings = make_settings(**changes)
        self.firmware = Firmware(settings, stores=stores)
        self.ram = self.firmware.ram
        self.state = self.ram[0]
        self.period_ns = self.firmware.period_ns
        self.epoch = 0
        self.axes_deg = [0.0, 0.0]
        latitude = math.radians(settings.latitude_deg)
        attitude = (settings.roll_deg, settings.pitch_deg, settings.heading_deg)
        C_n_s = body_to_navigation(*np.radians(attitude)).T
        up = [0.0, 0.0, earth.gravity(latitude, settings.height_m)]
        dt = self.period_ns * 1e-9
        H_g = input_axes(settings.gyro_axes_deg)
        H_a = input_axes(settings.accelerometer_axes_deg)
        gyro, accelerometer = "gyro_dtheta", "accelerometer_dv"
        self._gyro = H_g @ C_n_s @ earth_rate_n(latitude) * dt / scale_of("SENSOR_1", gyro)
        self._accelerometer = H_a @ C_n_s @ up * dt / scale_of("SENSOR_1", accelerometer)

    @property
    def mode(self) -> Mode:
        return self.firmware.mode

    def counts(self, epoch: int) -> tuple[list[int], list[int]]:
        """Return the counts of gyros and accelerometers; what counting leaves over is carried."""
        gyro = np.rint(self._gyro * (epoch + 1)) - np.rint(self._gyro * epoch)
        accelerometer = np.rint(self._accelerometer * (epoch + 1)) - np.rint(
            self._accelerometer * epoch
        )
        return [int(c) for c in gyro], [int(c) for c in accelerometer]

    def frames(self, epoch: int | None = None, request: int | None = None) -> list[np.void]:
        """Return an epoch's frames: SYNC, the request if any, sensors, inner axis, outer axis."""
        epoch = self.epoch if epoch is None else epoch
        gyro, accelerometer = self.counts(epoch)
        frames = [make_frame("SYNC", epoch, epoch=epoch)]
        if request is not None:
            frames.append(make_frame("MODE_COMMAND", epoch, mode_request=request))
        for k, (g, a) in enumerate(zip(gyro, accelerometer, strict=True)):
            name = f"SENSOR_{k + 1}"
            frames.append(make_frame(name, epoch, gyro_dtheta=g, accelerometer_dv=a))
        for name, angle in zip(("INNER", "OUTER"), self.axes_deg, strict=True):
            raw = round(angle / scale_of("AXIS_INNER_STATUS", "encoder_angle_deg"))
            frames.append(make_frame(f"AXIS_{name}_STATUS", epoch, encoder_angle_deg=raw, state=1))
        return frames

    def step(self, frames: list[np.void] | None = None, request: int | None = None) -> list[Any]:
        """Run one epoch, on its own frames unless others are given; return what was sent."""
        frames = self.frames(request=request) if frames is None else frames
        inbox = np.array(frames, dtype=Frame.dtype) if frames else frame_array(1)
        self.consumed = 0
        sent, self.consumed = self.firmware.step(inbox, 0, len(frames), self.epoch * self.period_ns)
        self.epoch += 1
        return [frame.copy() for frame in self.firmware.outbox[:sent]]

    def run(self, epochs: int, change: Callable[[Any], Any] = lambda frames: frames) -> None:
        """Run epochs, each on its own frames as `change` makes them."""
        for _ in range(epochs):
            self.step(change(self.frames()))

    def failed(self, mask: int = Status.TEST_FAILED) -> set[str]:
        """Return the names of the trouble codes that have a bit of their status."""
        faults = self.firmware.diagnostics.faults
        return {trouble.name for trouble, _ in faults.by_mask(mask)}

    def run_to(self, mode: Mode, request: int | None = None, limit: int = 3000) -> None:
        """Step, asking once, until a mode is reached."""
        self.step(request=request)
        for _ in range(limit):
            if self.mode == mode:
                return
            self.step()
        raise AssertionError(f"{mode.name} not reached, still {self.mode.name}")


@njit
def _navigate(ins, dthetas, dvs, dt, channel, epochs, every, log):  # type: ignore[no-untyped-def]  # numba's
    """Navigate on increments that repeat; log place, velocity and attitude."""
    state = ins[0]
    for k in range(epochs):
        row = k % dthetas.shape[0]
        strapdown.update(state, dthetas[row], dvs[row], dt, channel)
        if (k + 1) % every == 0:
            out = log[(k + 1) // every - 1]
            out[0], out[1], out[2] = state.latitude, state.longitude, state.height
            for i in range(3):
                out[3 + i] = state.velocity_n[i]
            for i in range(4):
                out[6 + i] = state.q_s_n[i]


class Ins:
    """A strapdown navigation with its increments."""

    def __init__(self, C_s_n: Any, latitude: float, longitude: float = 0.0, height: float = 0.0):
        self.array = np.zeros(1, dtype=InsRecord.dtype)
        self.record = self.array[0]
        strapdown.initialise(
            self.record, np.ascontiguousarray(C_s_n, dtype=float), latitude, longitude, height
        )

    def run(
        self, dthetas: Any, dvs: Any, dt: float, epochs: int, every: int = 1, channel: int = 0
    ) -> SimpleNamespace:
        """Navigate over `epochs`; increments of shape (3,) or (n, 3) repeat. Return the log."""
        dthetas, dvs = (np.atleast_2d(np.array(a, dtype=float)) for a in (dthetas, dvs))
        self.record.reference_interval = dt
        log = np.zeros((epochs // every, 10))
        _navigate(self.array, dthetas, dvs, dt, channel, epochs, every, log)
        return SimpleNamespace(
            time=dt * every * np.arange(1, len(log) + 1),
            latitude=log[:, 0],
            longitude=log[:, 1],
            height=log[:, 2],
            velocity=log[:, 3:6],
            q=log[:, 6:10],
        )


@pytest.fixture(scope="session")
def contract() -> Any:
    return load_contract()


@pytest.fixture(scope="session")
def tools() -> SimpleNamespace:
    """Everything of this module that tests call."""
    return SimpleNamespace(
        Bench=Bench,
        Ins=Ins,
        body_to_navigation=body_to_navigation,
        codec=CODEC,
        decode=decode_frame,
        earth_rate_n=earth_rate_n,
        exponential=exponential,
        frame=make_frame,
        rotation=rotation,
        scale_of=scale_of,
        scheme=make_scheme,
        settings=make_settings,
        skew=skew,
    )
