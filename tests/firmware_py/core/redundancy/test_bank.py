"""The bank of filters, on blocks made by hand: whose fault explains a velocity."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.aiding import wheel
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.records.memory import blank_ram
from rrins.firmware_py.core.redundancy import alike, bank, blocks
from rrins.firmware_py.core.sensors.calibration import DPH, UG, input_axes

RATE_HZ, SECONDS, BEGINS_S = 100, 160, 60
SIGMA = 0.05
LATITUDE = math.radians(40)
TETRAHEDRON_DEG = ((180.0, 0.0), *((np.degrees(np.arccos(1 / 3)), 120.0 * k) for k in range(3)))
H = input_axes(TETRAHEDRON_DEG)
GAIN = np.linalg.pinv(H)
PROJECTOR = np.eye(4) - H @ GAIN


def level_ram():
    """Return a RAM image of a level RIMU that moves, before its history is filled."""
    ram = blank_ram()
    state = ram[0]
    state.parameters.period_ns = 1_000_000_000 // RATE_HZ
    state.parameters.height_channel = strapdown.HEIGHT_DAMPED
    state.ins.latitude = LATITUDE
    redundancy = state.redundancy
    redundancy.second_epochs = RATE_HZ
    for kind, fusion, noise, bias in (
        ("gyros", state.gyros, 0.3 * DPH, 0.05 * DPH),
        ("accelerometers", state.accelerometers, 10 * UG, 50 * UG),
    ):
        fusion.count = 4
        parity = redundancy[kind]
        parity.kind = kind == "accelerometers"
        parity.sensors = 0b1111
        parity.redundant = True
        parity.second_variance[:4] = noise**2 / 4
        parity.vector_variance = noise**2
        parity.bias_variance = bias**2
        parity.leave_out[:4] = -(GAIN / np.diag(PROJECTOR)).T
    return ram


def residuals(kind, sensor, value):
    """Return by how much a fault moves each sensor's residual in a second."""
    return PROJECTOR[:, sensor] * value


def history(kind, sensor, value, seed=1, reference_of=None):
    """Return a RAM image whose history has a fault, and the velocity that shows it.

    `reference_of` is the sensor that the velocity blames, by default the one that fails; 4 is none.
    """
    ram = level_ram()
    state = ram[0]
    repair = state.redundancy.repair
    blocks.begin(repair, 4, 4, 0)
    others = int(repair.stride) - blocks.OTHERS
    g = earth.gravity(LATITUDE, 0.0)
    rng = np.random.default_rng(seed)
    blamed = sensor if reference_of is None else reference_of
    psi, velocity = np.zeros(3), np.zeros(2)
    place = 0 if kind == "gyros" else 12
    for second in range(SECONDS):
        wrong = value if second >= BEGINS_S else 0.0
        residual = residuals(kind, sensor, wrong)
        changes = -(GAIN / np.diag(PROJECTOR)).T * residual[:, None]
        repair.block[place : place + 12] = changes.ravel()
        true = -GAIN[:, blamed] * wrong if blamed < 4 else np.zeros(3)
        if kind == "gyros":
            mean = psi + true / 2
            psi = psi + true
            velocity = velocity + np.array([mean[1], -mean[0]]) * g
        else:
            velocity = velocity + true[:2]
        block = repair.block
        block[others + blocks.FORCE + 2] = g
        block[others + blocks.TIME] = 1.0
        block[others + blocks.ATTITUDE : others + blocks.ATTITUDE + 9 : 4] = 1.0
        block[others + blocks.MEASURED_AFTER] = 1.0
        block[others + blocks.MEASURED : others + blocks.MEASURED + 2] = (
            velocity + SIGMA * rng.standard_normal(2)
        )
        block[others + blocks.VARIANCE] = SIGMA**2
        blocks.close(repair, (second + 1) * RATE_HZ)
    return ram


def decide(ram, kind):
    """Run the bank over the history, second by second from that of the fault on.

    Returns the sensor found, and after how many blocks.
    """
    state = ram[0]
    redundancy, of_kind = state.redundancy, int(kind == "accelerometers")
    redundancy[kind].alarm = True
    redundancy[kind].alarm_epoch = 1
    redundancy.bank.sensors[:] = 0b1111
    for second in range(BEGINS_S, SECONDS + 1):
        redundancy.repair.count = second
        for epoch in range(RATE_HZ):
            state.epoch = second * RATE_HZ + epoch
            bank.follow(state)
            if redundancy.bank.found > 0:
                return bank.found(redundancy.bank, of_kind), int(redundancy.bank.at)
    return bank.found(redundancy.bank, of_kind), int(redundancy.bank.at)


FAULTS = [("gyros", 10 * DPH), ("accelerometers", 5000 * UG)]


@pytest.mark.parametrize("sensor", range(1, 4))
@pytest.mark.parametrize(("kind", "value"), FAULTS)
def test_the_sensor_that_the_velocity_blames_is_found(kind, value, sensor):
    found, at = decide(history(kind, sensor, value), kind)
    assert found == sensor
    assert BEGINS_S < at < BEGINS_S + 40


@pytest.mark.parametrize(("kind", "value"), FAULTS)
def test_a_velocity_without_any_error_blames_no_sensor(kind, value):
    """It may be the vertical one, which does not show, or all alike, which change nothing."""
    assert decide(history(kind, 1, value, reference_of=4), kind) == (-1, SECONDS)


def test_a_fault_of_all_alike_is_taken_off_by_what_the_parity_says_of_its_size():
    rng = np.random.default_rng(5)
    for _ in range(20):
        axes = rng.standard_normal((4, 3))
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        gain = np.linalg.pinv(axes)
        projector = np.eye(4) - axes @ gain
        parity = level_ram()[0].redundancy.gyros
        parity.projector[:4, :4] = projector
        parity.leave_out[:4] = -(gain / np.diag(projector)).T
        weights, direction = np.zeros(16), np.zeros(3)
        assert alike.weigh(parity, weights)
        residual = projector @ np.ones(4)
        taken_off = (weights[:4] * residual) @ parity.leave_out[:4]
        assert taken_off == pytest.approx(-gain @ np.ones(4))
        shown = alike.direct(parity, alike.ALIKE, weights, direction)
        assert direction * residual[shown] == pytest.approx(taken_off)
    parity.projector[:4, :4] = np.outer([1, -1, 1, -1], [1, -1, 1, -1]) / 4
    assert not alike.weigh(parity, weights)  # it does not show


@pytest.mark.parametrize(("kind", "value"), FAULTS)
def test_two_at_once_are_not_taken_for_one_of_the_others(kind, value):
    """Both of the same size look most like a third sensor for a while."""
    for first, second, share in ((1, 2, 1.0), (1, 3, 0.6), (0, 2, 1.0), (2, 3, -0.5)):
        one = history(kind, first, value)
        other = history(kind, second, share * value, seed=2)
        repair, added = one[0].redundancy.repair, other[0].redundancy.repair
        stride = int(repair.stride)
        rows = repair.blocks[: SECONDS * stride].reshape(SECONDS, stride)
        more = added.blocks[: SECONDS * stride].reshape(SECONDS, stride)
        rows[:, :24] += more[:, :24]
        place = stride - blocks.OTHERS + blocks.MEASURED
        rows[:, place : place + 2] += more[:, place : place + 2]
        assert decide(one, kind)[0] in (-1, first, second)


@pytest.mark.parametrize(("kind", "value"), FAULTS)
def test_without_a_reference_nothing_is_found(kind, value):
    ram = history(kind, 1, value)
    repair = ram[0].redundancy.repair
    stride = int(repair.stride)
    repair.blocks[stride - blocks.OTHERS + blocks.VARIANCE :: stride] = 0.0
    found, at = decide(ram, kind)
    assert (found, at) == (-1, SECONDS - 3)  # the last blocks wait for theirs


def test_a_velocity_that_no_sensor_explains_decides_nothing():
    ram = history("gyros", 1, 10 * DPH)
    repair = ram[0].redundancy.repair
    stride = int(repair.stride)
    place = stride - blocks.OTHERS + blocks.MEASURED
    jumps = np.random.default_rng(5).standard_normal((SECONDS, 2))
    for second in range(SECONDS):
        at = second * stride + place
        repair.blocks[at : at + 2] += jumps[second]
    assert decide(ram, "gyros") == (-1, SECONDS)


SPEED, TURN_DPS = 15.0, 6.0
"""Of a car that speeds up and brakes by a third, and turns to and fro."""

SCALE, YAW, HEADING = 0.01, math.radians(-1.0), math.radians(70.0)


def odometer_history(kind, sensor, value, seed=1, slips=(), outside=()):
    """Return a history as `history` does, of a car whose odometer shows the fault.

    In the seconds of `slips` its wheel slips; in those `outside` no count came.
    """
    ram = history(kind, sensor, value, seed, reference_of=sensor)
    state = ram[0]
    state.odometer.interval_epochs = 10
    repair = state.redundancy.repair
    stride, rng = int(repair.stride), np.random.default_rng(seed + 100)
    heading = HEADING
    for second in range(SECONDS):
        block = repair.blocks[second * stride : (second + 1) * stride][stride - blocks.OTHERS :]
        error_n = np.append(block[blocks.MEASURED : blocks.MEASURED + 2], 0.0)
        block[blocks.VARIANCE] = 0.0
        if second in outside:
            continue
        speed = SPEED * (1.0 + math.sin(second / 7.0) / 3.0)
        turned = math.radians(TURN_DPS) * math.sin(second / 11.0)
        heading += turned
        forward_n = np.array([math.sin(heading), math.cos(heading), 0.0])
        right_n = np.array([math.cos(heading), -math.sin(heading), 0.0])
        track_n = forward_n * math.cos(YAW) + right_n * math.sin(YAW)
        navigated_n = speed * track_n - error_n
        C_b_n = np.column_stack([right_n, forward_n, [0.0, 0.0, 1.0]])
        way_b = C_b_n.T @ navigated_n
        travelled = speed / (1.0 + SCALE) + 0.02 * rng.standard_normal()
        if second in slips:
            travelled *= 1.3
        slip = wheel.slip_sigma.py_func(travelled, way_b, turned, 1.0)
        block[blocks.STRETCH_AFTER] = 1.0
        block[blocks.STRETCH_S] = 1.0
        block[blocks.TRAVELLED] = travelled
        block[blocks.STRETCH_WAY : blocks.STRETCH_WAY + 3] = way_b
        block[blocks.STRETCH_ATTITUDE : blocks.STRETCH_ATTITUDE + 9] = C_b_n.ravel()
        block[blocks.DISTANCE_VARIANCE] = 0.02**2 + SIGMA**2  # that of the history, too
        block[blocks.SLIP_VARIANCE] = slip**2 + SIGMA**2
    return ram


LARGE_FAULTS = [("gyros", 50 * DPH), ("accelerometers", 5000 * UG)]


@pytest.mark.parametrize("slips", [(), range(58, 63)], ids=["rolls", "slips"])
@pytest.mark.parametrize("sensor", range(1, 4))
@pytest.mark.parametrize(("kind", "value"), LARGE_FAULTS)
def test_the_sensor_that_the_odometer_blames_is_found(kind, value, sensor, slips):
    """By a wheel of unknown scale and mounting, also where it slips as the fault begins."""
    found, at = decide(odometer_history(kind, sensor, value, slips=slips), kind)
    assert found == sensor
    assert BEGINS_S < at < BEGINS_S + 60


def test_an_odometer_that_was_silent_as_the_fault_began_tells_once_it_is_back():
    silent = range(BEGINS_S - 10, BEGINS_S + 20)
    found, at = decide(odometer_history("gyros", 2, 10 * DPH, outside=silent), "gyros")
    assert found == 2
    assert BEGINS_S + 20 <= at < BEGINS_S + 80


def test_a_wheel_that_always_slips_decides_nothing():
    ram = odometer_history("gyros", 2, 10 * DPH, slips=range(0, SECONDS, 2))
    assert decide(ram, "gyros") == (-1, SECONDS)


def test_fix_and_stretch_of_a_second_are_measured_in_the_order_of_their_times():
    """Whichever comes first: a filter of linear errors knows the same after both."""
    scores = []
    for early in (blocks.MEASURED_AFTER, blocks.STRETCH_AFTER):
        ram = odometer_history("gyros", 2, 0.0)
        repair = ram[0].redundancy.repair
        stride = int(repair.stride)
        for second in range(SECONDS):
            block = repair.blocks[second * stride : (second + 1) * stride][stride - blocks.OTHERS :]
            block[blocks.VARIANCE] = SIGMA**2
            block[early] = 0.999
        assert decide(ram, "gyros") == (-1, SECONDS)
        scores.append([one.score for one in ram[0].redundancy.bank.filters[:5]])
        assert ram[0].redundancy.bank.measurements == 4 * SECONDS
    assert scores[0] == pytest.approx(scores[1], rel=1e-2)
