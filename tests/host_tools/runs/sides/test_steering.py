"""How fast a steered rehearsal goes: in virtual time, and the same navigation."""

from __future__ import annotations

import json

import pytest

from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.runs.sides.steering import PAUSED, UNLIMITED, Helm, SteeredPace

PERIOD_NS = 5_000_000


class Clock:
    def __init__(self):
        self.now_ns = 10**12
        self.on_rest = lambda: None

    def rest(self, seconds):
        self.now_ns += round(seconds * 1e9)
        self.on_rest()


@pytest.fixture
def steered(tmp_path):
    clock = Clock()
    with (
        Helm(tmp_path / "speed", 1.0) as helm,
        SteeredPace(tmp_path / "speed", PERIOD_NS, lambda: clock.now_ns, clock.rest) as pace,
    ):
        yield helm, pace, clock


def passed_s(clock, pace, epochs):
    begun_ns = clock.now_ns
    for epoch in epochs:
        pace.wait_for(epoch)
    return (clock.now_ns - begun_ns) / 1e9


def test_epochs_are_due_at_the_speed_that_is_set(steered):
    helm, pace, clock = steered
    assert passed_s(clock, pace, range(201)) == pytest.approx(1.0)
    helm.steer(4.0)
    assert passed_s(clock, pace, range(201, 402)) == pytest.approx(0.25)
    helm.steer(UNLIMITED)
    assert passed_s(clock, pace, range(402, 2000)) == 0.0


def test_a_pause_ends_when_a_speed_is_set_and_is_not_made_up_for(steered):
    helm, pace, clock = steered
    pace.wait_for(0)
    helm.steer(PAUSED)
    begun_ns = clock.now_ns

    def go_on_after_a_minute():
        if clock.now_ns - begun_ns > 60e9:
            helm.steer(1.0)

    clock.on_rest = go_on_after_a_minute
    pace.wait_for(1)
    assert (clock.now_ns - begun_ns) / 1e9 == pytest.approx(60, abs=0.1)
    assert passed_s(clock, pace, range(1, 202)) == pytest.approx(1.0)


def test_a_speed_that_is_none_pauses(steered):
    helm, pace, _ = steered
    helm.steer(float("nan"))
    assert pace.speed == PAUSED
    helm.steer(-3.0)
    assert pace.speed == PAUSED


def test_without_the_file_one_line_says_so(tmp_path):
    with pytest.raises(RehearsalError, match=r"--steer .*nothing: cannot be mapped"):
        SteeredPace(tmp_path / "nothing", PERIOD_NS)


def test_a_steered_rehearsal_navigates_the_same(start, tmp_path):
    found = []
    with Helm(tmp_path / "speed", UNLIMITED):
        for options in ([], ["--steer", tmp_path / "speed"]):
            arguments = ["rehearse", "ideal", "--duration", "3", "--json", *options]
            status, out = start(*arguments).finish()
            assert status == 0
            found.append(json.loads(out)["firmware"]["navigation_sha256"])
    assert found[0] == found[1]
