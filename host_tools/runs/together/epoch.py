"""An epoch of eight runs side by side: sensors, fusion, comparison, strapdown navigation.

What `rrins.host_tools.hardware.sensors` does for one run, and in `rrins.firmware_py.core`
`sensors.fusion`, `redundancy.parity`, `redundancy.standing` and `navigation.strapdown`: without a
branch, for sensors without a fault and far from their range, and with the height held.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.lanes import LANES, Lanes, larger, load, rounded, sign, spread, store, unchanged
from rrins.compiled.record import Floats, Integers
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.records.redundancy_records import ABSOLUTE, OUTER_TURN
from rrins.host_tools.runs.together import rows
from rrins.host_tools.runs.together.rows import KIND, SENSOR, SENSOR_ROWS

Vector = tuple[Lanes, Lanes, Lanes]


@compiled
def _cross(a: Vector, b: Vector) -> Vector:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@compiled
def _along(memory: Floats, row: int, x: Lanes, y: Lanes, z: Lanes) -> Lanes:
    """Return the component along an axis that is in three rows."""
    return load(memory, row) * x + load(memory, row + 1) * y + load(memory, row + 2) * z


@compiled
def _sense(
    memory: Floats, at: int, x: float, y: float, z: float, force: Lanes, noise: Lanes, unit: float
) -> Lanes:
    """Return what the firmware makes of a sensor's counts, rad or m/s."""
    along = _along(memory, at + rows.AXIS, x, y, z)
    scale = load(memory, at + rows.SCALE) + load(memory, at + rows.ASYMMETRIC) * sign(along)
    analog = scale * along + load(memory, at + rows.BIAS)
    analog += load(memory, at + rows.G_SENSITIVITY) * force
    analog += load(memory, at + rows.NOISE) * noise
    wanted = load(memory, at + rows.REMAINDER) + analog / unit
    counts = rounded(wanted)
    store(memory, at + rows.REMAINDER, wanted - counts)
    repeated = unchanged(load(memory, at + rows.REPEATED), counts, load(memory, at + rows.LAST))
    store(memory, at + rows.LAST, counts)
    store(memory, at + rows.REPEATED, repeated)
    store(memory, at + rows.LONGEST, larger(load(memory, at + rows.LONGEST), repeated))
    store(memory, at + rows.HIGHEST, larger(load(memory, at + rows.HIGHEST), abs(counts)))
    off = counts * unit - load(memory, at + rows.OFFSET)
    by_sign = load(memory, at + rows.CORRECTION_BY_SIGN) * sign(off)
    return off * (load(memory, at + rows.CORRECTION) + by_sign)


@compiled
def _fuse(
    memory: Floats,
    kind: int,
    count: int,
    shared: Floats,
    true: int,
    noise: Floats,
    first: int,
    unit: float,
) -> Vector:
    """Return the fused vector of a kind, from the increments in the columns `true` of an epoch."""
    a, b, c = spread(0.0), spread(0.0), spread(0.0)
    x, y, z = shared[true], shared[true + 1], shared[true + 2]
    fx, fy, fz = shared[rows.FORCE], shared[rows.FORCE + 1], shared[rows.FORCE + 2]
    for k in range(count):
        at = KIND[kind] + SENSOR + k * SENSOR_ROWS
        force = _along(memory, at + rows.AXIS, fx, fy, fz)
        measured = _sense(memory, at, x, y, z, force, load(noise, first + k), unit)
        store(memory, at + rows.MEASURED, measured)
        a += load(memory, at + rows.GAIN) * measured
        b += load(memory, at + rows.GAIN + 1) * measured
        c += load(memory, at + rows.GAIN + 2) * measured
    return a, b, c


@compiled
def _add(memory: Floats, row: int, value: Lanes) -> None:
    store(memory, row, load(memory, row) + value)


@compiled
def _compare(
    memory: Floats,
    kind: int,
    count: int,
    own: Vector,
    other: Vector,
    expected: Vector,
    outer_turn: float,
    dt: float,
) -> Lanes:
    """Add an epoch to the sums of its second; return what was not learned of its parity."""
    at = KIND[kind]
    _add(memory, at + rows.VECTOR, own[0])
    _add(memory, at + rows.VECTOR + 1, own[1])
    _add(memory, at + rows.VECTOR + 2, own[2])
    _add(memory, at + rows.UNEXPECTED, own[0] - expected[0])
    _add(memory, at + rows.UNEXPECTED + 1, own[1] - expected[1])
    _add(memory, at + rows.UNEXPECTED + 2, own[2] - expected[2])
    learned = at + rows.LEARNED
    parity = load(memory, learned) * -dt - load(memory, learned + OUTER_TURN) * outer_turn
    parity -= _along(memory, learned + 1, own[0], own[1], own[2])
    parity -= _along(memory, learned + 4, other[0], other[1], other[2])
    for k in range(count):
        sensor = at + SENSOR + k * SENSOR_ROWS
        along = abs(_along(memory, sensor + rows.INPUT, own[0], own[1], own[2]))
        measured = load(memory, sensor + rows.MEASURED)
        _add(memory, sensor + rows.ABSOLUTE_SUM, along)
        _add(memory, sensor + rows.SUM, measured)
        parity -= load(memory, learned + ABSOLUTE + k) * along
        parity += load(memory, at + rows.PARITY + k) * measured
    return parity


@compiled
def _test_levels(memory: Floats, at: int, unlearned: Lanes, phase: int, levels: int) -> int:
    """Test the windows shorter than a second that end here, where they began together.

    Notes what is largest; returns the epochs since all began. See `parity.take`.
    """
    carried, largest, level = unlearned, load(memory, at + rows.RATIO), 0
    phase += 1
    while True:
        total = load(memory, at + rows.LEVEL + level) + carried
        largest = larger(largest, total * total * load(memory, at + rows.ALLOWED + level))
        store(memory, at + rows.LEVEL + level, 0.0)
        carried = total
        level += 1
        if level == levels or phase & ((1 << level) - 1) != 0:
            break
    if level < levels:
        _add(memory, at + rows.LEVEL + level, carried)
    store(memory, at + rows.RATIO, largest)
    return 0 if level == levels else phase


@compiled
def _test_lane(memory: Floats, at: int, lane: int, phase: int, levels: int) -> int:
    """Do what `_test_levels` does for a lane by itself, with its `rows.UNLEARNED`."""
    carried, level = memory[at + rows.UNLEARNED, lane], 0
    phase += 1
    while True:
        total = memory[at + rows.LEVEL + level, lane] + carried
        square = total * total * memory[at + rows.ALLOWED + level, lane]
        memory[at + rows.RATIO, lane] = max(memory[at + rows.RATIO, lane], square)
        memory[at + rows.LEVEL + level, lane] = 0.0
        carried = total
        level += 1
        if level == levels or phase & ((1 << level) - 1) != 0:
            break
    if level < levels:
        memory[at + rows.LEVEL + level, lane] += carried
    return 0 if level == levels else phase


@compiled
def _test(
    memory: Floats, kind: int, unlearned: Lanes, phases: Integers, alike: bool, levels: int
) -> None:
    """Test the windows of a kind that are shorter than a second, and end here."""
    at = KIND[kind]
    if alike:
        phases[:] = _test_levels(memory, at, unlearned, phases[0], levels)
    else:
        store(memory, at + rows.UNLEARNED, unlearned)
        for lane in range(LANES):
            phases[lane] = _test_lane(memory, at, lane, phases[lane], levels)


@compiled
def _parallel(latitude: Lanes, shared: Floats) -> tuple[Lanes, Lanes]:
    """Return sine and cosine of a latitude within 0.05 rad of the reference, to 1e-16."""
    d = latitude - shared[rows.REFERENCE]
    square = d * d
    sine = d * (1.0 - square * (1.0 / 6.0 - square * (1.0 / 120.0 - square / 5040.0)))
    cosine = 1.0 - square * (0.5 - square * (1.0 / 24.0 - square * (1.0 / 720.0)))
    cosine += square * square * square * square * (1.0 / 40320.0)
    middle_sine, middle_cosine = shared[rows.SINE], shared[rows.COSINE]
    return (
        middle_sine * cosine + middle_cosine * sine,
        middle_cosine * cosine - middle_sine * sine,
    )


@compiled
def _matrix(memory: Floats) -> tuple[Vector, Vector, Vector]:
    """Return the rows of C_s_n."""
    w, x = load(memory, rows.ATTITUDE), load(memory, rows.ATTITUDE + 1)
    y, z = load(memory, rows.ATTITUDE + 2), load(memory, rows.ATTITUDE + 3)
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


@compiled
def _expect(
    north: Vector,
    up: Vector,
    parallel: tuple[Lanes, Lanes],
    gravity: Lanes,
    shared: Floats,
    dt: float,
) -> tuple[Vector, Vector]:
    """Return the increments that sensors have if the vehicle stands; `standing.expect`."""
    to_north, to_up = parallel[1] * (earth.RATE * dt), parallel[0] * (earth.RATE * dt)
    dtheta = (
        north[0] * to_north + up[0] * to_up + shared[rows.TABLE_TURN],
        north[1] * to_north + up[1] * to_up + shared[rows.TABLE_TURN + 1],
        north[2] * to_north + up[2] * to_up + shared[rows.TABLE_TURN + 2],
    )
    step = gravity * dt
    force = up[0] * step, up[1] * step, up[2] * step
    turned = _cross(dtheta, force)
    return dtheta, (
        force[0] - 0.5 * turned[0],
        force[1] - 0.5 * turned[1],
        force[2] - 0.5 * turned[2],
    )


@compiled
def _dot(a: Vector, b: Vector) -> Lanes:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def _turn_by(memory: Floats, phi: Vector, zeta: Vector) -> None:
    """Turn the attitude by the rotation vectors of the sensors and of the navigation frame."""
    w, x = load(memory, rows.ATTITUDE), load(memory, rows.ATTITUDE + 1)
    y, z = load(memory, rows.ATTITUDE + 2), load(memory, rows.ATTITUDE + 3)
    q = 0.25 * _dot(phi, phi)
    qw = 1.0 - q * (0.5 - q * (1.0 / 24.0 - q * (1.0 / 720.0 - q * (1.0 / 40320.0))))
    share = 0.5 - q * (1.0 / 12.0 - q * (1.0 / 240.0 - q * (1.0 / 10080.0)))
    qx, qy, qz = share * phi[0], share * phi[1], share * phi[2]
    rw, rx = w * qw - x * qx - y * qy - z * qz, w * qx + x * qw + y * qz - z * qy
    ry, rz = w * qy - x * qz + y * qw + z * qx, w * qz + x * qy - y * qx + z * qw
    q = 0.25 * _dot(zeta, zeta)
    qw, share = 1.0 - 0.5 * q, -0.5 * (1.0 - q * (1.0 / 6.0))
    qx, qy, qz = share * zeta[0], share * zeta[1], share * zeta[2]
    w, x = qw * rw - qx * rx - qy * ry - qz * rz, qw * rx + qx * rw + qy * rz - qz * ry
    y, z = qw * ry - qx * rz + qy * rw + qz * rx, qw * rz + qx * ry - qy * rx + qz * rw
    norm = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    store(memory, rows.ATTITUDE, norm * w)
    store(memory, rows.ATTITUDE + 1, norm * x)
    store(memory, rows.ATTITUDE + 2, norm * y)
    store(memory, rows.ATTITUDE + 3, norm * z)


@compiled
def _start_frame(memory: Floats, dtheta: Vector, dv: Vector) -> tuple[Vector, Vector]:
    """Return velocity change in the sensor frame at the epoch's start, and rotation vector.

    With rotation, sculling and coning corrections, see `strapdown.velocity_in_start_frame`.
    """
    before, dv_before = rows.DTHETA, rows.DV
    old = load(memory, before), load(memory, before + 1), load(memory, before + 2)
    old_dv = load(memory, dv_before), load(memory, dv_before + 1), load(memory, dv_before + 2)
    once = _cross(dtheta, dv)
    twice = _cross(dtheta, once)
    scull, other, cone = _cross(old, dv), _cross(old_dv, dtheta), _cross(old, dtheta)
    sixth, twelfth = 1.0 / 6.0, 1.0 / 12.0
    change = (
        dv[0] + 0.5 * once[0] + sixth * twice[0] + twelfth * (scull[0] + other[0]),
        dv[1] + 0.5 * once[1] + sixth * twice[1] + twelfth * (scull[1] + other[1]),
        dv[2] + 0.5 * once[2] + sixth * twice[2] + twelfth * (scull[2] + other[2]),
    )
    phi = (
        dtheta[0] + twelfth * cone[0],
        dtheta[1] + twelfth * cone[1],
        dtheta[2] + twelfth * cone[2],
    )
    store(memory, before, dtheta[0])
    store(memory, before + 1, dtheta[1])
    store(memory, before + 2, dtheta[2])
    store(memory, dv_before, dv[0])
    store(memory, dv_before + 1, dv[1])
    store(memory, dv_before + 2, dv[2])
    return change, phi


@compiled
def _navigate(
    memory: Floats,
    C_s_n: tuple[Vector, Vector, Vector],
    parallel: tuple[Lanes, Lanes],
    dtheta: Vector,
    dv: Vector,
    dt: float,
) -> None:
    """Navigate over one epoch, with the height held; `strapdown.update`."""
    sine, cosine = parallel
    height = load(memory, rows.HEIGHT)
    v_e, v_n = load(memory, rows.VELOCITY), load(memory, rows.VELOCITY + 1)
    change_e, change_n = load(memory, rows.CHANGE), load(memory, rows.CHANGE + 1)
    meridian, prime_vertical = earth.radii_at(sine)
    over_n, over_e = 1.0 / (meridian + height), 1.0 / (prime_vertical + height)
    middle_e, middle_n = v_e + 0.5 * change_e, v_n + 0.5 * change_n
    ie_n, ie_u = earth.RATE * cosine, earth.RATE * sine
    over_cosine = 1.0 / cosine
    en_e, en_n = -middle_n * over_n, middle_e * over_e
    en_u = en_n * sine * over_cosine
    zeta = en_e * dt, (ie_n + en_n) * dt, (ie_u + en_u) * dt
    change, phi = _start_frame(memory, dtheta, dv)
    force = _dot(C_s_n[0], change), _dot(C_s_n[1], change), _dot(C_s_n[2], change)
    turned = _cross(zeta, force)
    up = (2.0 * ie_u + en_u) * dt
    change_e = force[0] - 0.5 * turned[0] + up * middle_n
    change_n = force[1] - 0.5 * turned[1] - up * middle_e
    dlatitude = 0.5 * dt * (2.0 * v_n + change_n) * over_n
    dlongitude = 0.5 * dt * (2.0 * v_e + change_e) * over_e / (cosine - 0.5 * sine * dlatitude)
    _add(memory, rows.DLATITUDE, dlatitude)
    _add(memory, rows.DLONGITUDE, dlongitude)
    store(memory, rows.BEFORE, v_e)
    store(memory, rows.BEFORE + 1, v_n)
    store(memory, rows.VELOCITY, v_e + change_e)
    store(memory, rows.VELOCITY + 1, v_n + change_n)
    store(memory, rows.CHANGE, change_e)
    store(memory, rows.CHANGE + 1, change_n)
    _turn_by(memory, phi, zeta)


@compiled
def run_epoch(
    memory: Floats,
    shared: Floats,
    noise: Floats,
    counts: tuple[int, int],
    units: tuple[float, float],
    dt: float,
    compares: bool,
    phases: Integers,
    alike: Integers,
    levels: int,
) -> None:
    """Run an epoch of eight runs.

    Parameters
    ----------
    memory : array, shape (`rows.ROWS`, `LANES`)
    shared : array, shape (`rows.COLUMNS`,)
        What holds for all runs in this epoch.
    noise : array, shape (n, `LANES`)
        Standard normal numbers, for the gyros and then the accelerometers.
    counts, units : tuple
        Sensors of each kind; increment of a count, rad and m/s.
    dt : float
        s.
    compares : bool
        Whether sensors are compared.
    phases : array of int, shape (2, `LANES`)
        Of each kind, epochs since its windows began.
    alike : array of int, shape (2,)
        Of each kind, whether they did so together.
    levels : int
        Of windows shorter than a second.
    """
    true, feels = rows.TRUE_DTHETA, rows.TRUE_DV
    dtheta = _fuse(memory, 0, counts[0], shared, true, noise, 0, units[0])
    dv = _fuse(memory, 1, counts[1], shared, feels, noise, counts[0], units[1])
    C_s_n = _matrix(memory)
    parallel = _parallel(load(memory, rows.LATITUDE) + load(memory, rows.DLATITUDE), shared)
    if compares:
        gravity = earth.gravity_at(parallel[0], load(memory, rows.HEIGHT))
        turn, force = _expect(C_s_n[1], C_s_n[2], parallel, gravity, shared, dt)
        outer_turn = shared[rows.OUTER_TURN]
        left = _compare(memory, 0, counts[0], dtheta, dv, turn, outer_turn, dt)
        _test(memory, 0, left, phases[0], alike[0] != 0, levels)
        left = _compare(memory, 1, counts[1], dv, dtheta, force, outer_turn, dt)
        _test(memory, 1, left, phases[1], alike[1] != 0, levels)
    _navigate(memory, C_s_n, parallel, dtheta, dv, dt)
