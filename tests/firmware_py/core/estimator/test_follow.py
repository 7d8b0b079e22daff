"""The fine alignment of a standing vehicle, epoch by epoch as the whole computer runs it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.dbc.values import AxisCommand
from rrins.firmware_py.core.modes.modes import Mode, ModeRequest
from rrins.firmware_py.core.records.estimator_records import (
    ATTITUDE,
    BIASES,
    LATITUDE,
    LONGITUDE,
    VELOCITY,
    Aid,
)

RATE_HZ = 50
FINE_S = 4.0
STRAPDOWN, ROTATING = Mode.NAVIGATION_STRAPDOWN, Mode.NAVIGATION_ROTATING


@pytest.fixture
def make_bench(tools, kit):
    def make(**changes):
        values = {"fine_alignment_s": FINE_S, "heading_sigma": math.radians(0.1)} | changes
        estimator = kit.estimator(**values)
        # The bench's axes do not turn: tolerate it, for the scheme is to run on.
        return tools.Bench(rate_hz=RATE_HZ, estimator=estimator, follow_tolerance_deg=180.0)

    return make


def modes_until(bench, end, request, limit=1000):
    """Step until a mode is reached; return the modes on the way and the epochs in each."""
    seen = {}
    bench.step(request=request)
    for _ in range(limit):
        seen[bench.mode] = seen.get(bench.mode, 0) + 1
        if bench.mode == end:
            return seen
        bench.step()
    raise AssertionError(f"{end.name} not reached, still {bench.mode.name}")


@pytest.mark.parametrize(
    ("request_", "end"),
    [(ModeRequest.NAVIGATE_ROTATING, ROTATING), (ModeRequest.NAVIGATE_STRAPDOWN, STRAPDOWN)],
)
def test_it_comes_between_alignment_and_navigation_and_takes_its_time(make_bench, request_, end):
    bench = make_bench()
    bench.run_to(Mode.STANDBY)
    seen = modes_until(bench, end, request_)
    assert list(seen) == [Mode.ALIGNMENT, Mode.FINE_ALIGNMENT, end]
    assert seen[Mode.FINE_ALIGNMENT] == round(FINE_S * RATE_HZ)


def test_without_a_fine_alignment_there_is_none(make_bench):
    bench = make_bench(fine_alignment_s=0.0)
    seen = modes_until(bench, ROTATING, ModeRequest.NAVIGATE_ROTATING)
    assert Mode.FINE_ALIGNMENT not in seen


def test_navigation_goes_on_with_the_scheme_where_the_fine_alignment_left_it(make_bench):
    bench = make_bench()
    bench.run_to(Mode.FINE_ALIGNMENT, ModeRequest.NAVIGATE_ROTATING)
    sequencer = bench.state.sequencer
    assert sequencer.running
    assert list(sequencer.command) == 2 * [AxisCommand.POSITION]
    while bench.mode == Mode.FINE_ALIGNMENT:
        before = [int(sequencer[name]) for name in ("cycle", "position", "epochs")]
        bench.step()
    assert bench.mode == ROTATING
    assert before[:2] == [0, 1]  # a position takes 3.5 s
    after = [int(sequencer[name]) for name in ("cycle", "position", "epochs")]
    assert after == [0, 1, before[2] + 1]
    bench.step()
    assert sequencer.epochs == before[2] + 2


def test_it_ends_once_the_heading_is_known_well_enough(make_bench):
    """By the Earth's rate: 1° of heading drifts by 5 mm/s within 30 s, at 40° of latitude."""
    enough = math.radians(0.3)
    bench = make_bench(
        heading_sigma=math.radians(1.0), heading_sigma_enough=enough, fine_alignment_s=600.0
    )
    bench.run_to(Mode.FINE_ALIGNMENT, ModeRequest.NAVIGATE_STRAPDOWN)
    sigmas = []
    while bench.mode == Mode.FINE_ALIGNMENT:
        bench.step()
        sigmas.append(float(bench.state.estimator.sigma[ATTITUDE + 2]))
    assert bench.mode == STRAPDOWN
    assert 20 * RATE_HZ < len(sigmas) < 100 * RATE_HZ
    assert sigmas[RATE_HZ] == pytest.approx(math.radians(1.0), rel=1e-3)
    assert sigmas[-3] > enough  # once a second it is known, and an epoch later it ends
    assert 0.9 * enough < sigmas[-1] == sigmas[-2] <= enough
    assert len(sigmas) % RATE_HZ == 4  # corrections, covariance, noise


def test_it_begins_with_what_is_known(make_bench, kit):
    bench = make_bench(level_sigma=2e-3)
    bench.run_to(Mode.FINE_ALIGNMENT, ModeRequest.NAVIGATE_ROTATING)
    estimator = bench.state.estimator
    metres = [estimator.north_radius, estimator.east_radius]
    sigma = np.sqrt(np.diag(estimator.P))
    assert sigma[ATTITUDE : ATTITUDE + 3] == pytest.approx([2e-3, 2e-3, math.radians(0.1)])
    assert sigma[VELOCITY : VELOCITY + 3] == pytest.approx([0.002, 0.002, 0.0])
    assert sigma[[LATITUDE, LONGITUDE]] * metres == pytest.approx([0.02, 0.02])
    assert sigma[BIASES : BIASES + 4] == pytest.approx(kit.GYROS.bias_limit / 3)
    assert sigma[BIASES + 4 : BIASES + 8] == pytest.approx(kit.ACCELEROMETERS.bias_sigma)
    assert not sigma[BIASES + 8 :].any()
    estimator.P[np.diag_indices(len(sigma))] = 0.0
    assert not estimator.P.any()


@pytest.mark.parametrize(
    ("request_", "end", "command"),
    [
        (ModeRequest.STANDBY, Mode.STANDBY, AxisCommand.HOLD),
        (ModeRequest.ALIGN, Mode.ALIGNMENT, AxisCommand.HOLD),
        (ModeRequest.SHUTDOWN, Mode.SHUTDOWN, AxisCommand.OFF),
    ],
)
def test_standby_alignment_and_shutdown_end_it(make_bench, request_, end, command):
    bench = make_bench()
    bench.run_to(Mode.FINE_ALIGNMENT, ModeRequest.NAVIGATE_ROTATING)
    assert bench.state.estimator.running
    bench.step()
    bench.step(request=request_)
    bench.step()  # ALIGNMENT comes after STANDBY, once the axes stand
    assert bench.mode == end
    assert list(bench.state.sequencer.command) == 2 * [command]
    assert not bench.state.estimator.running
    for _ in range(round(FINE_S * RATE_HZ)):
        bench.step()
    assert bench.mode == end


def test_velocity_and_position_are_known_for_its_time_only(make_bench):
    bench = make_bench()
    bench.run_to(ROTATING, ModeRequest.NAVIGATE_ROTATING)
    for _ in range(2 * RATE_HZ):
        bench.step()
    sources = bench.state.estimator.sources
    before = [int(sources[aid].used) for aid in (Aid.ZERO_VELOCITY, Aid.KNOWN_POSITION)]
    # Held height: two level components at the end of each second, the last one too.
    assert before == 2 * [2 * round(FINE_S)]
    for _ in range(2 * RATE_HZ):
        bench.step()
    assert [int(sources[aid].used) for aid in Aid] == [*before, 0, 0, 0, 0]


def test_it_levels_a_vehicle_that_is_given_a_wrong_level(make_bench):
    """By the first seconds' velocities: 1 mrad of tilt is 1 cm/s in each."""
    bench = make_bench(level_sigma=2e-3, fine_alignment_s=8.0)
    tilt = 1e-3
    bench.run_to(Mode.STANDBY)
    parameters = bench.state.parameters
    parameters.C_b_n[:] = [[1, 0, tilt], [0, 1, 0], [-tilt, 0, 1]]  # about north
    bench.run_to(Mode.FINE_ALIGNMENT, ModeRequest.NAVIGATE_STRAPDOWN)
    bench.run_to(STRAPDOWN)
    estimator, C_s_n = bench.state.estimator, bench.state.ins.C_s_n
    sigma = float(estimator.sigma[ATTITUDE + 1])
    assert sigma < 0.1 * tilt
    # What is left is a bias of the accelerometers for all that the filter knows.
    assert abs(C_s_n[0, 2]) < 4 * sigma
    assert all(int(source.rejected) == 0 for source in estimator.sources)
    P = estimator.P[: int(estimator.states), : int(estimator.states)]
    assert np.array_equal(P, P.T)
    assert np.all(np.diag(P)[BIASES:] > 0)
