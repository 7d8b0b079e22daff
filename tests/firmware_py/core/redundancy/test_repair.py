"""The repair of the history: what two faults did is undone, found together or one after another."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.records.memory import blank_ram
from rrins.firmware_py.core.redundancy import blocks, repair

SECONDS, GRAVITY = 120, 9.81
GYRO, ACCELEROMETER = (0, 2), (1, 1)


def history():
    """Return a RAM image that stood level for two minutes; without a sensor it would not have."""
    ram = blank_ram()
    state = ram[0]
    state.parameters.height_channel = strapdown.HEIGHT_DAMPED
    state.ins.latitude = 0.7
    state.ins.q_s_n[0] = 1.0
    np.fill_diagonal(state.ins.C_s_n, 1.0)
    kept = state.redundancy.repair
    blocks.begin(kept, 4, 4, 0)
    random = np.random.default_rng(3)
    others = int(kept.stride) - blocks.OTHERS
    for second in range(SECONDS):
        kept.block[:24] = random.normal(0.0, 1e-6, 24)
        kept.block[others + blocks.TIME] = 1.0
        kept.block[others + blocks.FORCE + 2] = GRAVITY
        blocks.close(kept, second)
    return ram


def finish(ram):
    for _ in range(SECONDS):
        if not ram[0].redundancy.repair.active:
            return
        repair.advance(ram[0])
    pytest.fail("the repair does not end")


def solution(ram):
    ins = ram[0].ins
    return np.concatenate(([ins.latitude, ins.longitude], ins.velocity_n, ins.C_s_n.ravel()))


def test_a_repair_that_is_ordered_during_another_is_done_after_it():
    together, after = history(), history()
    before = solution(together)
    for kind, sensor in (GYRO, ACCELEROMETER):
        repair.order(together[0].redundancy.repair, kind, sensor, 60.0, 1.0)
        repair.order(after[0].redundancy.repair, kind, sensor, 60.0, 1.0)
        finish(after)
    finish(together)
    assert solution(together) == pytest.approx(solution(after), rel=1e-12, abs=1e-15)
    alone = history()
    repair.order(alone[0].redundancy.repair, *GYRO, 60.0, 1.0)
    finish(alone)
    turned, changed = solution(alone) - before, solution(together) - solution(alone)
    assert np.abs(turned[5:]).max() > 1e-6 < np.abs(changed[2:4]).max()


def test_a_history_that_begins_anew_has_no_repair_waiting():
    ram = history()
    kept = ram[0].redundancy.repair
    for kind, sensor in (GYRO, ACCELEROMETER):
        repair.order(kept, kind, sensor, 60.0, 1.0)
    blocks.begin(kept, 4, 4, 0)
    assert not kept.active
    assert not kept.waiting_s.any()
