"""Size effect: accelerometers away from the reference point feel the rotation of their block.

An accelerometer at r, fixed in the sensor frame s, is accelerated against the reference point by

    a = ω' x r + ω x (ω x r),

ω the rate of s against inertial space: the vehicle's and the table's turning together. Groves,
*Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems* (2nd ed., 2013), on
lever arms; Savage, *Strapdown Analytics* (2000), chapter 8, "size effect". Over an epoch

    ∫ a dt = Δω x r + (M - tr(M) I) r,      M = ∫ ω ωᵀ dt,

with Δω from the rates at the ends of two epochs, so that a rate that jumps is felt as a blow.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.host_tools.hardware.memory import Plant


@compiled
def begin(plant: Plant) -> None:
    """Begin an epoch."""
    for i in range(3):
        for j in range(3):
            plant.omega_square_s[i, j] = 0.0


@compiled
def add(plant: Plant, x: float, y: float, z: float, dt: float) -> None:
    """Add a part of the epoch, `dt` long, at the rate (x, y, z), rad/s."""
    M = plant.omega_square_s
    M[0, 0] += dt * x * x
    M[1, 1] += dt * y * y
    M[2, 2] += dt * z * z
    M[0, 1] += dt * x * y
    M[0, 2] += dt * x * z
    M[1, 2] += dt * y * z
    M[1, 0], M[2, 0], M[2, 1] = M[0, 1], M[0, 2], M[1, 2]


@compiled
def end(plant: Plant, x: float, y: float, z: float) -> None:
    """End the epoch at the rate (x, y, z), rad/s; write the accelerometers' `arm_increment`."""
    omega, M, sensors = plant.omega_is_s, plant.omega_square_s, plant.accelerometers
    dx, dy, dz = x - omega[0], y - omega[1], z - omega[2]
    if plant.epoch == 0:  # there is no epoch before
        dx = dy = dz = 0.0
    omega[0], omega[1], omega[2] = x, y, z
    trace = M[0, 0] + M[1, 1] + M[2, 2]
    for k in range(sensors.count):
        rx, ry, rz = sensors.position_s[k, 0], sensors.position_s[k, 1], sensors.position_s[k, 2]
        ax = dy * rz - dz * ry + M[0, 0] * rx + M[0, 1] * ry + M[0, 2] * rz - trace * rx
        ay = dz * rx - dx * rz + M[1, 0] * rx + M[1, 1] * ry + M[1, 2] * rz - trace * ry
        az = dx * ry - dy * rx + M[2, 0] * rx + M[2, 1] * ry + M[2, 2] * rz - trace * rz
        axis = sensors.axis[k]
        sensors.arm_increment[k] = axis[0] * ax + axis[1] * ay + axis[2] * az


@compiled
def rest(plant: Plant) -> None:
    """Go on for an epoch at the same rate."""
    omega = plant.omega_is_s
    end(plant, omega[0], omega[1], omega[2])
