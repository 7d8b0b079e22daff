"""The hardware's set-up, in the units of data sheets, and the record made from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Records
from rrins.host_tools.hardware import earth, faults
from rrins.host_tools.hardware.fault_kinds import HardwareFault
from rrins.host_tools.hardware.master_settings import MasterSettings, fill_master
from rrins.host_tools.hardware.memory import (
    FLICKER_POLES,
    INNER,
    LATENCY_CAPACITY,
    MOTION_CHANNELS,
    MOTION_TERMS,
    OPERATOR_CAPACITY,
    OUTAGE_CAPACITY,
    OUTER,
    STANDING_CAPACITY,
    GnssState,
    OdometerState,
    Plant,
    Sensors,
    TurntableAxis,
)
from rrins.host_tools.hardware.motion import set_rest
from rrins.host_tools.hardware.sensors import axis_by_angle, installed_axis
from rrins.host_tools.hardware.tables import (
    Accelerometers,
    Altimeter,
    Axis,
    GnssReceiver,
    Gyros,
    Odometer,
    Periodic,
    Thermal,
    Turntable,
)
from rrins.host_tools.hardware.units import fill, in_si

DRIFT_S = 1.0
"""Interval between updates of the drifting errors, s."""

FLICKER_SHORTEST_S = 2.0
FLICKER_RATIO = 8.0
"""Shortest time constant of a sensor's bias instability, and the ratio from one to the next."""


@dataclass(frozen=True)
class MotionPieces:
    """The vehicle's motion, see `rrins.host_tools.hardware.motion`."""

    pieces: NDArray[np.float64]  #: shape (n, 15, 8)
    piece_epochs: int
    #: in which the first piece begins; before, the vehicle rests in the piece's initial pose
    start_epoch: int
    loop_from: int | None = None  #: piece to continue with after the last; None to rest


@dataclass(frozen=True)
class PlannedFault:
    """A fault of the hardware and the epochs it lasts; a negative `last_epoch` lasts to the end.

    `cycle` of an intermittent one is as `rrins.host_tools.hardware.faults.cycle_of` returns it.
    """

    kind: HardwareFault
    target: int
    first_epoch: int
    last_epoch: int = -1
    value: float = 0.0
    cycle: tuple[int, int] = faults.ALWAYS


@dataclass(frozen=True)
class Settings:
    """The emulated hardware and its location."""

    rate_hz: int
    seed: int
    latitude_deg: float
    longitude_deg: float
    height_m: float
    roll_deg: float
    pitch_deg: float
    heading_deg: float
    gyro_axes_deg: tuple[tuple[float, float], ...]
    """Design directions of the input axes: polar angle and azimuth."""
    accelerometer_axes_deg: tuple[tuple[float, float], ...]
    gyros: Gyros
    accelerometers: Accelerometers
    turntable: Turntable
    thermal: Thermal
    requests: tuple[tuple[int, int], ...]
    """The operator's requests, (epoch, `mode_request`), in order of time."""
    readmissions: tuple[tuple[int, int, int, int, int], ...] = ()
    """Orders to readmit a sensor, (epoch, kind, sensor from 1, anew, test_s), in order of time."""
    standing: tuple[tuple[int, int, float], ...] = ()
    """When the operator says that the vehicle stands: (first, last epoch, sigma in m/s)."""
    altimeter: Altimeter | None = None
    gnss: GnssReceiver | None = None
    gnss_outages: tuple[tuple[int, int], ...] = ()
    """First and last epoch of each time without a fix."""
    master: MasterSettings | None = None
    odometer: Odometer | None = None
    motion: MotionPieces | None = None
    faults: tuple[PlannedFault, ...] = ()


def _fill_sensors(
    record: Sensors,
    table: Gyros | Accelerometers,
    axes_deg: tuple[tuple[float, float], ...],
    dt: float,
    seed: np.random.SeedSequence,
) -> None:
    """Fill the sensors of a kind: what `fill` copies by its name, and what takes more."""
    count, values = len(axes_deg), in_si(table)
    record.count = count
    record.noise_state[:count] = seed.generate_state(count, dtype=np.uint64)
    drawn = np.random.default_rng(seed.spawn(1)[0]).standard_normal((count, 2))
    values["bias"] = values["bias"] + drawn[:, 0] * values["bias_repeatability"]
    values["scale_error"] = values["scale_error"] + drawn[:, 1] * values["scale_repeatability"]
    fill(record, values, dt, count)
    record.constant_bias_increment[:] = record.bias_increment
    record.constant_scale_error[:] = record.scale_error
    record.noise_increment[:count] = values["white_noise"] * math.sqrt(dt)
    delta_u = np.broadcast_to(values["installation_u"], count)
    delta_v = np.broadcast_to(values["installation_v"], count)
    axis, by_angle = record.axis, record.axis_by_angle
    for k, (alpha, beta) in enumerate(np.radians(axes_deg)):
        axis[k] = installed_axis(alpha, beta, delta_u[k], delta_v[k])
        by_angle[k] = axis_by_angle(alpha, beta)
    record.mounted_axis[:] = axis
    for i, name in enumerate(("position_x", "position_y", "position_z")):
        record.position_s[:count, i] = values.get(name, 0.0)
    record.displaced = bool(record.position_s.any())
    _fill_lag(record, table.bandwidth_hz, values["latency"] / dt, dt)
    _fill_drift(record, values, dt)


def _fill_lag(record: Sensors, bandwidth_hz: float | None, latency: float, dt: float) -> None:
    """Fill bandwidth (first order, time constant 1 / (2π f)) and latency, in epochs."""
    if bandwidth_hz is not None:
        epochs = 2 * math.pi * bandwidth_hz * dt  # of an epoch, in time constants
        record.lag_share = math.exp(-epochs)
        record.lag_mean = -math.expm1(-epochs) / epochs
    whole = math.floor(latency + 1e-9)
    assert whole < LATENCY_CAPACITY - 1
    record.latency_epochs = whole
    record.latency_fraction = max(0.0, latency - whole)
    record.lags = bandwidth_hz is not None or latency > 0


def _fill_drift(record: Sensors, values: dict[str, Any], dt: float) -> None:
    """Fill the drifting errors, for steps of `DRIFT_S`.

    Bias instability of coefficient B has the two-sided density B²/(2π f) of the rate (IEEE Std 952,
    annex C). Processes with the variance B² ln r / π each, their time constants a ratio r apart,
    add up to it between the shortest and the longest; they start at zero.
    """
    count = record.count
    variance = math.log(FLICKER_RATIO) / math.pi
    constants_s = FLICKER_SHORTEST_S * FLICKER_RATIO ** np.arange(FLICKER_POLES)
    decay = np.exp(-DRIFT_S / constants_s)
    record.flicker_decay = decay
    spread = np.broadcast_to(values["bias_instability"] * math.sqrt(variance), count)
    record.flicker_drive[:count] = spread[:, None] * np.sqrt(1 - decay**2) * dt
    record.walk_drive[:count] = values["rate_random_walk"] * math.sqrt(DRIFT_S) * dt
    drifting = ("bias_instability", "rate_random_walk", "bias_temperature", "scale_temperature")
    record.drifts = any(np.any(values[name]) for name in drifting)


def _fill_axis(axis: TurntableAxis, table: Axis, dt: float) -> None:
    fill(axis, in_si(table))
    axis.ramp_smoothing = math.ceil(table.rise_s / dt - 1e-9)
    axis.encoder_step_deg = table.encoder_step_deg
    axis.encoder_offset_deg = table.encoder_offset_deg
    axis.sticks = table.stiction_arcsec > 0


def _fill_surroundings(plant: Plant, settings: Settings, seed: np.random.SeedSequence) -> None:
    table = plant.table
    fill(table, in_si(settings.turntable))
    table.is_crooked = table.non_orthogonality != 0 or table.wobble != 0
    fill(plant.thermal, in_si(settings.thermal))
    if settings.altimeter is not None:
        plant.altimeter.fitted = True
        fill(plant.altimeter, in_si(settings.altimeter))
        plant.altimeter.noise_state[0] = seed.generate_state(1, dtype=np.uint64)[0]
    plant.faults.changes_at = faults.NEVER
    for fault in settings.faults:
        faults.put(
            plant,
            fault.kind,
            fault.target,
            fault.first_epoch,
            fault.last_epoch,
            fault.value,
            fault.cycle,
        )


def _fill_aid(
    record: GnssState | OdometerState, table: Periodic, rate_hz: int, seed: np.random.SeedSequence
) -> None:
    """Fill what the receiver and the odometer have in common."""
    record.fitted = True
    fill(record, in_si(table))
    record.interval_epochs = table.interval_epochs(rate_hz)
    record.latency_epochs = table.latency_epochs(rate_hz)
    record.has_lever_arm = bool(record.lever_arm.any())
    record.noise_state[0] = seed.generate_state(1, dtype=np.uint64)[0]


def _fill_gnss(gnss: GnssState, settings: Settings, seed: np.random.SeedSequence) -> None:
    table, rate_hz = settings.gnss, settings.rate_hz
    if table is None:
        return
    _fill_aid(gnss, table, rate_hz, seed)
    gnss.position_sigma = math.hypot(table.position_noise_m, table.position_correlated_noise_m)
    gnss.velocity_sigma = table.velocity_noise_mps
    correlation_epochs = table.position_correlation_s * rate_hz
    gnss.correlated_share = math.exp(-gnss.interval_epochs / correlation_epochs)
    assert len(settings.gnss_outages) <= OUTAGE_CAPACITY
    gnss.outage_count = len(settings.gnss_outages)
    for k, (first, last) in enumerate(settings.gnss_outages):
        gnss.outage_first[k], gnss.outage_last[k] = first, last


def _fill_odometer(
    odometer: OdometerState, settings: Settings, seed: np.random.SeedSequence
) -> None:
    table = settings.odometer
    if table is None:
        return
    _fill_aid(odometer, table, settings.rate_hz, seed)
    values = in_si(table)
    odometer.metres_per_pulse = values["pulse"] / (1 + values["scale_error"])
    mounting = body_to_navigation(0.0, values["mounting_pitch"], values["mounting_heading"])
    odometer.forward_b = mounting[:, 1]


def _fill_motion(plant: Plant, motion: MotionPieces | None) -> None:
    if motion is None:
        return
    plant.piece_count = len(motion.pieces)
    plant.piece_epochs = motion.piece_epochs
    plant.motion_start = motion.start_epoch
    plant.loop_from = -1 if motion.loop_from is None else motion.loop_from
    set_rest(plant, motion.pieces[0], 0.0)


def pieces_of(settings: Settings) -> NDArray[np.float64]:
    """Return the vehicle's motion as `hardware_step` reads it: a zero piece if there is none."""
    if settings.motion is None:
        return np.zeros((1, MOTION_CHANNELS, MOTION_TERMS))
    return np.array(settings.motion.pieces)  # writable, as the compiled step is typed


def body_to_navigation(roll: float, pitch: float, heading: float) -> NDArray[np.float64]:
    """Return ``C_b_n = Rz(-heading) Rx(pitch) Ry(roll)``, shape (3, 3), for angles in rad."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    ch, sh = math.cos(heading), math.sin(heading)
    about_y = np.array([[cr, 0, sr], [0, 1, 0], [-sr, 0, cr]])
    about_x = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    about_z = np.array([[ch, sh, 0], [-sh, ch, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_x @ about_y)


def power_on(settings: Settings) -> Records[Plant]:
    """Return the hardware's memory, one record, at power-on."""
    plants = Plant.zeros()
    plant = plants[0]
    dt = 1 / settings.rate_hz
    plant.period_ns = 1_000_000_000 // settings.rate_hz
    latitude = math.radians(settings.latitude_deg)
    attitude = tuple(
        math.radians(angle)
        for angle in (settings.roll_deg, settings.pitch_deg, settings.heading_deg)
    )
    C_n_b = body_to_navigation(*attitude).T
    plant.omega_ib_b = C_n_b @ earth.rotation_n(latitude)
    gravity = earth.normal_gravity(latitude, settings.height_m)
    plant.specific_force_b = C_n_b @ np.array([0.0, 0.0, gravity])
    seeds = np.random.SeedSequence(settings.seed).spawn(5)
    gyro_seed, accelerometer_seed, altimeter_seed, gnss_seed, odometer_seed = seeds
    _fill_sensors(plant.gyros, settings.gyros, settings.gyro_axes_deg, dt, gyro_seed)
    _fill_sensors(
        plant.accelerometers,
        settings.accelerometers,
        settings.accelerometer_axes_deg,
        dt,
        accelerometer_seed,
    )
    _fill_axis(plant.axis[INNER], settings.turntable.inner, dt)
    _fill_axis(plant.axis[OUTER], settings.turntable.outer, dt)
    _fill_surroundings(plant, settings, altimeter_seed)
    _fill_gnss(plant.gnss, settings, gnss_seed)
    fill_master(plant.master, settings.master)
    _fill_odometer(plant.odometer, settings, odometer_seed)
    plant.drift_epochs = max(1, round(DRIFT_S * settings.rate_hz))
    truth = plant.truth
    truth.latitude = latitude
    truth.longitude = math.radians(settings.longitude_deg)
    truth.height = settings.height_m
    truth.roll, truth.pitch, truth.heading = attitude
    _fill_motion(plant, settings.motion)
    operator = plant.operator
    assert len(settings.requests) <= OPERATOR_CAPACITY
    operator.count = len(settings.requests)
    for k, (epoch, request) in enumerate(settings.requests):
        operator.epoch[k] = epoch
        operator.request[k] = request
    standing = plant.standing
    assert len(settings.standing) <= STANDING_CAPACITY
    standing.count = len(settings.standing)
    standing.present = -1
    for k, (first, last, sigma) in enumerate(settings.standing):
        standing.first[k], standing.last[k], standing.sigma[k] = first, last, sigma
    orders = plant.readmissions
    orders.count = len(settings.readmissions)
    for k, order in enumerate(settings.readmissions):
        orders.epoch[k], orders.kind[k], orders.sensor[k], orders.anew[k], orders.test_s[k] = order
    return plants
