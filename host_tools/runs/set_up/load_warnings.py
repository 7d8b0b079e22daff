"""Warnings about settings that may surprise, given before a scenario runs."""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.record import Floats
from rrins.dbc.contract import load_contract
from rrins.firmware_py.core.sensors.calibration import input_axes
from rrins.host_tools.hardware import earth
from rrins.host_tools.hardware.units import ARCSEC, DEG_PER_SQRT_H, STANDARD_GRAVITY
from rrins.host_tools.motion.trajectory import OMEGA_IB_B
from rrins.host_tools.rounding import rounded
from rrins.host_tools.runs.set_up.settings import first_pose, trajectory_of
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.tables import each
from rrins.host_tools.wire.timing import bit_time_ns

_AZIMUTH_LIMIT_DEG = 0.05
_SYNTHETIC_LIMIT_DPS = 150.0  # no drive and no ship turns faster: 60° in a wave of 3 s
_FRAME_BITS = 123
"""Of a frame of 8 bytes with its intermission and half of the stuff bits that it can have."""

_PER_PIECE = 4  # instants of a motion that are looked at


def warnings_of(scenario: Scenario) -> list[str]:
    """Return a line for each thing that will be other than one may expect.

    Raises
    ------
    MotionError
        When a recorded motion cannot be used.
    """
    found = (
        _ranges(scenario),
        _fastest_turn(scenario),
        _short_alignment(scenario),
        _slow_wire(scenario),
    )
    return [line for line in found if line is not None]


def _countable(scenario: Scenario) -> tuple[float, float]:
    """Return the largest rate (°/s) and force (g) whose increments the frames hold."""
    sensor = load_contract()[0].sensor[0]
    dtheta, dv = (
        float(signal.raw_maximum) * float(signal.scale) * scenario.rate_hz
        for signal in (sensor.gyro_dtheta, sensor.accelerometer_dv)
    )
    return math.degrees(dtheta), dv / STANDARD_GRAVITY


def _ranges(scenario: Scenario) -> str | None:
    dps, g = _countable(scenario)
    cut = []
    if scenario.gyros.range_dps > dps:
        cut.append(f"{rounded(dps)}°/s of gyros.range_dps = {scenario.gyros.range_dps:g}")
    if scenario.accelerometers.range_g > g:
        cut.append(
            f"{rounded(g)} g of accelerometers.range_g = {scenario.accelerometers.range_g:g}"
        )
    if not cut:
        return None
    return (
        f"at rate_hz = {scenario.rate_hz} a frame holds {' and '.join(cut)}; "
        "what is beyond is clipped and flagged as saturated"
    )


def _fastest_turn(scenario: Scenario) -> str | None:
    table = scenario.firmware.turn_rate_dps if scenario.mode == "rotating" else 0.0
    measured = min(scenario.gyros.range_dps, _countable(scenario)[0])
    if scenario.motion.kind != "file" and table + _SYNTHETIC_LIMIT_DPS <= measured:
        return None
    trajectory = trajectory_of(scenario)
    vehicle = 0.0
    if trajectory is not None:
        omega = trajectory.sampled(OMEGA_IB_B, _PER_PIECE)
        vehicle = math.degrees(float(np.sqrt((omega**2).sum(axis=1)).max()))
    if vehicle + table <= measured:
        return None
    return (
        f"the vehicle turns at up to {rounded(vehicle)}°/s and the table at {table:g}°/s, but the "
        f"gyros measure up to {rounded(measured)}°/s at rate_hz = {scenario.rate_hz}"
    )


def _gain(scenario: Scenario) -> Floats:
    H = input_axes(scenario.rimu.gyros)
    root = np.sqrt(each(scenario.firmware.gyro_weights, len(H)))
    return np.asarray(np.linalg.pinv(root[:, None] * H) * root)


def azimuth_error(scenario: Scenario) -> float:
    """Return the standard deviation of a self-aligned heading, rad, from noise and counting alone.

    The fine alignment goes on averaging where the coarse one ends. An error ε of the rate towards
    east turns the heading by ε / (Ω cos φ) (Groves, section 5.6.2). Over the alignment T, white
    noise of density N leaves N / √T, and counts of q at its two ends q / (√6 T). The fusion's
    largest singular value is that of the least favourable direction.
    """
    gyros, rate_hz = scenario.gyros, scenario.rate_hz
    count = len(scenario.rimu.gyros)
    aligned_s = scenario.firmware.alignment_s + scenario.estimator.fine_alignment_s
    length_s = max(1, round(aligned_s * rate_hz)) / rate_hz
    noise = np.array(each(gyros.angle_random_walk_deg_per_sqrt_h, count)) * DEG_PER_SQRT_H
    counts = math.hypot(
        float(load_contract()[0].sensor[0].gyro_dtheta.scale), gyros.resolution_arcsec * ARCSEC
    )
    rate = np.hypot(noise / math.sqrt(length_s), counts / (math.sqrt(6) * length_s))
    fused = float(np.linalg.norm(_gain(scenario) * rate, 2))
    latitude = math.radians(first_pose(scenario).latitude_deg)
    return fused / (earth.ROTATION_RATE * math.cos(latitude))


def _short_alignment(scenario: Scenario) -> str | None:
    estimator = scenario.estimator
    is_located = estimator.enabled and scenario.gnss is not None
    if scenario.firmware.initial_attitude != "self-aligned" or is_located:
        return None
    error = azimuth_error(scenario)
    if math.degrees(error) <= _AZIMUTH_LIMIT_DEG:
        return None
    latitude = math.radians(first_pose(scenario).latitude_deg)
    drift = error * earth.ROTATION_RATE * math.cos(latitude)
    radius, _ = earth.curvature_radii(latitude)
    off_km = drift * float(radius) * scenario.duration_s / 1000
    fine, key = "", "firmware.alignment_s"
    if estimator.fine_alignment_s:
        fine = f" and fine alignment of {estimator.fine_alignment_s:g} s"
        key = "estimator.fine_alignment_s"
    return (
        f"self-alignment of {scenario.firmware.alignment_s:g} s{fine}: noise and counting of the "
        f"gyros alone leave an azimuth error of {rounded(math.degrees(error), 2)}° (1 σ), which "
        f"becomes about {rounded(off_km, 2)} km over {scenario.duration_s:g} s; a longer "
        f"{key} helps"
    )


def frames_at_once(scenario: Scenario) -> int:
    """Return how many frames the hardware sends in its fullest epoch, heartbeats aside."""
    sent = ["sync", "mode_command", "axis_inner_status", "axis_outer_status"]
    groups = {
        "gnss_": scenario.gnss is not None,
        "master_": scenario.firmware.initial_attitude == "transferred",
        "odometer": scenario.odometer is not None,
        "altimeter": scenario.altimeter is not None,
        "zero_velocity": bool(scenario.zero_velocity),
    }
    names = load_contract()[0].dtype.names or ()
    for prefix, is_there in groups.items():
        sent += [name for name in names if is_there and name.startswith(prefix)]
    return len(sent) + max(len(scenario.rimu.gyros), len(scenario.rimu.accelerometers))


def _slow_wire(scenario: Scenario) -> str | None:
    bitrate, period_ns = scenario.bus.bitrate, scenario.period_ns
    if bitrate is None:
        return None
    count = frames_at_once(scenario)
    needed_ns, deadline_ns = count * _FRAME_BITS * bit_time_ns(bitrate), period_ns // 2
    if needed_ns <= deadline_ns:
        return None
    return (
        f"at bus.bitrate = {bitrate} the hardware's {count} frames of one epoch take "
        f"{needed_ns / 1e6:.1f} ms, and the firmware uses what comes within "
        f"{deadline_ns / 1e6:.1f} ms (half a period at rate_hz = {scenario.rate_hz}): "
        "the last of them will be late"
    )
