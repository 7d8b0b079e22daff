"""Layout of a block of a second behind the changes from leaving out each sensor.

From the blocks the navigation's error can be carried through the last minutes again, for another
set of sensors: by the repair, and by the bank of filters.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.maths.vectors import copy
from rrins.firmware_py.core.records.estimator_records import ATTITUDE as ESTIMATED_ATTITUDE
from rrins.firmware_py.core.records.estimator_records import BIASES
from rrins.firmware_py.core.records.memory import Fusion, Ins, Ram
from rrins.firmware_py.core.records.redundancy_records import (
    ACCELEROMETERS,
    BLOCK_FLOATS,
    BLOCK_OTHERS,
    LONGEST_S,
    Parity,
    Repair,
)
from rrins.firmware_py.core.redundancy import windows

FORCE, WAY, TIME = 0, 3, 6
"""Integrals of the specific force (m/s) and of the velocity (m), in n, and the time, s."""

ATTITUDE, TURNED = 7, 16
"""Integral of C_s_n (s), nine numbers; amount of the sensors' turn, rad."""

UNCERTAIN = 17
"""Variance of what was not known of the parity of gyros and of accelerometers, in a second's noise;
see `windows.uncertain_second`."""

BEGUN, MEASURED_AFTER, MEASURED, VARIANCE = 19, 20, 21, 24
"""The last epoch before the block; the reference's time of validity in it (s), reference less
navigated velocity (m/s), and the variance of each; 0: no reference."""

FED_BACK = 25
"""Corrections by the estimator to the navigation: attitude and velocity in n, and to the rates and
the specific force in s; three numbers each. By these the free navigation would be off."""

STRETCH_AFTER, STRETCH_S, TRAVELLED = 37, 38, 39
"""Between two counts of the odometer about a second apart: the middle's time in the block (s), the
time (s), and the distance (m)."""

STRETCH_WAY, STRETCH_ATTITUDE = 40, 43
"""By the navigation: the wheel's way along the body's axes (m), and the integral of C_b_n (s)."""

DISTANCE_VARIANCE, SLIP_VARIANCE = 52, 53
"""Of the distance and of the way across (m²); 0: no stretch."""

STRETCH_LEVER_WAY = 59
"""Of the way by the navigation, what the lever arm makes as it turns (m)."""

UNSURE, UNSURE_BIAS = 54, 57
"""Variances of the attitude by the estimator as the block began, in n, and of the fused vectors of
gyros and of accelerometers (largest axis, rad²/s², m²/s⁴); 0: it does not run."""

OTHERS = BLOCK_OTHERS


@compiled
def begin(repair: Repair, gyros: int, accelerometers: int, epoch: int) -> None:
    """Begin the history after an epoch, for these numbers of sensors."""
    repair.stride = 3 * (gyros + accelerometers) + OTHERS
    repair.capacity = min(LONGEST_S + 64, BLOCK_FLOATS // repair.stride)
    repair.count = 0
    repair.active = False
    repair.waiting_s[:] = 0.0
    _clear(repair, epoch)


@compiled
def _clear(repair: Repair, epoch: int) -> None:
    repair.block[:] = 0.0
    repair.block[repair.stride - OTHERS + BEGUN] = epoch


@compiled
def note(
    repair: Repair, C_s_n: Floats, fusion: Fusion, parity: Parity, first: int, work: Floats
) -> None:
    """Add what leaving out each sensor of a kind would change in this epoch.

    `first` is the place of the kind in a block; `work` is scratch of shape (3,).
    """
    for k in range(fusion.count):
        unlearned = parity.unlearned[k]
        if parity.sensors >> k & 1 == 0:
            continue
        for i in range(3):
            work[i] = parity.leave_out[k, i] * unlearned
        at = first + 3 * k
        for i in range(3):
            repair.block[at + i] += (
                C_s_n[i, 0] * work[0] + C_s_n[i, 1] * work[1] + C_s_n[i, 2] * work[2]
            )


@compiled
def note_motion(repair: Repair, ins: Ins, dtheta_s: Floats, dv_s: Floats, dt: float) -> None:
    """Add the epoch's specific force, velocity, time, attitude and turn."""
    C_s_n, block = ins.C_s_n, repair.block
    others = repair.stride - OTHERS
    square = 0.0
    for i in range(3):
        block[others + FORCE + i] += (
            C_s_n[i, 0] * dv_s[0] + C_s_n[i, 1] * dv_s[1] + C_s_n[i, 2] * dv_s[2]
        )
        block[others + WAY + i] += ins.velocity_n[i] * dt
        square += dtheta_s[i] * dtheta_s[i]
        for k in range(3):
            block[others + ATTITUDE + 3 * i + k] += C_s_n[i, k] * dt
    block[others + TIME] += dt
    block[others + TURNED] += square**0.5


@compiled
def note_feedback(repair: Repair, fed_back: Floats) -> None:
    """Add what the estimator has fed back since, shape (12,), and clear that.

    As if it had done so when the block began: the force so far would have been turned, too.
    """
    block, others = repair.block, repair.stride - OTHERS
    force = block[others + FORCE : others + FORCE + 3]
    back = block[others + FED_BACK : others + FED_BACK + 12]
    back[3] -= fed_back[1] * force[2] - fed_back[2] * force[1]
    back[4] -= fed_back[2] * force[0] - fed_back[0] * force[2]
    back[5] -= fed_back[0] * force[1] - fed_back[1] * force[0]
    for i in range(12):
        back[i] += fed_back[i]
        fed_back[i] = 0.0


@compiled
def close(repair: Repair, epoch: int) -> None:
    """Keep the present block, whose last epoch this is, and begin the next."""
    at = place(repair, repair.count)
    copy(repair.blocks[at : at + repair.stride], repair.block)
    repair.count += 1
    _clear(repair, epoch)


@compiled
def note_unsure(state: Ram) -> None:
    """Note the estimator's covariance in the block that begins, with what is due to be fed back."""
    repair, estimator = state.redundancy.repair, state.estimator
    P, x, block = estimator.P, estimator.x, repair.block[repair.stride - OTHERS :]
    for i in range(ESTIMATED_ATTITUDE, ESTIMATED_ATTITUDE + 3):
        block[UNSURE + i - ESTIMATED_ATTITUDE] = P[i, i] + x[i] * x[i]
    fusion, first = state.gyros, BIASES
    for kind in range(2):
        if kind == ACCELEROMETERS:
            first += fusion.count
            fusion = state.accelerometers
        for axis in range(3):
            total, due = 0.0, 0.0
            for k in range(fusion.count):
                due += fusion.gain[axis, k] * x[first + k]
                for j in range(fusion.count):
                    total += fusion.gain[axis, k] * fusion.gain[axis, j] * P[first + k, first + j]
            block[UNSURE_BIAS + kind] = max(block[UNSURE_BIAS + kind], total + due * due)


@compiled
def place(repair: Repair, index: int) -> int:
    """Return where a kept block begins in `repair.blocks`."""
    return index % repair.capacity * repair.stride


@compiled
def note_uncertain(repair: Repair, gyros: Parity, accelerometers: Parity) -> None:
    """Note in the block that was closed last what was not known of the parities."""
    at = place(repair, repair.count - 1) + repair.stride - OTHERS + UNCERTAIN
    repair.blocks[at] = windows.uncertain_second(gyros)
    repair.blocks[at + 1] = windows.uncertain_second(accelerometers)
