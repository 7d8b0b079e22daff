"""The hardware's set-up, in the units of data sheets, and the record made from it."""

from __future__ import annotations

import math
from dataclasses import dataclass

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
from rrins.host_tools.hardware.units import ARCSEC as ARCSEC
from rrins.host_tools.hardware.units import DEG_PER_SQRT_H as DEG_PER_SQRT_H
from rrins.host_tools.hardware.units import DPH as DPH
from rrins.host_tools.hardware.units import PPM as PPM
from rrins.host_tools.hardware.units import SQRT_H as SQRT_H
from rrins.host_tools.hardware.units import STANDARD_GRAVITY as STANDARD_GRAVITY
from rrins.host_tools.hardware.units import UG as UG

DRIFT_S = 1.0
"""Interval between updates of the drifting errors, s."""

FLICKER_SHORTEST_S = 2.0
FLICKER_RATIO = 8.0
"""Shortest time constant of a sensor's bias instability, and the ratio from one to the next."""


@dataclass(frozen=True)
class SensorErrors:
    """Errors of one sensor in SI units. Paper, (16), (17), and further data sheet values."""

    bias: float = 0.0  # rad/s or m/s²
    scale_error: float = 0.0  # λ
    asymmetric_scale_error: float = 0.0  # μ
    delta_u: float = 0.0  # rad
    delta_v: float = 0.0  # rad
    white_noise: float = 0.0  # rad/√s or m/s/√s
    bias_instability: float = 0.0  # rad/s or m/s², the coefficient B of IEEE 952
    rate_random_walk: float = 0.0  # rad/s/√s or m/s²/√s
    bias_repeatability: float = 0.0  # rad/s or m/s², standard deviation over power-ups
    scale_repeatability: float = 0.0
    temperature_bias: float = 0.0  # rad/s/K or m/s²/K
    temperature_scale: float = 0.0  # 1/K
    force_coefficient: float = 0.0  # rad/s per m/s²; gyros only
    dead_zone: float = 0.0  # rad/s or m/s²
    position_x: float = 0.0  # m, in the sensor frame from the reference point; accelerometers only
    position_y: float = 0.0  # m
    position_z: float = 0.0  # m


@dataclass(frozen=True)
class SensorSet:
    """The sensors of one kind: design directions (α, β) in rad, errors, what they have in common.

    In SI units; `bandwidth_hz` None for one without a limit, `resolution` (rad or m/s) 0 for one
    as fine as the frame's.
    """

    axes: tuple[tuple[float, float], ...]
    errors: tuple[SensorErrors, ...]
    measuring_range: float
    bandwidth_hz: float | None = None
    latency_s: float = 0.0
    resolution: float = 0.0


@dataclass(frozen=True)
class Drive:
    """One axis of the turntable: limits, encoder and imperfections."""

    rate_limit_dps: float
    acceleration_limit_dps2: float
    encoder_step_deg: float
    jerk_limit_dps3: float | None = None
    encoder_offset_deg: float = 0.0
    ripple_deg: float = 0.0
    ripple_per_turn: float = 1.0
    stiction_deg: float = 0.0
    run_out_m: float = 0.0


@dataclass(frozen=True)
class TableGeometry:
    """Alignment errors of the axes relative to each other, in rad."""

    tilt: float = 0.0
    wobble: float = 0.0
    wobble_per_turn: float = 1.0


@dataclass(frozen=True)
class ThermalSettings:
    """Temperature of the sensors above that of calibration, K, and how they warm up."""

    offset: float = 0.0
    warm_up: float = 0.0
    time_constant_s: float = 600.0


@dataclass(frozen=True)
class AltimeterSettings:
    """The barometric altimeter, m."""

    bias: float = 0.0
    noise: float = 0.0


@dataclass(frozen=True)
class GnssSettings:
    """The GNSS receiver; `outages` are the first and the last epoch of each."""

    interval_epochs: int
    latency_epochs: int = 0
    position_noise: float = 0.0  # m, white
    velocity_noise: float = 0.0  # m/s, white
    correlated_noise: float = 0.0  # m, of the position, first-order Gauss-Markov
    correlation_epochs: float = 1.0  # its time constant
    outages: tuple[tuple[int, int], ...] = ()
    lever_arm_b: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, to the antenna


@dataclass(frozen=True)
class OdometerSettings:
    """The odometer; `lever_arm_b` from the reference point to the wheel's contact.

    `mounting` is heading and pitch of the vehicle's forward axis in the body frame, rad, as those
    of a body in the navigation frame.
    """

    interval_epochs: int
    latency_epochs: int = 0
    metres_per_pulse: float = 0.002  # as the data sheet says
    scale_error: float = 0.0  # a share of 1: what it counts too much
    noise: float = 0.0  # m/s, of the mean speed over an interval
    mounting: tuple[float, float] = (0.0, 0.0)
    lever_arm_b: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m


@dataclass(frozen=True)
class MotionPieces:
    """The vehicle's motion, see `rrins.host_tools.hardware.motion`.

    Attributes
    ----------
    pieces : array, shape (n, 15, 8)
    piece_epochs : int
    start_epoch : int
        In which the first piece begins; before, the vehicle rests in the piece's initial pose.
    loop_from : int or None
        Piece to continue with after the last; None to rest.
    """

    pieces: NDArray[np.float64]
    piece_epochs: int
    start_epoch: int
    loop_from: int | None = None


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
    gyros: SensorSet
    accelerometers: SensorSet
    inner: Drive
    outer: Drive
    requests: tuple[tuple[int, int], ...]
    """The operator's requests, (epoch, `mode_request`), in order of time."""
    readmissions: tuple[tuple[int, int, int, int, int], ...] = ()
    """Orders to readmit a sensor, (epoch, kind, sensor from 1, anew, test_s), in order of time."""
    standing: tuple[tuple[int, int, float], ...] = ()
    """When the operator says that the vehicle stands: (first, last epoch, sigma in m/s)."""
    table: TableGeometry = TableGeometry()
    thermal: ThermalSettings = ThermalSettings()
    altimeter: AltimeterSettings | None = None
    gnss: GnssSettings | None = None
    master: MasterSettings | None = None
    odometer: OdometerSettings | None = None
    motion: MotionPieces | None = None
    faults: tuple[PlannedFault, ...] = ()


def _power_up_values(sensors: SensorSet, seed: np.random.SeedSequence) -> NDArray[np.float64]:
    """Return the sensors' bias and scale factor error of this power-up, shape (m, 2)."""
    drawn = np.random.default_rng(seed).standard_normal((len(sensors.errors), 2))
    constant = [(e.bias, e.scale_error) for e in sensors.errors]
    spread = [(e.bias_repeatability, e.scale_repeatability) for e in sensors.errors]
    return np.asarray(np.array(constant) + drawn * np.array(spread))


def _fill_sensors(
    record: Sensors, sensors: SensorSet, dt: float, seed: np.random.SeedSequence
) -> None:
    count = len(sensors.axes)
    record.count = count
    record.range_increment = sensors.measuring_range * dt
    streams = seed.generate_state(count, dtype=np.uint64)
    powered_up = _power_up_values(sensors, seed.spawn(1)[0])
    for k, ((alpha, beta), errors) in enumerate(zip(sensors.axes, sensors.errors, strict=True)):
        bias, scale_error = powered_up[k]
        record.axis[k] = installed_axis(alpha, beta, errors.delta_u, errors.delta_v)
        record.mounted_axis[k] = record.axis[k]
        record.axis_by_angle[k] = axis_by_angle(alpha, beta)
        record.scale_error[k] = record.constant_scale_error[k] = scale_error
        record.asymmetric_scale_error[k] = errors.asymmetric_scale_error
        record.bias_increment[k] = record.constant_bias_increment[k] = bias * dt
        record.noise_increment[k] = errors.white_noise * math.sqrt(dt)
        record.force_coefficient[k] = errors.force_coefficient
        record.dead_increment[k] = errors.dead_zone * dt
        record.noise_state[k] = streams[k]
        record.position_s[k] = errors.position_x, errors.position_y, errors.position_z
    record.displaced = bool(record.position_s.any())
    record.resolution_increment = sensors.resolution
    _fill_lag(record, sensors, dt)
    _fill_drift(record, sensors, dt)


def _fill_lag(record: Sensors, sensors: SensorSet, dt: float) -> None:
    """Fill bandwidth (first order, time constant 1 / (2π f)) and latency."""
    if sensors.bandwidth_hz is not None:
        epochs = 2 * math.pi * sensors.bandwidth_hz * dt  # of an epoch, in time constants
        record.lag_share = math.exp(-epochs)
        record.lag_mean = -math.expm1(-epochs) / epochs
    epochs = sensors.latency_s / dt
    whole = math.floor(epochs + 1e-9)
    assert whole < LATENCY_CAPACITY - 1
    record.latency_epochs = whole
    record.latency_fraction = max(0.0, epochs - whole)
    record.lags = sensors.bandwidth_hz is not None or sensors.latency_s > 0


def _fill_drift(record: Sensors, sensors: SensorSet, dt: float) -> None:
    """Fill the drifting errors, for steps of `DRIFT_S`.

    Bias instability of coefficient B has the two-sided density B²/(2π f) of the rate (IEEE Std 952,
    annex C). Processes with the variance B² ln r / π each, their time constants a ratio r apart,
    add up to it between the shortest and the longest; they start at zero.
    """
    variance = math.log(FLICKER_RATIO) / math.pi
    constants_s = FLICKER_SHORTEST_S * FLICKER_RATIO ** np.arange(FLICKER_POLES)
    decay = np.exp(-DRIFT_S / constants_s)
    record.flicker_decay = decay
    for k, errors in enumerate(sensors.errors):
        spread = errors.bias_instability * math.sqrt(variance)
        record.flicker_drive[k] = spread * np.sqrt(1 - decay**2) * dt
        record.walk_drive[k] = errors.rate_random_walk * math.sqrt(DRIFT_S) * dt
        record.temperature_bias_increment[k] = errors.temperature_bias * dt
        record.temperature_scale[k] = errors.temperature_scale
    record.drifts = any(
        e.bias_instability or e.rate_random_walk or e.temperature_bias or e.temperature_scale
        for e in sensors.errors
    )


def _fill_drive(axis: TurntableAxis, drive: Drive, dt: float) -> None:
    axis.rate_limit = math.radians(drive.rate_limit_dps)
    axis.acceleration_limit = math.radians(drive.acceleration_limit_dps2)
    if drive.jerk_limit_dps3 is not None:
        rise_s = drive.acceleration_limit_dps2 / drive.jerk_limit_dps3
        axis.ramp_smoothing = math.ceil(rise_s / dt - 1e-9)
    axis.encoder_step_deg = drive.encoder_step_deg
    axis.encoder_offset_deg = drive.encoder_offset_deg
    axis.ripple = math.radians(drive.ripple_deg)
    axis.ripple_per_turn = drive.ripple_per_turn
    axis.stiction = math.radians(drive.stiction_deg)
    axis.sticks = drive.stiction_deg > 0
    axis.run_out = drive.run_out_m


def _fill_surroundings(plant: Plant, settings: Settings, seed: np.random.SeedSequence) -> None:
    table = plant.table
    table.tilt, table.wobble = settings.table.tilt, settings.table.wobble
    table.wobble_per_turn = settings.table.wobble_per_turn
    table.is_crooked = settings.table.tilt != 0 or settings.table.wobble != 0
    plant.thermal.offset = settings.thermal.offset
    plant.thermal.warm_up = settings.thermal.warm_up
    plant.thermal.time_constant = settings.thermal.time_constant_s
    if settings.altimeter is not None:
        altimeter = plant.altimeter
        altimeter.fitted = True
        altimeter.bias, altimeter.noise = settings.altimeter.bias, settings.altimeter.noise
        altimeter.noise_state[0] = seed.generate_state(1, dtype=np.uint64)[0]
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


def _fill_gnss(plant: Plant, settings: Settings, seed: np.random.SeedSequence) -> None:
    if settings.gnss is None:
        return
    latitude, height = math.radians(settings.latitude_deg), settings.height_m
    meridian, prime_vertical = earth.curvature_radii(latitude)
    plant.gnss.north_m_per_rad = meridian + height
    plant.gnss.east_m_per_rad = (prime_vertical + height) * math.cos(latitude)
    _fill_receiver(plant.gnss, settings.gnss, seed)


def _fill_receiver(gnss: GnssState, settings: GnssSettings, seed: np.random.SeedSequence) -> None:
    assert 0 <= settings.latency_epochs < settings.interval_epochs
    assert len(settings.outages) <= OUTAGE_CAPACITY
    gnss.fitted = True
    gnss.interval_epochs = settings.interval_epochs
    gnss.latency_epochs = settings.latency_epochs
    gnss.position_noise = settings.position_noise
    gnss.velocity_noise = settings.velocity_noise
    gnss.position_sigma = math.hypot(settings.position_noise, settings.correlated_noise)
    gnss.correlated_noise = settings.correlated_noise
    gnss.correlated_share = math.exp(-settings.interval_epochs / settings.correlation_epochs)
    gnss.lever_arm_b[:] = settings.lever_arm_b
    gnss.has_lever_arm = any(settings.lever_arm_b)
    gnss.outage_count = len(settings.outages)
    for k, (first, last) in enumerate(settings.outages):
        gnss.outage_first[k], gnss.outage_last[k] = first, last
    gnss.noise_state[0] = seed.generate_state(1, dtype=np.uint64)[0]


def _fill_odometer(
    odometer: OdometerState, settings: OdometerSettings | None, seed: np.random.SeedSequence
) -> None:
    if settings is None:
        return
    assert 0 <= settings.latency_epochs < settings.interval_epochs
    odometer.fitted = True
    odometer.interval_epochs = settings.interval_epochs
    odometer.latency_epochs = settings.latency_epochs
    odometer.metres_per_pulse = settings.metres_per_pulse / (1 + settings.scale_error)
    odometer.noise = settings.noise
    heading, pitch = settings.mounting
    odometer.forward_b = body_to_navigation(0.0, pitch, heading)[:, 1]
    odometer.lever_arm_b[:] = settings.lever_arm_b
    odometer.has_lever_arm = any(settings.lever_arm_b)
    odometer.noise_state[0] = seed.generate_state(1, dtype=np.uint64)[0]


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
    _fill_sensors(plant.gyros, settings.gyros, dt, gyro_seed)
    _fill_sensors(plant.accelerometers, settings.accelerometers, dt, accelerometer_seed)
    _fill_drive(plant.axis[INNER], settings.inner, dt)
    _fill_drive(plant.axis[OUTER], settings.outer, dt)
    _fill_surroundings(plant, settings, altimeter_seed)
    _fill_gnss(plant, settings, gnss_seed)
    fill_master(plant.master, settings.master, latitude, settings.height_m)
    _fill_odometer(plant.odometer, settings.odometer, odometer_seed)
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
