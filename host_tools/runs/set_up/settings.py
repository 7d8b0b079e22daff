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
from rrins.host_tools.motion.build import build
from rrins.host_tools.motion.mounting import mounted
from rrins.host_tools.motion.trajectory import ATTITUDE, PLACE, Trajectory
from rrins.host_tools.runs.set_up.data_sheets import (
    estimator_settings,
    integrity_settings,
    redundancy_settings,
)
from rrins.host_tools.runs.set_up.master import master_settings
from rrins.host_tools.runs.set_up.tunnels import outages
from rrins.host_tools.scenario.fault_tables import FaultOnWire
from rrins.host_tools.scenario.motion import Motion
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.tables import Body, Site, each
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
        **settings.model_dump(include=set(firmware.Keys.model_fields)),
        rate_hz=scenario.rate_hz,
        **asdict(given_pose(scenario)),
        gyro_axes_deg=gyros,
        accelerometer_axes_deg=accelerometers,
        gyro_weights=each(settings.gyro_weights, len(gyros)),
        accelerometer_weights=each(settings.accelerometer_weights, len(accelerometers)),
        axis_acceleration_dps2=scenario.axis_acceleration_dps2,
        axis_rise_s=scenario.axis_rise_s,
        isolation_rate_dps=table.inner.rate_limit_dps,
        encoder_step_deg=max(table.inner.encoder_step_deg, table.outer.encoder_step_deg),
        scheme=scenario.scheme,
        altimeter=scenario.altimeter is not None,
        gnss_interval_s=0.0 if scenario.gnss is None else 1 / scenario.gnss.rate_hz,
        gnss_lever_arm_m=_NO_ARM if scenario.gnss is None else scenario.gnss.lever_arm_m,
        odometer=_nominal_odometer(scenario),
        calibration=_calibration(settings.calibration, len(gyros), len(accelerometers)),
        redundancy=redundancy_settings(scenario),
        estimator=estimator_settings(scenario),
        integrity=integrity_settings(scenario),
        xcp=_xcp_settings(scenario),
        calibration_file=settings.calibration,
    )


def _xcp_settings(scenario: Scenario) -> firmware.XcpSettings | None:
    xcp = scenario.xcp
    return None if xcp is None else firmware.XcpSettings(**xcp.model_dump())


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
    roll, pitch, heading = map(math.degrees, first[ATTITUDE])
    return Pose(
        math.degrees(latitude), math.degrees(longitude), float(height), roll, pitch, heading
    )


def attitude_error_deg(scenario: Scenario) -> tuple[float, float, float]:
    """Return the errors of the given roll, pitch and heading, with what the run draws."""
    table = scenario.firmware
    drawn = np.random.default_rng([scenario.seed, _ATTITUDE_STREAM]).standard_normal(3).tolist()
    level, heading = table.level_error_sigma_arcsec, table.heading_error_sigma_arcsec
    return (
        (table.roll_error_arcsec + level * drawn[0]) / 3600,
        (table.pitch_error_arcsec + level * drawn[1]) / 3600,
        (table.heading_error_arcsec + heading * drawn[2]) / 3600,
    )


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
    gnss = scenario.gnss
    return hardware.Settings(
        rate_hz=scenario.rate_hz,
        seed=scenario.seed,
        **asdict(first_pose(scenario)),
        gyro_axes_deg=scenario.rimu.gyros,
        accelerometer_axes_deg=scenario.rimu.accelerometers,
        gyros=scenario.gyros,
        accelerometers=scenario.accelerometers,
        turntable=scenario.turntable,
        thermal=scenario.thermal,
        altimeter=scenario.altimeter,
        gnss=gnss,
        gnss_outages=() if gnss is None else outages(scenario, trajectory_of(scenario)),
        master=master_settings(scenario, attitude_error_deg(scenario)),
        odometer=scenario.odometer,
        motion=_motion(scenario),
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
        faults=tuple(
            fault.planned(scenario.rate_hz)
            for fault in scenario.faults
            if not isinstance(fault, FaultOnWire)
        ),
    )
