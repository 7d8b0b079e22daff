"""What the hardware is set up with, in the units of data sheets, and the record made from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from host_tools.hardware import earth
from host_tools.hardware.memory import INNER, OPERATOR_CAPACITY, OUTER, PLANT
from host_tools.hardware.sensors import installed_axis

STANDARD_GRAVITY = 9.80665
"""m/s²: what the g of µg and of an accelerometer's range stands for (ISO 80000-3)."""

DPH = math.radians(1) / 3600  # rad/s
UG = 1e-6 * STANDARD_GRAVITY  # m/s²
ARCSEC = math.radians(1) / 3600  # rad
PPM = 1e-6


@dataclass(frozen=True)
class SensorErrors:
    """Constant errors and noise of one sensor in SI units. Paper, (16), (17)."""

    bias: float = 0.0  # rad/s or m/s²
    scale_error: float = 0.0  # λ
    asymmetric_scale_error: float = 0.0  # μ
    delta_u: float = 0.0  # rad
    delta_v: float = 0.0  # rad
    white_noise: float = 0.0  # rad/√s or m/s/√s


@dataclass(frozen=True)
class SensorSet:
    """The sensors of one kind: design directions (α, β) in rad, errors, range in SI."""

    axes: tuple[tuple[float, float], ...]
    errors: tuple[SensorErrors, ...]
    measuring_range: float


@dataclass(frozen=True)
class Drive:
    """Limits of one axis of the turntable and the step of its encoder."""

    rate_limit_dps: float
    acceleration_limit_dps2: float
    encoder_step_deg: float


@dataclass(frozen=True)
class Settings:
    """The emulated hardware and where it stands."""

    rate_hz: int
    seed: int
    latitude_deg: float
    longitude_deg: float
    height_m: float
    roll_deg: float
    pitch_deg: float
    heading_deg: float
    gyros: SensorSet
    accelerometers: SensorSet
    inner: Drive
    outer: Drive
    requests: tuple[tuple[int, int], ...]
    """(epoch, `mode_request`) that the operator makes, in order of time."""


def _fill_sensors(record: Any, sensors: SensorSet, dt: float, seed: np.random.SeedSequence) -> None:
    record["count"] = len(sensors.axes)
    record["range_increment"] = sensors.measuring_range * dt
    streams = seed.generate_state(len(sensors.axes), dtype=np.uint64)
    for k, ((alpha, beta), errors) in enumerate(zip(sensors.axes, sensors.errors, strict=True)):
        record["axis"][k] = installed_axis(alpha, beta, errors.delta_u, errors.delta_v)
        record["scale_error"][k] = errors.scale_error
        record["asymmetric_scale_error"][k] = errors.asymmetric_scale_error
        record["bias_increment"][k] = errors.bias * dt
        record["noise_increment"][k] = errors.white_noise * math.sqrt(dt)
        record["noise_state"][k] = streams[k]


def _fill_drive(record: Any, drive: Drive) -> None:
    record["rate_limit"] = math.radians(drive.rate_limit_dps)
    record["acceleration_limit"] = math.radians(drive.acceleration_limit_dps2)
    record["encoder_step_deg"] = drive.encoder_step_deg


def body_to_navigation(roll: float, pitch: float, heading: float) -> NDArray[np.float64]:
    """Return ``C_b_n = Rz(-heading) Rx(pitch) Ry(roll)``, shape (3, 3), for angles in rad."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    ch, sh = math.cos(heading), math.sin(heading)
    about_y = np.array([[cr, 0, sr], [0, 1, 0], [-sr, 0, cr]])
    about_x = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    about_z = np.array([[ch, sh, 0], [-sh, ch, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_x @ about_y)


def power_on(settings: Settings) -> NDArray[Any]:
    """Return the record (an array of one) of hardware that has just been switched on."""
    plants = np.zeros(1, dtype=PLANT)
    plant = plants[0]
    dt = 1 / settings.rate_hz
    plant["period_ns"] = 1_000_000_000 // settings.rate_hz
    latitude = math.radians(settings.latitude_deg)
    attitude = tuple(
        math.radians(angle)
        for angle in (settings.roll_deg, settings.pitch_deg, settings.heading_deg)
    )
    C_n_b = body_to_navigation(*attitude).T
    plant["omega_ib_b"] = C_n_b @ earth.rotation_n(latitude)
    gravity = earth.normal_gravity(latitude, settings.height_m)
    plant["specific_force_b"] = C_n_b @ np.array([0.0, 0.0, gravity])
    gyro_seed, accelerometer_seed = np.random.SeedSequence(settings.seed).spawn(2)
    _fill_sensors(plant["gyros"], settings.gyros, dt, gyro_seed)
    _fill_sensors(plant["accelerometers"], settings.accelerometers, dt, accelerometer_seed)
    _fill_drive(plant["axis"][INNER], settings.inner)
    _fill_drive(plant["axis"][OUTER], settings.outer)
    truth = plant["truth"]
    truth["latitude"] = latitude
    truth["longitude"] = math.radians(settings.longitude_deg)
    truth["height"] = settings.height_m
    truth["roll"], truth["pitch"], truth["heading"] = attitude
    operator = plant["operator"]
    assert len(settings.requests) <= OPERATOR_CAPACITY
    operator["count"] = len(settings.requests)
    for k, (epoch, request) in enumerate(settings.requests):
        operator["epoch"][k] = epoch
        operator["request"][k] = request
    return plants
