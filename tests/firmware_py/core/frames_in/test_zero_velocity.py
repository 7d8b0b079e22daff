"""The operator's zero velocity as the firmware holds it, and what AIDING_STATUS tells."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.frames_in.aiding_status import AidingState
from rrins.firmware_py.core.settings import OdometerSettings


class Operator:
    """A bench whose operator says, or does not, that the vehicle stands."""

    def __init__(self, tools):
        self.tools = tools
        self.bench = tools.Bench()
        self.said = 0
        for _ in range(3):
            self.bench.step()

    @property
    def zero(self):
        return self.bench.state["zero_velocity"]

    def frame(self, standing=1, sigma=20):
        self.said += 1
        return self.tools.frame(
            "ZERO_VELOCITY", self.said % 15, standing=standing, velocity_sigma=sigma
        )

    def step(self, *frames, epochs=1):
        for k in range(epochs):
            self.bench.step([*self.bench.frames(), *(frames if k == 0 else ())])


@pytest.fixture
def operator(tools):
    return Operator(tools)


def test_it_stands_for_as_long_as_it_is_said(operator):
    assert not operator.zero["standing"]
    for _ in range(5):
        operator.step(operator.frame(), epochs=20)
    assert operator.zero["standing"]
    assert operator.zero["velocity_sigma"] == pytest.approx(0.02)
    assert operator.zero["epochs"] == 100
    operator.step(operator.frame(standing=0))
    assert (operator.zero["standing"], operator.zero["epochs"]) == (False, 0)


def test_an_operator_who_falls_silent_says_nothing(operator):
    operator.step(operator.frame(), epochs=101)
    assert operator.zero["standing"]  # 0.5 s after the frame
    operator.step()
    assert not operator.zero["standing"]


def test_a_repeated_or_harmed_frame_says_nothing(operator):
    frame = operator.frame()
    operator.step(frame, epochs=60)
    operator.step(frame, epochs=60)
    assert not operator.zero["standing"]
    harmed = operator.frame()
    harmed["data"] ^= np.uint64(1 << 20)
    operator.step(harmed)
    assert not operator.zero["standing"]
    faults = operator.bench.state["faults"]
    assert (faults["counter_errors"], faults["crc_errors"]) == (1, 1)


def told(tools, bench, epochs):
    """Return what AIDING_STATUS tells last within some epochs."""
    found = None
    for _ in range(epochs):
        for frame in bench.step():
            name, values = tools.decode(frame)
            found = values if name == "AIDING_STATUS" else found
    return found


def test_without_aiding_nothing_is_told(tools, operator):
    assert told(tools, operator.bench, 401) is None
    operator.step(operator.frame())
    status = told(tools, operator.bench, 201)
    assert (status["gnss"], status["odometer"], status["altimeter"]) == (0, 0, 0)


def test_what_comes_and_what_is_lost(tools):
    odometer = OdometerSettings(interval_s=0.1, metres_per_pulse=0.01)
    bench = tools.Bench(odometer=odometer, gnss_interval_s=1)
    for k in range(60):
        frames = bench.frames()
        if k % 20 == 0:
            frames.append(tools.frame("ODOMETER", bench.epoch, valid=1, pulses=k))
        bench.step(frames)
    status = told(tools, bench, 141)
    assert status["gnss"] == AidingState.LOST
    assert (status["odometer"], status["odometer_losses"]) == (AidingState.LOST, 1)
    assert status["odometer_age"] == pytest.approx(160 * 0.005, abs=0.051)
    assert (status["altimeter"], status["standing"]) == (AidingState.NONE, 0)
    names = tools.codec.choices("AIDING_STATUS", "gnss")
    assert names == {state: state.name for state in AidingState}
