"""Whether a bus runs ahead of real time, by its batches alone; in virtual time."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from rrins.host_tools.bus import pace

PERIOD_S = 0.005


class Bus:
    """A bus whose epochs are due at times of a clock, which runs while somebody waits."""

    def __init__(self, due_s, monkeypatch):
        self._due_s, self._epoch, self._now_s = due_s, 0, 0.0
        clock = SimpleNamespace(monotonic_ns=lambda: round(self._now_s * 1e9))
        monkeypatch.setattr(pace, "time", clock)

    def recv_batch(self, frames, timeout):
        due = self._due_s(self._epoch)
        if due > self._now_s + timeout:
            self._now_s += timeout
            return None
        self._now_s = max(self._now_s, due) + 5e-6
        self._epoch += 1
        return SimpleNamespace(time_ns=round((self._epoch - 1) * PERIOD_S * 1e9))


def after_a_stall(stall_s, per_epoch_s):
    """Return when epochs of real time come that a stall holds back."""
    return lambda k: max(k * PERIOD_S, stall_s + k * per_epoch_s)


@pytest.mark.parametrize(
    ("due_s", "is_ahead"),
    [
        (lambda k: k * PERIOD_S, False),
        (after_a_stall(0.3, 1e-5), False),  # all that the stall held back, at once
        (after_a_stall(4.0, 1e-5), False),
        (after_a_stall(0.3, 2e-3), False),  # bit by bit
        (lambda k: k * PERIOD_S / 200, True),
        (lambda k: k * PERIOD_S / 10, True),
        (lambda k: k * PERIOD_S / 1.5, True),
        (lambda k: k * PERIOD_S / 0.5, False),
        (lambda k: k * 1e9, None),  # paused
    ],
)
def test_a_bus_that_catches_up_after_a_stall_is_not_ahead(due_s, is_ahead, monkeypatch):
    assert pace.runs_ahead(Bus(due_s, monkeypatch), 5.0) is is_ahead
