"""What each side is set up with for a scenario: angles and numbers, never each other's code."""

from __future__ import annotations

import math

import firmware_py.settings as firmware
import host_tools.hardware.settings as hardware
from firmware_py.modes import ModeRequest
from host_tools.geometry import AxesDeg
from host_tools.hardware.settings import ARCSEC, DPH, PPM, STANDARD_GRAVITY, UG
from host_tools.scenario import Accelerometers, Gyros, Scenario, each
from host_tools.wire import Wire


def firmware_settings(scenario: Scenario) -> firmware.Settings:
    """Return what the firmware is set up with."""
    settings, site, body = scenario.firmware, scenario.site, scenario.body
    gyros, accelerometers = scenario.rimu.gyros, scenario.rimu.accelerometers
    return firmware.Settings(
        rate_hz=scenario.rate_hz,
        latitude_deg=site.latitude_deg,
        longitude_deg=site.longitude_deg,
        height_m=site.height_m,
        roll_deg=body.roll_deg,
        pitch_deg=body.pitch_deg,
        heading_deg=body.heading_deg,
        gyro_axes_deg=gyros,
        accelerometer_axes_deg=accelerometers,
        gyro_weights=each(settings.gyro_weights, len(gyros)),
        accelerometer_weights=each(settings.accelerometer_weights, len(accelerometers)),
        initial_attitude=settings.initial_attitude,
        alignment_s=settings.alignment_s,
        height_channel=settings.height_channel,
        bridge_s=settings.bridge_s,
        axis_acceleration_dps2=scenario.axis_acceleration_dps2,
        follow_tolerance_deg=settings.follow_tolerance_deg,
        axis_silence_s=settings.axis_silence_s,
        scheme=scenario.scheme,
    )


def scenario_wire(scenario: Scenario, is_live: bool = False) -> Wire | None:
    """Return the wire of a run, or None where it would never do anything.

    `is_live` says that faults may be put in by FAULT_COMMAND while it runs.
    """
    faults = tuple(fault.fault(scenario.rate_hz) for fault in scenario.faults)
    wire = Wire(scenario.period_ns, faults, scenario.seed, scenario.bus.bitrate)
    return None if wire.is_ideal and not is_live else wire


def _sensor_set(
    axes_deg: AxesDeg,
    table: Gyros | Accelerometers,
    bias: tuple[float, ...],
    white_noise: tuple[float, ...],
    measuring_range: float,
) -> hardware.SensorSet:
    count = len(axes_deg)
    columns = zip(
        bias,
        each(table.scale_error_ppm, count),
        each(table.asymmetric_scale_error_ppm, count),
        each(table.installation_u_arcsec, count),
        each(table.installation_v_arcsec, count),
        white_noise,
        strict=True,
    )
    return hardware.SensorSet(
        axes=tuple((math.radians(alpha), math.radians(beta)) for alpha, beta in axes_deg),
        errors=tuple(
            hardware.SensorErrors(
                bias=b,
                scale_error=scale * PPM,
                asymmetric_scale_error=asymmetric * PPM,
                delta_u=u * ARCSEC,
                delta_v=v * ARCSEC,
                white_noise=noise,
            )
            for b, scale, asymmetric, u, v, noise in columns
        ),
        measuring_range=measuring_range,
    )


def hardware_settings(scenario: Scenario) -> hardware.Settings:
    """Return what the hardware is set up with, the operator's requests and the end included."""
    gyros, accelerometers = scenario.gyros, scenario.accelerometers
    gyro_axes, accelerometer_axes = scenario.rimu.gyros, scenario.rimu.accelerometers
    per_sqrt_h = math.radians(1) / 60  # °/√h in rad/√s
    drives = [
        hardware.Drive(
            rate_limit_dps=axis.rate_limit_dps,
            acceleration_limit_dps2=axis.acceleration_limit_dps2,
            encoder_step_deg=360 / 2**axis.encoder_bits,
        )
        for axis in (scenario.turntable.inner, scenario.turntable.outer)
    ]
    requests = [
        (round(r.at_s * scenario.rate_hz), int(ModeRequest[r.request])) for r in scenario.requests
    ]
    return hardware.Settings(
        rate_hz=scenario.rate_hz,
        seed=scenario.seed,
        latitude_deg=scenario.site.latitude_deg,
        longitude_deg=scenario.site.longitude_deg,
        height_m=scenario.site.height_m,
        roll_deg=scenario.body.roll_deg,
        pitch_deg=scenario.body.pitch_deg,
        heading_deg=scenario.body.heading_deg,
        gyros=_sensor_set(
            gyro_axes,
            gyros,
            tuple(b * DPH for b in each(gyros.bias_dph, len(gyro_axes))),
            tuple(
                n * per_sqrt_h for n in each(gyros.angle_random_walk_deg_per_sqrt_h, len(gyro_axes))
            ),
            math.radians(gyros.range_dps),
        ),
        accelerometers=_sensor_set(
            accelerometer_axes,
            accelerometers,
            tuple(b * UG for b in each(accelerometers.bias_ug, len(accelerometer_axes))),
            tuple(
                n * UG
                for n in each(accelerometers.white_noise_ug_per_sqrt_hz, len(accelerometer_axes))
            ),
            accelerometers.range_g * STANDARD_GRAVITY,
        ),
        inner=drives[0],
        outer=drives[1],
        requests=(*requests, (scenario.epochs, int(ModeRequest.SHUTDOWN))),
    )
