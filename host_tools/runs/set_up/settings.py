"""The settings of each side for a scenario: plain numbers, never the other side's code."""

from __future__ import annotations

import functools
import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

import rrins.firmware_py.core.settings as firmware
import rrins.host_tools.hardware.settings as hardware
from rrins.firmware_py.core.modes.modes import ModeRequest
from rrins.firmware_py.core.records.redundancy_records import SensorKind
from rrins.firmware_py.core.sensors import calibration
from rrins.firmware_py.core.sensors.calibration import Calibration, CalibrationError
from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.hardware.settings import (
    ARCSEC,
    DEG_PER_SQRT_H,
    DPH,
    PPM,
    SQRT_H,
    STANDARD_GRAVITY,
    UG,
)
from rrins.host_tools.motion.build import build
from rrins.host_tools.motion.mounting import mounted
from rrins.host_tools.motion.trajectory import ATTITUDE, PLACE, Trajectory
from rrins.host_tools.runs.set_up.data_sheets import estimator_settings, redundancy_settings
from rrins.host_tools.runs.set_up.master import master_settings
from rrins.host_tools.runs.set_up.tunnels import outages
from rrins.host_tools.scenario.fault_tables import FaultOnWire
from rrins.host_tools.scenario.geometry import AxesDeg
from rrins.host_tools.scenario.motion import Motion
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.tables import (
    Accelerometers,
    Axis,
    Body,
    Gyros,
    PerSensor,
    Site,
    each,
)
from rrins.host_tools.wire.wire import Wire

_NO_ARM = (0.0, 0.0, 0.0)
_ATTITUDE_STREAM = 11  # independent of the hardware's own draws with the same seed


def firmware_settings(scenario: Scenario) -> firmware.Settings:
    """Return what the firmware is set up with.

    Raises
    ------
    ScenarioError
        When the calibration file cannot be used.
    MotionError
        When a recorded motion cannot be used.
    """
    settings, table = scenario.firmware, scenario.turntable
    gyros, accelerometers = scenario.rimu.gyros, scenario.rimu.accelerometers
    return firmware.Settings(
        rate_hz=scenario.rate_hz,
        **asdict(given_pose(scenario)),
        gyro_axes_deg=gyros,
        accelerometer_axes_deg=accelerometers,
        gyro_weights=each(settings.gyro_weights, len(gyros)),
        accelerometer_weights=each(settings.accelerometer_weights, len(accelerometers)),
        initial_attitude=settings.initial_attitude,
        alignment_s=settings.alignment_s,
        height_channel=settings.height_channel,
        bridge_s=settings.bridge_s,
        axis_acceleration_dps2=scenario.axis_acceleration_dps2,
        axis_rise_s=scenario.axis_rise_s,
        isolation_rate_dps=table.inner.rate_limit_dps,
        encoder_step_deg=max(_drive(axis).encoder_step_deg for axis in (table.inner, table.outer)),
        follow_tolerance_deg=settings.follow_tolerance_deg,
        axis_silence_s=settings.axis_silence_s,
        gyro_consistency_dph=settings.gyro_consistency_dph,
        accelerometer_consistency_ug=settings.accelerometer_consistency_ug,
        scheme=scenario.scheme,
        altimeter=scenario.altimeter is not None,
        gnss_interval_s=0.0 if scenario.gnss is None else 1 / scenario.gnss.rate_hz,
        gnss_lever_arm_m=_NO_ARM if scenario.gnss is None else scenario.gnss.lever_arm_m,
        odometer=_nominal_odometer(scenario),
        calibration=_calibration(settings.calibration, len(gyros), len(accelerometers)),
        redundancy=redundancy_settings(scenario),
        estimator=estimator_settings(scenario),
        calibration_file=settings.calibration,
    )


def _nominal_odometer(scenario: Scenario) -> firmware.OdometerSettings | None:
    odometer = scenario.odometer
    if odometer is None:
        return None
    return firmware.OdometerSettings(
        interval_s=1 / odometer.rate_hz,
        metres_per_pulse=odometer.pulse_mm * 1e-3,
        noise_mps=odometer.noise_mps,
        lever_arm_m=odometer.lever_arm_m,
    )


def _calibration(path: str | None, gyros: int, accelerometers: int) -> Calibration:
    if path is None:
        return Calibration()
    try:
        return calibration.load(Path(path), gyros, accelerometers)
    except CalibrationError as error:
        raise ScenarioError(str(error)) from error


def check_files(scenario: Scenario) -> None:
    """Check the files that a scenario names, before anything is started.

    Raises
    ------
    ScenarioError
        When the calibration file cannot be used.
    MotionError
        When a recorded motion cannot be used.
    """
    firmware_settings(scenario)
    trajectory_of(scenario)


def scenario_wire(scenario: Scenario, is_live: bool = False) -> Wire | None:
    """Return the wire of a run, or None where it would never do anything.

    `is_live` says that faults may be put in by FAULT_COMMAND while it runs.
    """
    faults = tuple(
        fault.fault(scenario.rate_hz) for fault in scenario.faults if isinstance(fault, FaultOnWire)
    )
    if not faults and scenario.bus.bitrate is None and not is_live:
        return None
    wire = Wire(scenario.period_ns, faults, scenario.seed, scenario.bus.bitrate)
    return None if wire.is_ideal and not is_live else wire


def _per_sensor(value: PerSensor, count: int, unit: float) -> tuple[float, ...]:
    """Return a value for each sensor, in SI units."""
    return tuple(v * unit for v in each(value, count))


def _sensor_set(
    axes_deg: AxesDeg,
    table: Gyros | Accelerometers,
    own: dict[str, tuple[PerSensor, float]],
    **common: float,
) -> hardware.SensorSet:
    """Return the sensors of a kind.

    `own` has what the kinds name differently, with the unit of each.
    """
    columns = own | {
        "scale_error": (table.scale_error_ppm, PPM),
        "asymmetric_scale_error": (table.asymmetric_scale_error_ppm, PPM),
        "delta_u": (table.installation_u_arcsec, ARCSEC),
        "delta_v": (table.installation_v_arcsec, ARCSEC),
        "scale_repeatability": (table.scale_repeatability_ppm, PPM),
        "temperature_scale": (table.scale_temperature_ppm_per_k, PPM),
    }
    count = len(axes_deg)
    values = {name: _per_sensor(value, count, unit) for name, (value, unit) in columns.items()}
    return hardware.SensorSet(
        axes=tuple((math.radians(alpha), math.radians(beta)) for alpha, beta in axes_deg),
        errors=tuple(
            hardware.SensorErrors(**{name: column[k] for name, column in values.items()})
            for k in range(count)
        ),
        bandwidth_hz=table.bandwidth_hz,
        latency_s=table.latency_ms * 1e-3,
        **common,
    )


def _gyros(axes_deg: AxesDeg, gyros: Gyros) -> hardware.SensorSet:
    own: dict[str, tuple[PerSensor, float]] = {
        "bias": (gyros.bias_dph, DPH),
        "bias_repeatability": (gyros.bias_repeatability_dph, DPH),
        "bias_instability": (gyros.bias_instability_dph, DPH),
        "temperature_bias": (gyros.bias_temperature_dph_per_k, DPH),
        "white_noise": (gyros.angle_random_walk_deg_per_sqrt_h, DEG_PER_SQRT_H),
        "rate_random_walk": (gyros.rate_random_walk_dph_per_sqrt_h, DPH / SQRT_H),
        "force_coefficient": (gyros.g_sensitivity_dph_per_g, DPH / STANDARD_GRAVITY),
        "dead_zone": (gyros.dead_zone_dph, DPH),
    }
    return _sensor_set(
        axes_deg,
        gyros,
        own,
        measuring_range=math.radians(gyros.range_dps),
        resolution=gyros.resolution_arcsec * ARCSEC,
    )


def _accelerometers(axes_deg: AxesDeg, accelerometers: Accelerometers) -> hardware.SensorSet:
    own: dict[str, tuple[PerSensor, float]] = {
        "bias": (accelerometers.bias_ug, UG),
        "bias_repeatability": (accelerometers.bias_repeatability_ug, UG),
        "bias_instability": (accelerometers.bias_instability_ug, UG),
        "temperature_bias": (accelerometers.bias_temperature_ug_per_k, UG),
        "white_noise": (accelerometers.white_noise_ug_per_sqrt_hz, UG),
        "rate_random_walk": (accelerometers.random_walk_ug_per_sqrt_h, UG / SQRT_H),
        "dead_zone": (accelerometers.dead_zone_ug, UG),
        "position_x": (accelerometers.position_x_mm, 1e-3),
        "position_y": (accelerometers.position_y_mm, 1e-3),
        "position_z": (accelerometers.position_z_mm, 1e-3),
    }
    return _sensor_set(
        axes_deg,
        accelerometers,
        own,
        measuring_range=accelerometers.range_g * STANDARD_GRAVITY,
        resolution=accelerometers.resolution_um_per_s * 1e-6,
    )


def _drive(axis: Axis) -> hardware.Drive:
    return hardware.Drive(
        rate_limit_dps=axis.rate_limit_dps,
        acceleration_limit_dps2=axis.acceleration_limit_dps2,
        encoder_step_deg=360 / 2**axis.encoder_bits,
        jerk_limit_dps3=axis.jerk_limit_dps3,
        encoder_offset_deg=axis.encoder_offset_deg,
        ripple_deg=axis.ripple_arcsec / 3600,
        ripple_per_turn=axis.ripple_per_turn,
        stiction_deg=axis.stiction_arcsec / 3600,
        run_out_m=axis.run_out_um * 1e-6,
    )


@functools.lru_cache(maxsize=24)
def _trajectory(
    motion: Motion, site: Site, body: Body, period_ns: int, mounting: tuple[float, float]
) -> Trajectory | None:
    trajectory = build(motion, site, body, period_ns, Path())
    return (
        mounted(trajectory, *mounting) if trajectory is not None and any(mounting) else trajectory
    )


def _mounting(scenario: Scenario) -> tuple[float, float]:
    """Return heading and pitch of the vehicle's forward axis in the body frame, rad."""
    odometer = scenario.odometer
    if odometer is None:
        return 0.0, 0.0
    return math.radians(odometer.mounting_heading_deg), math.radians(odometer.mounting_pitch_deg)


def trajectory_of(scenario: Scenario) -> Trajectory | None:
    """Return the motion of a scenario; None where the vehicle rests.

    Raises
    ------
    MotionError
        When a recording cannot be used.
    """
    return _trajectory(
        scenario.motion, scenario.site, scenario.body, scenario.period_ns, _mounting(scenario)
    )


def _motion(scenario: Scenario) -> hardware.MotionPieces | None:
    trajectory = trajectory_of(scenario)
    if trajectory is None:
        return None
    begins_s = scenario.motion.begins_s
    epoch = scenario.navigation_epoch
    if begins_s is not None:
        epoch = round(begins_s * scenario.rate_hz)
    return hardware.MotionPieces(
        pieces=trajectory.pieces,
        piece_epochs=trajectory.knot_ns // scenario.period_ns,
        start_epoch=epoch,
        loop_from=trajectory.loop_from,
    )


@dataclass(frozen=True)
class Pose:
    """Position and attitude of the vehicle before it moves, in degrees and m."""

    latitude_deg: float
    longitude_deg: float
    height_m: float
    roll_deg: float
    pitch_deg: float
    heading_deg: float


def first_pose(scenario: Scenario) -> Pose:
    """Return the initial position and attitude of the vehicle."""
    trajectory = trajectory_of(scenario)
    if trajectory is None:
        return Pose(**scenario.site.model_dump(), **scenario.body.model_dump())
    first = trajectory.at(np.zeros(1))[0]
    latitude, longitude, height = first[PLACE]
    roll, pitch, heading = first[ATTITUDE]
    return Pose(
        latitude_deg=math.degrees(latitude),
        longitude_deg=math.degrees(longitude),
        height_m=float(height),
        roll_deg=math.degrees(roll),
        pitch_deg=math.degrees(pitch),
        heading_deg=math.degrees(heading),
    )


def attitude_error_deg(scenario: Scenario) -> tuple[float, float, float]:
    """Return the errors of the given roll, pitch and heading, with what the run draws."""
    firmware_table = scenario.firmware
    drawn = np.random.default_rng([scenario.seed, _ATTITUDE_STREAM]).standard_normal(3)
    errors = (
        firmware_table.roll_error_arcsec + firmware_table.level_error_sigma_arcsec * drawn[0],
        firmware_table.pitch_error_arcsec + firmware_table.level_error_sigma_arcsec * drawn[1],
        firmware_table.heading_error_arcsec + firmware_table.heading_error_sigma_arcsec * drawn[2],
    )
    roll, pitch, heading = (float(error) / 3600 for error in errors)
    return roll, pitch, heading


def given_pose(scenario: Scenario) -> Pose:
    """Return the initial position and attitude that the firmware is set up with.

    A transferred attitude is not: the master unit sends it.
    """
    pose, table = first_pose(scenario), scenario.firmware
    if not table.has_attitude_error or table.initial_attitude == "transferred":
        return pose
    roll, pitch, heading = attitude_error_deg(scenario)
    return replace(
        pose, **_in_range(pose.roll_deg + roll, pose.pitch_deg + pitch, pose.heading_deg + heading)
    )


def _in_range(roll_deg: float, pitch_deg: float, heading_deg: float) -> dict[str, float]:
    """Return the same attitude with pitch within ±90°, roll and heading within ±180°."""
    pitch_deg = (pitch_deg + 180) % 360 - 180
    if abs(pitch_deg) > 90:  # over the top
        pitch_deg = math.copysign(180, pitch_deg) - pitch_deg
        roll_deg, heading_deg = roll_deg + 180, heading_deg + 180
    return {
        "roll_deg": (roll_deg + 180) % 360 - 180,
        "pitch_deg": pitch_deg,
        "heading_deg": (heading_deg + 180) % 360 - 180,
    }


def _gnss(scenario: Scenario) -> hardware.GnssSettings | None:
    gnss, rate_hz = scenario.gnss, scenario.rate_hz
    if gnss is None:
        return None
    interval_epochs = round(rate_hz / gnss.rate_hz)
    return hardware.GnssSettings(
        interval_epochs=interval_epochs,
        latency_epochs=min(round(gnss.latency_s * rate_hz), interval_epochs - 1),
        position_noise=gnss.position_noise_m,
        velocity_noise=gnss.velocity_noise_mps,
        correlated_noise=gnss.position_correlated_noise_m,
        correlation_epochs=gnss.position_correlation_s * rate_hz,
        outages=outages(scenario, trajectory_of(scenario)),
        lever_arm_b=gnss.lever_arm_m,
    )


def _odometer(scenario: Scenario) -> hardware.OdometerSettings | None:
    odometer, rate_hz = scenario.odometer, scenario.rate_hz
    if odometer is None:
        return None
    interval_epochs = round(rate_hz / odometer.rate_hz)
    return hardware.OdometerSettings(
        interval_epochs=interval_epochs,
        latency_epochs=min(round(odometer.latency_s * rate_hz), interval_epochs - 1),
        metres_per_pulse=odometer.pulse_mm * 1e-3,
        scale_error=odometer.scale_error_ppm * PPM,
        noise=odometer.noise_mps,
        mounting=_mounting(scenario),
        lever_arm_b=odometer.lever_arm_m,
    )


def hardware_settings(scenario: Scenario) -> hardware.Settings:
    """Return what the hardware is set up with, the operator's requests and the end included.

    Raises
    ------
    MotionError
        When a recorded motion cannot be used.
    """
    requests = [
        (round(r.at_s * scenario.rate_hz), int(ModeRequest[r.request])) for r in scenario.requests
    ]
    altimeter, table, thermal = scenario.altimeter, scenario.turntable, scenario.thermal
    return hardware.Settings(
        rate_hz=scenario.rate_hz,
        seed=scenario.seed,
        **asdict(first_pose(scenario)),
        gyros=_gyros(scenario.rimu.gyros, scenario.gyros),
        accelerometers=_accelerometers(scenario.rimu.accelerometers, scenario.accelerometers),
        inner=_drive(table.inner),
        outer=_drive(table.outer),
        requests=(*requests, (scenario.epochs, int(ModeRequest.SHUTDOWN))),
        readmissions=tuple(
            (
                round(order.at_s * scenario.rate_hz),
                int(SensorKind[order.kind.upper()]),
                order.sensor,
                int(order.anew),
                order.test_s,
            )
            for order in scenario.redundancy.readmit
        ),
        standing=tuple(
            (
                round(time.at_s * scenario.rate_hz),
                round((time.at_s + time.for_s) * scenario.rate_hz) - 1,
                time.velocity_sigma_mps,
            )
            for time in scenario.zero_velocity
        ),
        table=hardware.TableGeometry(
            tilt=table.non_orthogonality_arcsec * ARCSEC,
            wobble=table.wobble_arcsec * ARCSEC,
            wobble_per_turn=table.wobble_per_turn,
        ),
        thermal=hardware.ThermalSettings(
            thermal.ambient_offset_k, thermal.warm_up_k, thermal.time_constant_s
        ),
        altimeter=(
            None
            if altimeter is None
            else hardware.AltimeterSettings(altimeter.bias_m, altimeter.noise_m)
        ),
        gnss=_gnss(scenario),
        master=master_settings(scenario, attitude_error_deg(scenario)),
        odometer=_odometer(scenario),
        motion=_motion(scenario),
        faults=tuple(
            fault.planned(scenario.rate_hz)
            for fault in scenario.faults
            if not isinstance(fault, FaultOnWire)
        ),
    )
