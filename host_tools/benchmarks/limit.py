"""The least that an epoch costs: the fast path's physics in one loop, written by hand.

A table that turns about its inner axis, a vehicle at rest, eight noisy sensors, fusion, strapdown
navigation and its output: in local variables, without records, frames, modes, faults or checks. It
begins from a `FastRun` in mid-turn and gives what that gives, but for rounding, and so is the
measure of what everything around the physics costs.
"""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats, Records
from rrins.dbc.contract import load_contract
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.records.memory import INNER, OUTER
from rrins.host_tools.hardware.memory import Plant, Sensors
from rrins.host_tools.hardware.noise import normal
from rrins.host_tools.runs.fast import FastRun

_HALF_NODE = 0.5 / math.sqrt(3.0)
"""Half the distance of the two nodes of Gauss-Legendre integration in an epoch."""

COLUMNS = ("latitude", "longitude", "velocity_e", "velocity_n", "roll", "pitch", "heading")
"""Output of an epoch: rad and m/s."""


@compiled
def _fused(
    sensors: Sensors, errors: Floats, gain: Floats, unit: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return what the sensors of a kind make of a vector; a row of errors for each."""
    fused_x, fused_y, fused_z = 0.0, 0.0, 0.0
    for k in range(errors.shape[0]):
        along = errors[k, 0] * x + errors[k, 1] * y + errors[k, 2] * z
        scale = errors[k, 3] + math.copysign(errors[k, 4], along)
        analog = scale * along + errors[k, 5] + errors[k, 6] * normal(sensors, k)
        wanted = errors[k, 7] + analog / unit
        count = np.rint(wanted)
        errors[k, 7] = wanted - count
        measured = count * unit
        fused_x += gain[0, k] * measured
        fused_y += gain[1, k] * measured
        fused_z += gain[2, k] * measured
    return fused_x, fused_y, fused_z


@compiled
def run_limit(
    plants: Records[Plant],
    gyros: Floats,
    gyro_gain: Floats,
    gyro_unit: float,
    accelerometers: Floats,
    accelerometer_gain: Floats,
    accelerometer_unit: float,
    s: Floats,
    out: Floats,
) -> None:
    """Run as many epochs as `out` has rows, `COLUMNS` each; `s` is the state, see `Limit`."""
    plant = plants[0]
    latitude, longitude, height = s[0], s[1], s[2]
    v_e, v_n, change_e, change_n = s[3], s[4], s[5], s[6]
    w, x, y, z = s[7], s[8], s[9], s[10]
    ox, oy, oz, px, py, pz = s[11], s[12], s[13], s[14], s[15], s[16]
    inner, rate, step, offset, dt = s[17], s[18], s[19], s[20], s[21]
    co, so = math.cos(s[22]), math.sin(s[22])
    ux, uy, uz = s[23], s[24] * co + s[25] * so, s[25] * co - s[24] * so
    fx, fy, fz = s[26], s[27] * co + s[28] * so, s[28] * co - s[27] * so
    turn = rate * dt
    for row in range(out.shape[0]):
        # What the sensors feel: two nodes, at which the table has turned so far.
        one, two = inner + (0.5 - _HALF_NODE) * turn, inner + (0.5 + _HALF_NODE) * turn
        ci = 0.5 * dt * (math.cos(one) + math.cos(two))
        si = 0.5 * dt * (math.sin(one) + math.sin(two))
        inner += turn
        ax, ay, az = _fused(
            plant.gyros,
            gyros,
            gyro_gain,
            gyro_unit,
            ci * ux + si * uy,
            ci * uy - si * ux,
            dt * uz + turn,
        )
        bx, by, bz = _fused(
            plant.accelerometers,
            accelerometers,
            accelerometer_gain,
            accelerometer_unit,
            ci * fx + si * fy,
            ci * fy - si * fx,
            dt * fz,
        )
        # Attitude as a matrix, rates of the Earth and of the way over it, gravity.
        c00, c01, c02 = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
        c10, c11, c12 = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
        sine, cosine = math.sin(latitude), math.cos(latitude)
        square = sine * sine
        root = 1.0 - earth.ECCENTRICITY_SQUARED * square
        prime_vertical = earth.SEMI_MAJOR_AXIS / math.sqrt(root)
        meridian = prime_vertical * (1.0 - earth.ECCENTRICITY_SQUARED) / root
        middle_e, middle_n = v_e + 0.5 * change_e, v_n + 0.5 * change_n
        over_n, over_e = 1.0 / (meridian + height), 1.0 / (prime_vertical + height)
        ie_n, ie_u = earth.RATE * cosine, earth.RATE * sine
        en_e, en_n = -middle_n * over_n, middle_e * over_e
        en_u = en_n * sine / cosine
        ze, zn, zu = en_e * dt, (ie_n + en_n) * dt, (ie_u + en_u) * dt
        # Velocity: rotation and sculling, Coriolis; the vertical channel is held.
        hx, hy, hz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        dx = bx + 0.5 * hx + (ay * hz - az * hy) / 6.0
        dy = by + 0.5 * hy + (az * hx - ax * hz) / 6.0
        dz = bz + 0.5 * hz + (ax * hy - ay * hx) / 6.0
        dx += (oy * bz - oz * by + py * az - pz * ay) / 12.0
        dy += (oz * bx - ox * bz + pz * ax - px * az) / 12.0
        dz += (ox * by - oy * bx + px * ay - py * ax) / 12.0
        force_e, force_n = c00 * dx + c01 * dy + c02 * dz, c10 * dx + c11 * dy + c12 * dz
        c20, c21, c22 = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
        force_u = c20 * dx + c21 * dy + c22 * dz
        turned_u = 2.0 * ie_u + en_u
        change_e = force_e - 0.5 * (zn * force_u - zu * force_n) + turned_u * middle_n * dt
        change_n = force_n - 0.5 * (zu * force_e - ze * force_u) - turned_u * middle_e * dt
        # Position.
        dlatitude = 0.5 * dt * (2.0 * v_n + change_n) * over_n
        cosine -= 0.5 * sine * dlatitude
        longitude += 0.5 * dt * (2.0 * v_e + change_e) * over_e / cosine
        latitude += dlatitude
        v_e, v_n = v_e + change_e, v_n + change_n
        # Attitude: coning; the sensors' turn and that of the navigation frame.
        qx = 0.5 * (ax + (oy * az - oz * ay) / 12.0)
        qy = 0.5 * (ay + (oz * ax - ox * az) / 12.0)
        qz = 0.5 * (az + (ox * ay - oy * ax) / 12.0)
        square = qx * qx + qy * qy + qz * qz
        qw, share = 1.0 - 0.5 * square, 1.0 - square / 6.0
        qx, qy, qz = share * qx, share * qy, share * qz
        rw, rx = w * qw - x * qx - y * qy - z * qz, w * qx + x * qw + y * qz - z * qy
        ry, rz = w * qy - x * qz + y * qw + z * qx, w * qz + x * qy - y * qx + z * qw
        ze, zn, zu = -0.5 * ze, -0.5 * zn, -0.5 * zu
        w, x = rw - ze * rx - zn * ry - zu * rz, rx + ze * rw + zn * rz - zu * ry
        y, z = ry + zn * rw + zu * rx - ze * rz, rz + zu * rw + ze * ry - zn * rx
        norm = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
        w, x, y, z = norm * w, norm * x, norm * y, norm * z
        ox, oy, oz, px, py, pz = ax, ay, az, bx, by, bz
        # Output: the body's attitude through the encoders.
        angle = step * np.rint((inner + offset) / step)
        ci, si = math.cos(angle), math.sin(angle)
        c00, c01, c02 = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
        c10, c11, c12 = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
        c20, c21, c22 = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
        along_e = co * (c00 * si + c01 * ci) - so * c02
        along_n = co * (c10 * si + c11 * ci) - so * c12
        along_u = co * (c20 * si + c21 * ci) - so * c22
        up = so * (c20 * si + c21 * ci) + co * c22
        out[row, 0], out[row, 1] = latitude, longitude
        out[row, 2], out[row, 3] = v_e, v_n
        out[row, 4] = math.atan2(c21 * si - c20 * ci, up)
        out[row, 5] = math.asin(along_u)
        out[row, 6] = math.atan2(along_e, along_n)
    s[0], s[1], s[3], s[4], s[5], s[6] = latitude, longitude, v_e, v_n, change_e, change_n
    s[7], s[8], s[9], s[10], s[17] = w, x, y, z, inner
    s[11], s[12], s[13], s[14], s[15], s[16] = ox, oy, oz, px, py, pz


class Limit:
    """The loop, from where a fast run is: the inner axis turns evenly, the outer one rests."""

    def __init__(self, run: FastRun) -> None:
        state, self._plant = run.ram[0], run.plant.copy()
        plant = self._plant[0]
        ins, inner = state.ins, plant.axis[INNER]
        contract = load_contract()[0]
        self._sensors = (
            _errors(plant.gyros),
            np.ascontiguousarray(state.gyros.gain[:, : plant.gyros.count]),
            float(contract.sensor[0].gyro_dtheta.scale),
            _errors(plant.accelerometers),
            np.ascontiguousarray(state.accelerometers.gain[:, : plant.accelerometers.count]),
            float(contract.sensor[0].accelerometer_dv.scale),
        )
        self._state = np.array(
            [
                *(ins.latitude, ins.longitude, ins.height),
                *(*ins.velocity_n[:2], *ins.velocity_change_n[:2], *ins.q_s_n),
                *(*ins.dtheta_s_previous, *ins.dv_s_previous),
                *(inner.angle, inner.rate, math.radians(inner.encoder_step_deg)),
                math.radians(inner.encoder_offset_deg + inner.encoder_error_deg),
                *(plant.period_ns * 1e-9, plant.axis[OUTER].angle),
                *(*plant.omega_ib_b, *plant.specific_force_b),
            ]
        )

    def run(self, epochs: int) -> Floats:
        """Go on by some epochs; return the navigation after each, shape (epochs, 7)."""
        out = np.empty((epochs, len(COLUMNS)))
        run_limit(self._plant, *self._sensors, self._state, out)
        return out


def _errors(sensors: Sensors) -> Floats:
    """Return axis, 1 + λ, μ, bias, noise and remainder of each sensor, shape (m, 8)."""
    own = slice(0, int(sensors.count))
    columns = (
        1.0 + sensors.scale_error[own],
        sensors.asymmetric_scale_error[own],
        sensors.bias_increment[own],
        sensors.noise_increment[own],
        sensors.remainder[own],
    )
    return np.column_stack((sensors.axis[own], *columns))
