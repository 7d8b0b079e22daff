"""The console's views of the RAM image: lines of plain ASCII, at most 79 characters."""

from __future__ import annotations

import datetime
import math

from rrins.dbc.contract import SENSOR_GROUPS
from rrins.dbc.values import AxisCommand, AxisState
from rrins.firmware_py.core.frames_in import clock
from rrins.firmware_py.core.modes.modes import FirmwareFault, Mode
from rrins.firmware_py.core.records.calibration_records import DriftState
from rrins.firmware_py.core.records.memory import INNER, OUTER
from rrins.firmware_py.core.records.redundancy_records import ReadmissionState, Refusal, SensorKind
from rrins.firmware_py.core.sensors.calibration import PPM
from rrins.firmware_py.core.turntable.sequencer import commanded_angle_deg, expected_angle_deg
from rrins.firmware_py.loop import Firmware

_NAVIGATION = (Mode.NAVIGATION_STRAPDOWN, Mode.NAVIGATION_ROTATING)
_AXES = (("inner", INNER), ("outer", OUTER))


def _name_of(kind: type[AxisState] | type[AxisCommand], value: int) -> str:
    return kind(value).name if value in list(kind) else f"? ({value})"


def status(firmware: Firmware) -> list[str]:
    """Return mode, fault, position in the scheme, time and load."""
    state = firmware.ram[0]
    own, running = state.clock, state.sequencer
    period_ns = firmware.period_ns
    seconds = firmware.epoch * period_ns * 1e-9
    sync = "never received" if not own.synchronised else "lost" if own.sync_lost else "held"
    if not running.running:
        scheme = "not running"
    elif running.homing:
        scheme = "turning both axes to zero"
    else:
        count = int(state.parameters.position_count)
        position, cycle = int(running.position) + 1, int(running.cycle) + 1
        since_s = int(running.epochs) * period_ns * 1e-9
        scheme = f"position {position} of {count}, cycle {cycle}, for {since_s:.1f} s"
    return [
        f"mode    {firmware.mode.name}",
        f"fault   {FirmwareFault(int(state.modes.fault)).name}",
        f"scheme  {scheme}",
        f"time    epoch {firmware.epoch}, {seconds:.3f} s at {1e9 / period_ns:g} Hz",
        f"sync    {sync}, clock {clock.error_ppm(own, period_ns):+.2f} ppm, jumps {own.jumps}",
        f"load    {state.load_percent:.1f} %, overruns {state.faults.overruns}",
        f"frames  received {firmware.frames_received}, sent {firmware.frames_sent}",
    ]


def navigation(firmware: Firmware) -> list[str]:
    """Return position, velocity and attitude."""
    if firmware.mode not in _NAVIGATION:
        return [f"not navigating: {firmware.mode.name}"]
    output = firmware.ram[0].navigation
    east, north, up = (float(v) for v in output.velocity_n)
    return [
        f"latitude   {math.degrees(output.latitude):+15.9f} deg",
        f"longitude  {math.degrees(output.longitude):+15.9f} deg",
        f"height     {output.height:+15.4f} m above the ellipsoid",
        f"velocity   {east:+.5f} east, {north:+.5f} north, {up:+.5f} up, m/s",
        f"roll       {math.degrees(output.roll):+15.5f} deg",
        f"pitch      {math.degrees(output.pitch):+15.5f} deg",
        f"heading    {math.degrees(output.heading):15.5f} deg",
    ]


def sensors(firmware: Firmware) -> list[str]:
    """Return each sensor's mean rate over the last epoch, and whether the fusion uses it."""
    state = firmware.ram[0]
    assembly = state.assembly
    per_s = 1e9 / firmware.period_ns
    lines = ["group  frame    gyro, deg/s        accelerometer, m/s2"]
    groups = max(int(state.gyros.count), int(state.accelerometers.count))
    for group in range(groups):
        came = "came" if assembly.received >> group & 1 else "missing"
        gyro = math.degrees(assembly.gyro_dtheta[group]) * per_s
        accelerometer = assembly.accelerometer_dv[group] * per_s
        gyro_is = "" if assembly.gyro_valid >> group & 1 else " unused"
        accelerometer_is = "" if assembly.accelerometer_valid >> group & 1 else " unused"
        lines.append(
            f"{group + 1:5d}  {came:<7}  {f'{gyro:+.6f}{gyro_is}':<18} "
            f"{accelerometer:+.6f}{accelerometer_is}"
        )
    rate = " ".join(f"{math.degrees(v) * per_s:+.6f}" for v in state.dtheta_s)
    force = " ".join(f"{v * per_s:+.6f}" for v in state.dv_s)
    return [*lines, f"fused  x y z    {rate}, deg/s", f"       x y z    {force}, m/s2"]


def axes(firmware: Firmware) -> list[str]:
    """Return the state and the command of each axis."""
    state = firmware.ram[0]
    assembly, running, parameters = state.assembly, state.sequencer, state.parameters
    lines = ["axis   angle, deg   rate, deg/s  state     command   target, expected, deg"]
    for name, axis in _AXES:
        angle, rate = assembly.encoder_angle_deg[axis], assembly.encoder_rate_dps[axis]
        is_state = _name_of(AxisState, int(assembly.axis_state[axis]))
        command = _name_of(AxisCommand, int(running.command[axis]))
        goal = ""
        if running.running:
            expected = expected_angle_deg(running, parameters, axis)
            goal = f"{commanded_angle_deg(running, axis):+.3f}, {expected:+.3f}"
        lines.append(f"{name}  {angle:+11.5f}  {rate:+11.5f}  {is_state:<8}  {command:<8}  {goal}")
    lost = [f"the {name} axis did not follow" for name, axis in _AXES if _lags(firmware, axis)]
    return lines + lost


def _lags(firmware: Firmware, axis: int) -> bool:
    return bool(firmware.ram[0].sequencer.not_following[axis])


def faults(firmware: Firmware) -> list[str]:
    """Return the fault and the fault counters."""
    state = firmware.ram[0]
    counters = state.faults
    names = counters.dtype.names or ()
    return [
        f"{'fault':<20} {FirmwareFault(int(state.modes.fault)).name}",
        *(f"{name:<20} {int(counters[name])}" for name in names),
    ]


def calibration(firmware: Firmware) -> list[str]:
    """Return when the sensors were calibrated, how warm they were, and whether that holds."""
    own = firmware.ram[0].calibration
    date_s = int(own.date_utc_s)
    date = datetime.datetime.fromtimestamp(date_s, datetime.UTC)
    made = f"{date:%Y-%m-%d %H:%M} UTC" if date_s else "not known"
    warm = f"{own.temperature_c:.1f} deg C" if own.temperature_known else "not known"
    lines = [f"calibrated   {made}", f"temperature  {warm}"]
    for name, kind in (("gyros", own.gyros), ("accelerometers", own.accelerometers)):
        found = DriftState(int(kind.state))
        words = found.name.lower().replace("_", " ")
        if found in (DriftState.KEPT, DriftState.DRIFTED):
            told = "".join(axis for k, axis in enumerate("xyz") if kind.told >> k & 1)
            words += f", {kind.distance:.1f} sigma of {kind.limit:.1f}, seen along {told}"
        if found == DriftState.DRIFTED:
            words += f", {kind.change / PPM:.1f} ppm"
        lines.append(f"{name:<14} {words}")
    return lines


def redundancy(firmware: Firmware) -> list[str]:
    """Return how well the sensors agree, which are left out, and the test of one."""
    state = firmware.ram[0].redundancy
    if not state.enabled:
        return ["redundant sensors are not compared"]
    lines = ["                parity/threshold  suspect  left out  redundancy left"]
    for name, kind in (("gyros", state.gyros), ("accelerometers", state.accelerometers)):
        suspect = str(kind.suspect + 1) if kind.redundant and kind.suspect >= 0 else "-"
        numbers = [str(k + 1) for k in range(SENSOR_GROUPS) if kind.excluded >> k & 1]
        left_out = ",".join(numbers) or "none"
        ratio = f"{kind.ratio:.2f}{' ALARM' if kind.alarm else ''}" if kind.redundant else "-"
        left = "yes" if kind.redundancy_left else "no"
        lines.append(f"{name:<14}  {ratio:<16}  {suspect:<7}  {left_out:<8}  {left}")
    test = state.readmission
    if test.sensor > 0:
        which = f"{SensorKind(int(test.kind)).name.lower()} {test.sensor}"
        outcome = ReadmissionState(int(test.state)).name
        if test.refusal:
            outcome += f": {Refusal(int(test.refusal)).name}"
        seconds = f"{test.passed_s} of {test.wanted_s} s"
        lines.append(f"readmit {which}: {outcome}, {seconds}, parity/threshold {test.ratio:.2f}")
    return lines
